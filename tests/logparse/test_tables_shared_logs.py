"""Canonical tables of real logs (2013 to 2021) and of firmware in the loop, whose truth is known."""

import json
import math
from functools import cache

import numpy as np
import pandas as pd
import pymap3d
import pytest

from core.attitude import euler_from_quat
from logparse import completeness, read_log
from logparse.canonical.series import sample, wrap
from logparse.tables import COLUMNS
from tests.forms import thinned
from tests.paths import REAL, SHARED

LOGS = sorted(path for path in SHARED.glob("*/*") if path.suffix.lower() in (".bin", ".log", ".tlog", ".ulg"))
SITL = [path for path in LOGS if path.parent.name == "sitl" and path.suffix == ".BIN"]

if not LOGS:
    pytest.skip("shared logs are not here", allow_module_level=True)


def name_of(path):
    return path.name


@cache
def log_of(path):
    return read_log(path)


@pytest.mark.parametrize("path", thinned(LOGS, 2), ids=name_of)
def test_every_log_gives_well_formed_tables_of_what_the_world_has(path):
    log = log_of(path)
    if path.parent == REAL:
        inventory = pd.read_csv(REAL / "INVENTORY.tsv", sep="\t", index_col="file")
        assert log.format == inventory["format"].get(path.name, path.suffix[1:]).split()[0].removesuffix("-bin")
    for name, columns in COLUMNS.items():
        table = getattr(log.tables, name)
        if table is None:
            continue
        assert len(table) > 0
        assert table.index.name == "t"
        assert table.index.dtype == np.float64
        assert (np.diff(table.index) > 0).all(), name
        if log.format.startswith("dataflash"):  # telemetry has what ground stations sent before the craft did
            assert log.boot.t_start - 1.0 <= table.index[0] <= table.index[-1] <= log.boot.t_end + 1.0, name
        if name not in ("motors", "esc"):
            assert list(table) == list(columns), name
        if name not in ("modes", "events"):
            assert not np.isinf(table.to_numpy()).any(), name
    for flight in log.flights:
        assert flight.duration >= 2.0
    # Wrong units or signs show here at once: a milligauss taken for a gauss, a centivolt for a volt, z up for down.
    assert_possible(log)


def assert_possible(log):
    """Every value is one that the world has."""
    tables = log.tables
    if tables.motors is not None:
        assert tables.motors.min().min() >= 800
        assert tables.motors.max().max() <= 2250
        assert list(tables.motors) == [f"m{motor.number}" for motor in log.vehicle.motors]
    if tables.imu is not None:
        # Accelerometers that were never calibrated are off by up to 2 m/s^2 on old boards, and then a finding says so.
        doubted = any(finding.id == "sensor-doubtful" for finding in completeness.check(log))
        assert abs(tables.imu["accel_z"].median() + 9.81) < (2.5 if doubted else 0.9)
    if tables.mag is not None:
        # The field of the Earth has 22 to 67 uT; what is uncalibrated may have twice as much.
        assert 15e-6 < np.linalg.norm(tables.mag.dropna(), axis=1).mean() < 140e-6
    if tables.battery is not None:
        assert 6.0 < tables.battery["voltage"].median() < 60.0
    if tables.baro is not None and tables.baro["pressure"].notna().any():
        assert 60e3 < tables.baro["pressure"].median() < 105e3
    if tables.attitude is not None:
        assert tables.attitude.abs().max().max() <= math.pi
    if tables.origin is not None:
        assert -100.0 < tables.origin.alt < 5000.0
    if tables.setpoints is not None:
        throttle = tables.setpoints["throttle"].dropna()
        # A rover brakes and goes backwards.
        assert throttle.between(-1.0 if log.vehicle.firmware == "ArduRover" else 0.0, 1.0).all()


def test_telemetry_with_several_boots_shows_the_one_that_flies():
    log = log_of(SHARED / "real" / "pypi-fasttlogparser__pymavlink_flight.tlog")
    assert len(log.boots) >= 4
    assert len(log.flights) >= 3
    assert sum(flight.duration for flight in log.flights) > 200.0


@pytest.mark.parametrize("path", SITL, ids=name_of)
def test_against_the_truth(path):
    log, story = log_of(path), json.loads(path.with_suffix(".json").read_text())
    tables, truth, origin = log.tables, log.tables.truth, log.tables.origin
    assert math.degrees(origin.lat) == pytest.approx(story["home"]["lat"], abs=1e-6)
    assert origin.alt == pytest.approx(story["home"]["alt_amsl_m"], abs=0.3)

    # GPS: the simulated receiver errs by centimetres; a wrong lag would show as speed times lag (0.5 m at 5 m/s).
    fixes = tables.gps[tables.gps["lat"].notna()]
    at = sample(truth, fixes["t_valid"].to_numpy(), gap=0.05)
    known = np.isfinite(at).all(axis=1)
    place = pymap3d.geodetic2ned(
        fixes["lat"], fixes["lon"], fixes["alt"], origin.lat, origin.lon, origin.alt, deg=False
    )
    error = np.column_stack(place)[known] - at[known, :3]
    assert np.sqrt((error**2).mean(axis=0)).max() < 0.25
    velocity = fixes[["v_n", "v_e", "v_d"]].to_numpy()[known] - at[known, 3:6]
    assert np.sqrt((velocity**2).mean(axis=0)).max() < 0.12

    height = tables.baro["alt"].to_numpy() + sample(truth[["p_d"]], tables.baro.index.to_numpy(), gap=0.05)[:, 0]
    assert np.nanstd(height) < 0.2

    # ArduPilot's own EKF errs by a tenth of a degree in tilt, more in yaw.
    turned = sample(truth[["q_w", "q_x", "q_y", "q_z"]], tables.attitude.index.to_numpy(), gap=0.05)
    angles = euler_from_quat(turned)
    # Yaw is unknown until the filter aligns; in the air it is known.
    flying = tables.attitude.index > log.flights[0].start + 5.0
    tilt = np.degrees(wrap(tables.attitude.to_numpy() - angles))[flying]
    assert np.sqrt(np.nanmean(tilt**2, axis=0)) == pytest.approx(np.zeros(3), abs=3.0)
    assert np.sqrt(np.nanmean(tilt[:, :2] ** 2, axis=0)).max() < 0.3

    estimate = tables.ekf[["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]]
    error = estimate.to_numpy() - sample(truth[list(estimate)], estimate.index.to_numpy(), gap=0.05)
    assert np.sqrt(np.nanmean(error**2, axis=0)).max() < 0.3

    # Off the ground and on it again, within half a second.
    ground = [float(-truth["p_d"].iloc[0]), *([] if "truncated" in path.name else [float(-truth["p_d"].iloc[-1])])]
    ends = log.flights[0].start, log.flights[-1].stop
    for level, end, sign in zip(ground, ends, (1.0, -1.0), strict=False):
        outside, inside = -sample(truth[["p_d"]], end + sign * np.array([-0.5, 0.5]), gap=0.1)[:, 0] - level
        assert outside < 0.02 < inside
    assert len(log.flights) == sum(event == "armed" for _, event in story["events"])


@pytest.mark.parametrize("path", SITL, ids=name_of)
def test_motors_do_what_the_mixer_of_their_frame_asks(path):
    # Numbering, arms, spins and signs of the motor table at once: pulses fitted by the frame's factors give back
    # the rate controller's outputs. A swapped pair of motors breaks at least one axis.
    log = log_of(path)
    flight = log.flight
    pulses = log.tables.motors.loc[flight.start : flight.stop]
    asked = sample(log.tables.rates[["out_roll", "out_pitch", "out_yaw"]], pulses.index.to_numpy(), gap=0.02)
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in log.vehicle.motors])
    values = pulses.to_numpy() - pulses.to_numpy().mean(axis=1, keepdims=True)
    given = values @ np.linalg.pinv(factors).T
    known = np.isfinite(asked).all(axis=1)
    for axis in range(3):
        gain, correlation = _gain(asked[known, axis], given[known, axis])
        # The rate outputs have passed between two logged samples; the slower yaw shows them best.
        assert correlation > (0.8 if axis == 2 else 0.5)
        # 800 us of PWM for the whole range of thrust, a curve of half the slope or twice around hover.
        assert 300.0 < gain < 1600.0


def _gain(asked, given):
    covariance = np.cov(asked, given)
    return covariance[0, 1] / covariance[0, 0], covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1])


@pytest.mark.parametrize(
    "path", [path for path in LOGS if path.suffix == ".tlog" and path.parent.name == "sitl"], ids=name_of
)
def test_telemetry_agrees_with_the_log_of_the_same_flight(path):
    radio, card = log_of(path), log_of(path.with_suffix(".BIN"))
    # Both have the autopilot's clock.
    flight = card.flight
    t = np.arange(flight.start, flight.stop, 0.5)
    names = ["p_n", "p_e", "p_d", "v_n", "v_e", "v_d"]
    difference = sample(radio.tables.ekf[names], t, gap=1.0) - sample(card.tables.ekf[names], t, gap=1.0)
    # Linear interpolation over 0.25 s at 2 m/s^2, and the two filter cores.
    assert np.nanpercentile(np.abs(difference), 95.0, axis=0).max() < 0.3
    heights = sample(radio.tables.baro[["alt"]], t, gap=1.0) - sample(card.tables.baro[["alt"]], t, gap=1.0)
    assert np.nanstd(heights) < 0.6
    pulses = sample(radio.tables.motors, t, gap=1.0) - sample(card.tables.motors, t, gap=1.0)
    assert np.nanmedian(np.abs(pulses)) < 5.0
    assert radio.vehicle.motors == card.vehicle.motors
    (first, *_), (other, *_) = radio.flights, card.flights
    assert (first.start, first.stop) == pytest.approx((other.start, other.stop), abs=1.0)
