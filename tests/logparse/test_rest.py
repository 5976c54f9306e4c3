"""The accelerometer at rest: gravity where calibrated, a finding where not, nothing where it never rests."""

import numpy as np
import pandas as pd
import pytest

from logparse.flights import Flight
from logparse.rest import ACCEL, GYRO, at_rest, calibration
from logparse.tables import Tables

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
