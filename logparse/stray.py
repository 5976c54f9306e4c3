"""Values far off those of the rows beside them, which lead back: damaged ones.

Neither DataFlash nor ULog has checksums, so a flipped bit stays in the log: one roll of 150 degrees in a steady hover,
a battery that is empty for a tenth of a second. What a craft does reaches over several rows or moves several fields,
and so it needs no limit by field or unit: damage is what stands alone.
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.source import INSTANCE_NAMES

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]
#: Rows of damaged values, by column.
Strays = Mapping[str, Sequence[int]]

#: Rows on either side that a row is held against, and how many times further off it is than any of them moves. One of
#: them may be damaged as well: two of a size within ten rows hid each other in 26-11-2014_181 with flipped bits.
BESIDE, RATIO = 10, 8.0
#: Rows further apart than this many usual steps say nothing of what lies between.
APART = 3.0
#: Where one field of a row is damaged, the others change by no more than so many times what they do about it.
UNMOVED = 2.0
#: Nothing that a craft does is so many times further off than all beside it, whatever other fields do: a latitude off
#: by 140 m in spark404 with flipped bits, while the course of a hovering craft turned. Blows are off by 40 times.
FAR = 100.0
#: Rows that are looked at at a time.
_PIECE = 1 << 15
#: Rows by which the usual difference between rows is told well enough.
_USUAL = 1 << 11
#: Messages whose rows are events or settings: each may be like none beside it.
_EVENTS = frozenset(("ARM", "CMD", "ERR", "EV", "FMT", "MODE", "MSG", "PARM"))


def find_strays(message: str, frame: pd.DataFrame) -> Strays:
    """Return the rows of a message's damaged values, by column.

    Parameters
    ----------
    message : str
        Its name.
    frame : pandas.DataFrame
        Rows in the order of the file, indexed by time [s]; of several instances each is looked at by itself.
    """
    strays: dict[str, list[int]] = {}
    if message in _EVENTS or len(frame) < 2 * BESIDE:
        return strays
    bare = pd.DataFrame(frame)  # without attributes, which every column would copy
    columns = {str(name): column.to_numpy() for name, column in bare.items() if column.dtype.kind in "biuf"}
    instance = frame.attrs.get("instance") or next((name for name in INSTANCE_NAMES if name in columns), None)
    t = frame.index.to_numpy(np.float64)
    for rows in _instances(columns.pop(instance) if instance in columns else np.zeros(len(frame))):
        for first in range(0, len(rows), _PIECE):
            start = max(first - BESIDE - 1, 0)
            piece = rows[start : first + _PIECE + BESIDE + 1]
            for row, name in _strays(t[piece], {name: column[piece] for name, column in columns.items()}):
                if 0 <= row + start - first < _PIECE:
                    strays.setdefault(name, []).append(int(piece[row]))
    return strays


def without(frame: pd.DataFrame, strays: Strays) -> pd.DataFrame:
    """Return a message with damaged values, of the columns that it has, as missing."""
    damaged = [name for name in strays if name in frame]
    if not damaged:
        return frame
    kept = frame.copy(deep=False)
    for name in damaged:
        values = frame[name].to_numpy()
        values = values.astype(values.dtype if values.dtype.kind == "f" else np.float64)
        values[strays[name]] = np.nan
        kept[name] = values
    kept.attrs = frame.attrs
    return kept


def _instances(numbers: npt.NDArray[np.generic]) -> Iterator[Rows]:
    """Yield the rows of each instance that has enough to tell damage from what a craft does."""
    if len(numbers) and (numbers == numbers[0]).all():
        which = [np.arange(len(numbers))]
    else:
        which = [np.flatnonzero(numbers == number) for number in np.unique(numbers)]
    yield from (rows for rows in which if len(rows) >= 2 * BESIDE)


def _strays(t: Array, columns: dict[str, npt.NDArray[np.generic]]) -> Iterator[tuple[int, str]]:
    """Yield row and name of each value that stands alone in time and in its row."""
    with np.errstate(invalid="ignore"):  # damage may make a float that only warns of itself
        numbers = {name: column.astype(np.float64) for name, column in columns.items()}
    candidates: dict[int, dict[str, float]] = {}
    for name, column in numbers.items():
        for row, times in zip(*_alone_off(column), strict=True):
            candidates.setdefault(int(row), {})[name] = float(times)
    if not candidates:
        return
    together = _together(t)
    for row, off in candidates.items():
        for name, times in off.items():
            others = (column for other, column in numbers.items() if other != name)
            if together[row] and (
                FAR < times < np.inf or not (len(off) > 1 or any(_moved(other, row) for other in others))
            ):
                yield row, name


def _together(t: Array) -> npt.NDArray[np.bool_]:
    """Return which rows lie no further from both neighbours than rows usually do."""
    step = np.abs(np.diff(t))
    close = APART * float(np.median(step))
    return np.concatenate([[False], np.maximum(step[1:], step[:-1]) <= close, [False]])


def _alone_off(values: Array) -> tuple[Rows, Array]:
    """Return the rows that stand out between their neighbours as none about them does; by how many times."""
    middle = values.copy()
    with np.errstate(invalid="ignore", over="ignore"):  # numbers of damaged rows
        before, at, after = values[:-2], values[1:-1], values[2:]
        middle[1:-1] = np.maximum(np.minimum(before, at), np.minimum(np.maximum(before, at), after))
        off, rise = np.abs(values - middle), np.abs(np.diff(middle, append=middle[-1:]))
    moving = rise[rise > 0.0]
    # Below what one row usually differs from the next, resolution and noise make rows of their own.
    least = float(np.median(moving[:: 1 + len(moving) // _USUAL])) if len(moving) > BESIDE else 0.0
    rows = np.flatnonzero(off > RATIO * least)
    if not len(rows):
        return rows, np.empty(0)
    # Courses that touch north are as near to each other the other way round.
    off[rows] = np.where(
        (values[rows] >= 0.0) & (off[rows] < 360.0), np.minimum(off[rows], 360.0 - off[rows]), off[rows]
    )
    others, moved = _about(off, rows), _about(rise, rows).max(axis=1)
    others[:, BESIDE] = 0.0
    with np.errstate(divide="ignore", over="ignore"):
        times = off[rows] / np.maximum(np.maximum(np.partition(others, -2, axis=1)[:, -2], moved), least)
    return rows[times > RATIO], times[times > RATIO]


def _about(values: Array, rows: Rows) -> Array:
    """Return the values of the rows about some, shape (rows, 2 BESIDE + 1); 0 beyond the ends and where missing."""
    return np.nan_to_num(np.lib.stride_tricks.sliding_window_view(np.pad(values, BESIDE), 2 * BESIDE + 1)[rows])


def _moved(column: Array, row: int) -> bool:
    """Return whether another column moves more than anywhere about it, as by a blow."""
    first = max(row - BESIDE - 1, 0)
    with np.errstate(invalid="ignore", over="ignore"):
        rise, at = np.nan_to_num(np.abs(np.diff(column[first : row + BESIDE + 2]))), row - first
    busier = max(float(side.max(initial=0.0)) for side in (rise[: max(at - 2, 1)], rise[at + 2 :]))
    return bool(rise[at - 1 : at + 1].max() > UNMOVED * busier)
