"""Clocks of flight logs: the autopilot's boot clock, GPS time and UTC."""

from datetime import UTC, datetime, timedelta

import numpy as np
import numpy.typing as npt

from core.compiled import njit
from core.kernel_types import Vector

_GPS_EPOCH = datetime(1980, 1, 6, tzinfo=UTC)

#: GPS time is ahead of UTC by so many seconds from each date on (IERS Bulletin C).
_LEAP_SECONDS = (
    (datetime(1999, 1, 1, tzinfo=UTC), 13),
    (datetime(2006, 1, 1, tzinfo=UTC), 14),
    (datetime(2009, 1, 1, tzinfo=UTC), 15),
    (datetime(2012, 7, 1, tzinfo=UTC), 16),
    (datetime(2015, 7, 1, tzinfo=UTC), 17),
    (datetime(2017, 1, 1, tzinfo=UTC), 18),
)

#: A time stamp outside its boot by more than this, s, is damaged, as is one outside those of the rows before and behind
#: it by more than so many usual intervals: rows of slow tasks are written late.
_OUTSIDE, _OUT_OF_ORDER = 5.0, 3.0


def utc_from_gps(week: int, milliseconds: float) -> datetime:
    """UTC of a GPS week (counted from 1980, no rollover) and ms of that week."""
    gps = _GPS_EPOCH + timedelta(weeks=week, milliseconds=milliseconds)
    leap = 0
    for since, seconds in _LEAP_SECONDS:
        # The table's dates are UTC; its steps are at midnight UTC, that is `seconds` later in GPS time.
        if gps >= since + timedelta(seconds=seconds):
            leap = seconds
    return gps - timedelta(seconds=leap)


@njit(cache=True, nogil=True)
def is_orderly(t: Vector, low: float, high: float) -> bool:
    """Whether times lie within a span and never step back."""
    # Counted rather than left at the first bad one, so that several are compared at once.
    good = 0
    for k in range(1, t.size):
        good += (t[k] >= t[k - 1]) & (t[k] >= low) & (t[k] <= high)
    return good == t.size - 1 and low <= t[0] <= high if t.size > 0 else True


def mend_times(t: npt.NDArray[np.float64], low: float, high: float) -> tuple[npt.NDArray[np.float64], int]:
    """Replace time stamps that cannot be by interpolation over the rows; return how many, too.

    `t` are those of one message type in file order, s: small steps back stay.
    """
    least, most = low - _OUTSIDE, high + _OUTSIDE
    if is_orderly(t, least, most):
        return t, 0
    odd = (t < least) | (t > most) | ~np.isfinite(t)
    if odd.all():
        return np.full_like(t, low), len(t)
    rows = np.arange(len(t))
    likely = np.interp(rows, rows[~odd], t[~odd])
    padded = np.pad(likely, 1, constant_values=(-np.inf, np.inf))
    before, after = padded[:-2], padded[2:]
    # Where those beside it are in order it is the row between them that is not; misplaced blocks meet where no row is.
    outside = np.maximum(before - likely, likely - after)
    stray = (before <= after) & (outside > _OUT_OF_ORDER * np.median(np.abs(np.diff(likely))))
    if not (odd | stray).all():
        # Where every row contradicts its neighbours there is no telling which to believe.
        odd |= stray
    if not odd.any():
        return t, 0
    return np.where(odd, np.interp(rows, rows[~odd], t[~odd]), t), int(odd.sum())
