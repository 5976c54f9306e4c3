"""Rows of which a value is far off the line between the rows beside it, and that lead back: damaged ones.

A binary log has no checksums, so a flipped bit of the card stays in it: one roll of 150 degrees in a steady hover. What
a craft does reaches over several rows, moves several columns, or is no further from the line between two rows than its
acceleration takes it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.canonical.remarks import Remarks
from logparse.canonical.series import Array, wrap
from logparse.tables import Tables

Marks = npt.NDArray[np.bool_]
Rows = npt.NDArray[np.intp]

#: Rows that are looked at at a time.
PIECE = 1 << 15

#: Rows on either side that a row is held against, and how many times further off the line it is than any of them.
BESIDE, RATIO = 10, 6.0
#: The rows beside a damaged one differ by no more than this part of how far it is off.
BACK = 0.5
#: Rows further apart than this many usual steps say nothing of what lies between.
APART = 3.0
#: Where one value of a row is damaged, the others change by no more than so many times what they do before or after.
UNMOVED = 2.0


@dataclass(frozen=True, slots=True)
class Limit:
    """How far columns of a table can be off the line between two rows."""

    columns: tuple[str, ...]
    least: float  #: So far anything may be off, in the unit of the columns.
    acceleration: float = 0.0  #: What no craft exceeds, per s^2.
    angle: bool = False
    #: Whether a blow may do the same to a single row, but then to several columns: only one of them is damaged.
    alone: bool = False


_ATTITUDE = Limit(("roll", "pitch", "yaw"), 0.25, 100.0, angle=True)
_VELOCITY = Limit(("v_n", "v_e", "v_d"), 3.0)
#: By table of `Tables`, in its units; places are in radians, of which 1e-6 are 6 m.
LIMITS: Mapping[str, tuple[Limit, ...]] = {
    "attitude": (_ATTITUDE,),
    "gps": (Limit(("lat", "lon"), 1e-6, 5e-6), Limit(("alt",), 10.0, 30.0), _VELOCITY),
    "baro": (Limit(("alt",), 3.0, 30.0),),
    "mag": (Limit(("mag_x", "mag_y", "mag_z"), 1e-5, alone=True),),
    "imu": (
        Limit(("gyro_x", "gyro_y", "gyro_z"), 3.0, alone=True),
        Limit(("accel_x", "accel_y", "accel_z"), 15.0, alone=True),
    ),
    "ekf": (Limit(("p_n", "p_e", "p_d"), 5.0, 30.0), _VELOCITY, _ATTITUDE),
}
#: A command to one motor alone: a mixer moves several.
_PULSE = 150.0


def without_stray_rows(tables: Tables, remarks: Remarks) -> Tables:
    """Return tables with the damaged rows of all short ones as missing."""
    return replace(
        tables,
        attitude=without_stray(tables.attitude, "attitude", remarks),
        gps=without_stray(tables.gps, "gps", remarks),
        baro=without_stray(tables.baro, "baro", remarks),
        mag=without_stray(tables.mag, "mag", remarks),
        ekf=without_stray(tables.ekf, "ekf", remarks),
        motors=without_stray(tables.motors, "motors", remarks),
    )


def without_stray(table: pd.DataFrame | None, name: str, remarks: Remarks) -> pd.DataFrame | None:
    """Return the table `name` with damaged rows as missing."""
    if table is None or len(table) < 2 * BESIDE:
        return table
    limits = LIMITS.get(name) or (Limit(tuple(map(str, table.columns)), _PULSE, alone=True),)
    stray = stray_rows(table, limits)
    count = int(np.count_nonzero(stray))
    if count == 0:
        return table
    remarks.count(f"table {name}", "one row off the line between its neighbours as no craft moves", count, len(table))
    kept = table.copy()
    columns = [str(c) for c in table.columns if c not in ("t_valid", "fix")]
    kept.loc[stray, columns] = np.nan
    return kept


def stray_rows(table: pd.DataFrame, limits: tuple[Limit, ...]) -> Marks:
    """Return which rows are damaged, shape (n,)."""
    t = table.index.to_numpy(np.float64)
    marked = np.zeros(len(t), np.bool_)
    together: Marks | None = None
    for limit in limits:
        for column in limit.columns:
            rows = _alone_off(t, table[column].to_numpy(np.float64), limit)
            if not len(rows):
                continue
            together = _together(t) if together is None else together
            rows = rows[together[rows]]
            if limit.alone:
                others = [c for each in limits for c in each.columns if c != column]
                rows = np.array([row for row in rows.tolist() if not _moved(table[others], row)], np.intp)
            marked[rows] = True
    return marked


def _together(t: Array) -> Marks:
    """Return which rows lie no further from both neighbours than rows usually do."""
    step = np.diff(t)
    close = APART * float(np.median(step))
    return np.concatenate([[False], np.maximum(step[1:], step[:-1]) < close, [False]])


def _alone_off(t: Array, values: Array, limit: Limit) -> Rows:
    """Return the rows that are off the line between their neighbours where the rows about them are not."""
    # No value is further off the line than from one of its neighbours: most tables have nothing to look at.
    if not any(_steps(values[first : first + PIECE + 1], limit) for first in range(0, len(values), PIECE)):
        return np.empty(0, np.intp)
    off, across = _off_line(t, values, angle=limit.angle)
    dt = np.diff(t)
    bound = limit.least + 0.5 * limit.acceleration * dt[:-1] * dt[1:]
    rows = np.flatnonzero((off[1:-1] > bound) & (across[1:-1] < BACK * off[1:-1])) + 1
    return np.asarray(rows[off[rows] > RATIO * _largest_beside(off, rows)])


def _steps(values: Array, limit: Limit) -> bool:
    """Return whether any value is further from the one before than what counts as off the line."""
    rise = np.diff(values)
    if limit.angle:
        rise = wrap(rise)
    return bool((np.abs(rise) > 0.999 * limit.least).any())


def _off_line(t: Array, values: Array, *, angle: bool = False) -> tuple[Array, Array]:
    """Return how far each value is off the line between its neighbours, and those from each other."""
    off, across = np.zeros(len(t)), np.zeros(len(t))
    dt, rise = np.diff(t), np.diff(values)
    if angle:
        rise = wrap(rise)
    between = rise[:-1] + rise[1:]
    off[1:-1] = np.nan_to_num(np.abs(rise[:-1] * dt[1:] - rise[1:] * dt[:-1]) / (dt[:-1] + dt[1:]))
    across[1:-1] = np.abs(wrap(between) if angle else between)
    return off, across


def _moved(others: pd.DataFrame, row: int) -> bool:
    """Return whether any of the other columns moves more than before it or after it, as by a blow."""
    first = max(row - BESIDE - 1, 0)
    near = others.iloc[first : row + BESIDE + 2]
    t, at = near.index.to_numpy(np.float64), row - first
    for column in near:
        for change in _off_line(t, near[column].to_numpy(np.float64)):
            sides = change[1 : max(at - 1, 2)], change[at + 2 : -1]
            if change[at] > UNMOVED * min(float(side.max(initial=0.0)) for side in sides):
                return True
    return False


def _largest_beside(off: Array, rows: Rows) -> Array:
    """Return how far the rows about some are off, at most, but for those right beside them, which they bend."""
    padded = np.concatenate([np.zeros(BESIDE), off, np.zeros(BESIDE)])
    about = np.lib.stride_tricks.sliding_window_view(padded, 2 * BESIDE + 1)[rows].copy()
    about[:, BESIDE - 1 : BESIDE + 2] = 0.0
    return np.asarray(about.max(axis=1, initial=0.0))
