"""Damaged rows and time stamps beside what a craft really does, and the accelerometer at rest."""

from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from logparse.canonical.remarks import Remarks
from logparse.canonical.stray import LIMITS, without_stray, without_stray_rows
from logparse.flights import Flight
from logparse.rest import ACCEL, GYRO, at_rest, calibration
from logparse.tables import Tables
from logparse.timebase import mend_times, utc_from_gps

N, AT = 200, 120
#: Usual scatter of each table's columns, and what a flipped bit adds to one of them.
DAMAGED = {
    "attitude": (0.02, ("roll", "pitch", "yaw"), {"roll": np.radians(150.0)}),
    "gps": (1e-8, ("lat", "lon", "alt", "v_n", "v_e", "v_d"), {"lon": 3e-4}),
    "baro": (0.1, ("alt",), {"alt": 128.0}),
    "mag": (3e-7, ("mag_x", "mag_y", "mag_z"), {"mag_y": 5e-5}),
    "imu": (0.3, ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"), {"accel_z": 19.6}),
    "ekf": (0.05, ("p_n", "p_e", "p_d", "v_n", "v_e", "v_d", "roll", "pitch", "yaw"), {"p_d": 64.0}),
    "motors": (20.0, ("m1", "m2", "m3", "m4"), {"m2": 512.0}),
}


def table(name, seed=1):
    scatter, columns, added = DAMAGED[name]
    rng = np.random.default_rng(seed)
    index = pd.Index(0.1 * np.arange(N), name="t")
    return pd.DataFrame(scatter * rng.normal(size=(N, len(columns))), index=index, columns=list(columns)), added


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_row_is_taken_as_missing_and_counted(name):
    clean, added = table(name)
    assert without_stray(clean, name, Remarks()) is clean
    damaged = clean.copy()
    for column, much in added.items():
        damaged.loc[damaged.index[AT], column] += much
    remarks = Remarks()
    mended = without_stray(damaged, name, remarks)
    assert np.flatnonzero(mended.isna().all(axis=1)).tolist() == [AT]
    pd.testing.assert_frame_equal(mended.drop(mended.index[AT]), clean.drop(clean.index[AT]))
    (finding,) = remarks.findings()
    assert finding.id == "impossible-values"
    assert f"1 of {N}" in finding.reason


def test_a_heading_that_goes_through_south_is_not_damaged():
    attitude, _ = table("attitude")
    turning = attitude.assign(yaw=np.angle(np.exp(1j * 0.3 * np.arange(N))))
    assert without_stray(turning, "attitude", Remarks()) is turning


@pytest.mark.parametrize("seed", range(3))
def test_what_a_craft_does_stays(seed):
    """A flip of the craft reaches over rows, a blow goes on as turning, a step does not lead back."""
    attitude, _ = table("attitude", seed)
    flip = attitude.copy()
    flip.iloc[AT : AT + 5, 0] += [0.8, 2.0, 3.0, 2.0, 0.8]
    assert without_stray(flip, "attitude", Remarks()) is flip
    imu, _ = table("imu", seed)
    blow = imu.copy()
    blow.iloc[AT, 5] -= 30.0
    blow.iloc[AT:, 0] += 3.0 * np.exp(-np.arange(N - AT) / 3.0)
    assert without_stray(blow, "imu", Remarks()) is blow
    baro, _ = table("baro", seed)
    step = baro.copy()
    step.iloc[AT:] += 20.0
    assert without_stray(step, "baro", Remarks()) is step
    motors, _ = table("motors", seed)
    roll = motors.copy()
    roll.iloc[AT] += [300.0, -300.0, 300.0, -300.0]
    assert without_stray(roll, "motors", Remarks()) is roll


def test_tables_that_are_not_there_stay_away():
    attitude, _ = table("attitude")
    tables = Tables(attitude=attitude)
    assert without_stray_rows(tables, Remarks()) == replace(tables)
    assert set(DAMAGED) == {*LIMITS, "motors"}


RATE = 50.0


def imu(seconds=20.0, force=(0.0, 0.0, -9.81), turning=0.0, shaking=0.05, seed=1):
    """Make an IMU that stands, turns or shakes, with noise of a usual sensor."""
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, seconds, 1.0 / RATE)
    columns = {name: turning * np.sin(3.0 * t) + 0.005 * rng.standard_normal(len(t)) for name in GYRO}
    columns |= {name: f + shaking * rng.standard_normal(len(t)) for name, f in zip(ACCEL, force, strict=True)}
    return Tables(imu=pd.DataFrame(columns, index=pd.Index(t, name="t")))


def ids(tables, flights=(), parameters=None):
    return [finding.id for finding in calibration(at_rest(tables, flights), parameters or {})]


@pytest.mark.parametrize("tilt", [0.0, 0.5, 1.2, 3.1])
def test_a_calibrated_one_reads_gravity_however_it_stands(tilt):
    assert ids(imu(force=(9.81 * np.sin(tilt), 0.0, -9.81 * np.cos(tilt)))) == []


@pytest.mark.parametrize("reads", [8.28, 8.79, 10.66, 7.9])
def test_one_that_is_not_calibrated_is_found(reads):
    """The Erle boards of 2014 read 8.3 to 8.8 m/s^2 at rest, and their second IMU 10.7."""
    tables = imu(force=(0.2, 0.1, -reads))
    assert at_rest(tables, ()).specific_force == pytest.approx(np.hypot(reads, np.hypot(0.2, 0.1)), abs=0.02)
    (finding,) = calibration(at_rest(tables, ()), {f"INS_ACCOFFS_{axis}": 0.0 for axis in "XYZ"})
    assert finding.id == "sensor-doubtful"
    assert "never calibrated" in finding.reason
    assert "Calibrate" in finding.advice


def test_idling_motors_do_not_matter():
    assert ids(imu(shaking=0.4)) == []
    assert ids(imu(force=(0.0, 0.0, -8.5), shaking=0.4)) == ["sensor-doubtful"]


def test_flight_and_handling_are_no_rest():
    bad = imu(force=(0.0, 0.0, -12.0))
    assert at_rest(bad, [Flight(0.0, 20.0)]) is None
    assert at_rest(imu(force=(0.0, 0.0, -12.0), turning=0.3), ()) is None
    assert at_rest(imu(force=(0.0, 0.0, -12.0), shaking=2.0), ()) is None
    assert at_rest(imu(seconds=2.0), ()) is None
    assert at_rest(Tables(), ()) is None


def test_samples_without_a_value_are_passed_over():
    tables = imu(force=(0.0, 0.0, -8.5))
    tables.imu.iloc[:300, 3] = np.nan
    assert at_rest(tables, ()).specific_force == pytest.approx(8.5, abs=0.02)


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
