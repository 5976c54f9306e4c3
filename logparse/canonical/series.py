"""Time series as the canonical tables want them: one value per time, times strictly increasing."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import numpy.typing as npt
import pandas as pd

from logparse.tables import framed

Array = npt.NDArray[np.float64]


def series(
    t: npt.ArrayLike, columns: Mapping[str, npt.ArrayLike] | Iterable[tuple[str, npt.ArrayLike]]
) -> pd.DataFrame:
    """Make a table from samples in the order in which they were logged.

    Rows without a time are dropped, rows that step backwards are sorted in, and of rows with the same time the
    last counts. Infinite values become NaN.
    """
    index, made = _made(t, columns.items() if isinstance(columns, Mapping) else columns)
    # The columns are our own: gathering them into one block would only copy them.
    return pd.DataFrame(dict(made), index=index, copy=False)


def columns_of(t: npt.ArrayLike, columns: Iterable[tuple[str, npt.ArrayLike]]) -> Iterator["pd.Series[float]"]:
    """Yield the columns of the table that `series` makes, one by one; they share their index."""
    index, made = _made(t, columns)
    for name, column in made:
        yield pd.Series(column, index=index, name=name, copy=False)


def _made(
    t: npt.ArrayLike, columns: Iterable[tuple[str, npt.ArrayLike]]
) -> tuple["pd.Index[float]", Iterator[tuple[str, Array]]]:
    in_order = _strictly_increasing(t)
    times = np.asarray(t, dtype=np.float64)
    keep = None if in_order else order_of(times)

    def made() -> Iterator[tuple[str, Array]]:
        for name, values in columns:
            column = np.asarray(values, dtype=np.float64)
            if keep is not None:
                column = column[keep]
            elif not (column.flags.owndata and column.flags.writeable):
                column = column.copy()  # of the caller's, who may change it
            infinite = np.isinf(column)
            if infinite.any():
                column = np.where(infinite, np.nan, column)
            yield name, column

    if in_order:
        assert isinstance(t, pd.Index)
        return t if t.name == "t" else t.rename("t"), made()
    return pd.Index(times[keep], name="t", dtype=np.float64), made()


def _strictly_increasing(t: object) -> bool:
    """Return whether times are an index that can be used as it is; pandas asks that of each index once."""
    if not isinstance(t, pd.Index) or t.dtype != np.float64 or not len(t):
        return False
    return bool(t.is_monotonic_increasing and t.is_unique and np.isfinite(t[0]) and np.isfinite(t[-1]))


def order_of(t: Array) -> npt.NDArray[np.intp]:
    """Positions of the samples that make `t` strictly increasing; of equal times the last logged."""
    if len(t) and np.isfinite(t).all() and (np.diff(t) > 0.0).all():
        return np.arange(len(t))
    order = np.argsort(t, kind="stable")
    order = order[np.isfinite(t[order])]
    if len(order) == 0:
        return order
    last = np.append(np.diff(t[order]) > 0.0, True)
    return np.asarray(order[last])


def distinct(t: npt.ArrayLike) -> tuple[npt.NDArray[np.intp], Array]:
    """Order events by time without losing those that share one: later ones move by a microsecond each."""
    times = np.asarray(t, dtype=np.float64)
    order = np.argsort(times, kind="stable")
    order = order[np.isfinite(times[order])]
    steps = 1e-6 * np.arange(len(order))
    # The running maximum of (t - k us) plus k us is the smallest strictly increasing sequence not before t.
    moved = np.maximum.accumulate(times[order] - steps) + steps
    # Times of a damaged clock may be so large that a microsecond is nothing beside them.
    for k in np.flatnonzero(np.diff(moved) <= 0.0):
        moved[k + 1] = np.nextafter(max(moved[k], moved[k + 1]), np.inf)
    return order, moved


def sample(table: pd.DataFrame, t: Array, *, gap: float, angles: bool = False) -> Array:
    """Interpolate columns of a table at other times, (N, columns); NaN beyond `gap` from a sample."""
    result = np.full((len(t), table.shape[1]), np.nan, order="F")  # columns go into tables, each as it is
    source = table.index.to_numpy()
    its_own = np.array_equal(source, t)
    near_all: npt.NDArray[np.bool_] | None = None
    for k, name in enumerate(table.columns):
        values = table[name].to_numpy(dtype=np.float64)
        valid = np.isfinite(values)
        if its_own and valid.all():
            result[:, k] = wrap(values) if angles else values
            continue
        if not valid.any():
            continue
        times = source
        if valid.all():
            near_all = near = _near(source, t, gap) if near_all is None else near_all
        else:
            times, values = source[valid], values[valid]
            near = _near(times, t, gap)
        interpolated = np.interp(t, times, np.unwrap(values) if angles else values)
        result[near, k] = wrap(interpolated[near]) if angles else interpolated[near]
    return result


def _near(times: Array, t: Array, gap: float) -> npt.NDArray[np.bool_]:
    """Mark the times that are no farther than `gap` from the nearest sample."""
    right = np.searchsorted(times, t).clip(0, len(times) - 1)
    left = (right - 1).clip(0)
    return np.asarray(np.minimum(np.abs(times[right] - t), np.abs(t - times[left])) <= gap)


#: Readings alike to the last digit that a live sensor does not give.
_FROZEN = 100


def frozen(values: Array) -> npt.NDArray[np.bool_]:
    """Mark the samples, (N, k), of a sensor that repeats one reading throughout, as no live one does."""
    known = np.asarray(np.isfinite(values).all(axis=1))
    seen = values[known]
    return known & (len(seen) >= _FROZEN and bool((seen == seen[0]).all()))


#: Columns that are angles, rad.
ANGLES = ("roll", "pitch", "yaw")


def join(parts: Iterable[pd.DataFrame], columns: Iterable[str], *, gap: float) -> pd.DataFrame | None:
    """Interpolate tables to the times of the one with most rows."""
    return framed(joined_columns(parts, columns, gap=gap))


def joined_columns(
    parts: Iterable[pd.DataFrame], columns: Iterable[str], *, gap: float
) -> Iterator["pd.Series[float]"]:
    """Yield columns of the table that `join` makes, one by one; they share their index."""
    tables = sorted((part for part in parts if len(part)), key=len)[::-1]
    if not tables:
        return
    index = tables[0].index.rename("t")
    t = index.to_numpy()
    missing = np.broadcast_to(np.nan, len(t))  # takes no memory
    for name in columns:
        table = next((part for part in tables if name in part), None)
        values = missing if table is None else sample(table[[name]], t, gap=gap, angles=name in ANGLES)[:, 0]
        yield pd.Series(values, index=index, name=name, copy=False)


def with_attitude(table: pd.DataFrame, attitude: pd.DataFrame | None, gap: float) -> pd.DataFrame:
    """Add roll, pitch and yaw at the times of a table; NaN without an attitude."""
    if attitude is None:
        return table.reindex(columns=[*table.columns, *ANGLES])
    table[list(ANGLES)] = sample(attitude[list(ANGLES)], table.index.to_numpy(), gap=gap, angles=True)
    return table


def wrap(angle: npt.ArrayLike) -> Array:
    """Wrap angles [rad] into (-pi, pi]."""
    angles = np.asarray(angle, dtype=np.float64)
    # Angles that are in the interval already stay as they are, to the last bit.
    inside = (angles > -np.pi) & (angles <= np.pi)
    with np.errstate(invalid="ignore"):  # damaged angles may be infinite: they have no direction, and become NaN
        return np.where(inside, angles, np.pi - np.mod(np.pi - angles, 2.0 * np.pi))
