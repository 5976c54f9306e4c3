"""Clocks of flight logs: the autopilot's boot clock, GPS time and UTC."""

from datetime import UTC, datetime, timedelta

import numpy as np
import numpy.typing as npt

from logparse import _decode

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

#: A time stamp that leaves the rows before and behind it by more than this, s, is damaged.
_ODD_STEP = 5.0


def utc_from_gps(week: int, milliseconds: float) -> datetime:
    """UTC of a GPS week (counted from 1980, no rollover) and ms of that week."""
    gps = _GPS_EPOCH + timedelta(weeks=week, milliseconds=milliseconds)
    leap = 0
    for since, seconds in _LEAP_SECONDS:
        # The table's dates are UTC; its steps are at midnight UTC, that is `seconds` later in GPS time.
        if gps >= since + timedelta(seconds=seconds):
            leap = seconds
    return gps - timedelta(seconds=leap)


def mend_times(t: npt.NDArray[np.float64], low: float, high: float) -> tuple[npt.NDArray[np.float64], int]:
    """Replace time stamps that cannot be by interpolation over the rows.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Times of one message type in file order, s. Small steps back are usual and stay.
    low, high : float
        Span of the boot, s; nothing lies far outside.

    Returns
    -------
    ndarray, int
        Times and how many were replaced.
    """
    if _decode.is_orderly(t, low - _ODD_STEP, high + _ODD_STEP, _ODD_STEP):
        return t, 0
    odd = (t < low - _ODD_STEP) | (t > high + _ODD_STEP) | ~np.isfinite(t)
    steps = np.diff(t)
    if np.any(steps < -_ODD_STEP):
        # A row far from both of its neighbours, which agree with each other.
        before, after = steps[:-1], steps[1:]
        lone = (np.abs(before) > _ODD_STEP) & (np.abs(after) > _ODD_STEP) & (before * after < 0)
        lone &= t[2:] >= t[:-2] - _ODD_STEP
        odd[1:-1] |= lone
    count = int(odd.sum())
    if count == 0:
        return t, 0
    good = np.flatnonzero(~odd)
    if len(good) == 0:
        return np.full_like(t, low), count
    mended = t.copy()
    mended[odd] = np.interp(np.flatnonzero(odd), good, t[good])
    return mended, count
