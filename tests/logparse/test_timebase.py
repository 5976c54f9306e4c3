"""GPS time, leap seconds and damaged time stamps."""

from datetime import UTC, datetime

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from logparse.timebase import mend_times, utc_from_gps


@pytest.mark.parametrize(
    ("utc", "leap"),
    [
        # Offsets of GPS time from UTC as IERS Bulletin C announced them, on both sides of their dates.
        (datetime(2012, 6, 30, 23, 59, 59, tzinfo=UTC), 15),
        (datetime(2012, 7, 1, 0, 0, 1, tzinfo=UTC), 16),
        (datetime(2014, 1, 26, 15, 42, 44, tzinfo=UTC), 16),
        (datetime(2015, 7, 1, 0, 0, 1, tzinfo=UTC), 17),
        (datetime(2016, 12, 31, 23, 59, 59, tzinfo=UTC), 17),
        (datetime(2017, 1, 1, 0, 0, 1, tzinfo=UTC), 18),
        (datetime(2024, 5, 5, 12, 0, 0, tzinfo=UTC), 18),
    ],
)
def test_utc_of_gps_week_and_milliseconds(utc: datetime, leap: int) -> None:
    seconds = (utc - datetime(1980, 1, 6, tzinfo=UTC)).total_seconds() + leap
    week, rest = divmod(seconds, 604800)
    assert utc_from_gps(int(week), rest * 1e3) == utc


def test_times_in_order_are_left_alone() -> None:
    t = np.array([1.0, 1.1, 1.09, 1.2, 400.0, 400.1])
    mended, count = mend_times(t, 1.0, 400.1)
    assert count == 0
    assert mended is t


def test_lone_odd_times_are_interpolated() -> None:
    t = np.array([10.0, 11.0, 9e9, 13.0, 14.0, 2.0, 16.0, np.nan, 18.0])
    mended, count = mend_times(t, 0.0, 20.0)
    assert count == 3
    np.testing.assert_allclose(mended, np.arange(10.0, 19.0))


@given(st.lists(st.floats(width=32), max_size=12))
@settings(deadline=None, derandomize=True)
def test_whatever_the_times_they_come_back_within_the_boot(times: list[float]) -> None:
    mended, _ = mend_times(np.array(times), 0.0, 100.0)
    assert len(mended) == len(times)
    assert ((mended >= -5.0) & (mended <= 105.0)).all()


def test_two_rows_that_contradict_each_other_are_left() -> None:
    mended, count = mend_times(np.array([90.0, 10.0]), 0.0, 100.0)
    assert (mended.tolist(), count) == ([90.0, 10.0], 0)
