"""Drives, air and wind against published numbers; errors of the instruments."""

import dataclasses
import datetime as dt
import math

import numpy as np
import pytest

from simulation import elhesasy2024, fly
from simulation._kernels import actuator, drive_speed
from simulation.atmosphere import Atmosphere
from simulation.drive import Battery, Drive, FirstOrder, drive_parameters
from simulation.fly import Setup
from simulation.mission import CHIRP_AXES, FlownChirp, Mission, Wait
from simulation.place import Place, Wind
from simulation.sensors import Inertial, Navigation, Sensors

SEA = Place(name="sea", lat_deg=45.0, lon_deg=0.0, alt=0.0)
OCTA = elhesasy2024.octocopter()


def setup(*steps, **changes):
    mission = Mission(takeoff=3.0, steps=steps, disarmed=0.5, armed=0.5)
    return dataclasses.replace(Setup(mission=mission, place=SEA, vehicle=OCTA), **changes)


def test_bias_drift_is_gauss_markov_from_zero():
    inertial = Inertial(gyro_instability=2e-4, accel_instability=0.02, instability_time=50.0)
    drift = inertial.drift(400_000, 0.05, np.random.RandomState(3))
    assert np.array_equal(drift[0], np.zeros(6))
    # 20 000 s hold 200 spans of two correlation times: variances come out to 10 %, means to 7 % of a sigma.
    wander = drift - drift.mean(axis=0)
    assert wander[:, :3].std() == pytest.approx(2e-4, rel=0.1)
    assert wander[:, 3:].std() == pytest.approx(0.02, rel=0.1)
    lag = round(50.0 / 0.05)
    correlation = np.mean(wander[lag:] * wander[:-lag], axis=0) / wander.var(axis=0)
    assert correlation.mean() == pytest.approx(math.exp(-1.0), abs=0.1)
    assert not Inertial().drift(10, 0.05, np.random.RandomState(3)).any()


def test_chirp_sweeps_between_its_frequencies():
    """The phase's derivative is the stated frequency; the sine starts and ends at nothing."""
    chirp = FlownChirp("pitch", 0.1, start_hz=0.5, stop_hz=10.0, seconds=20.0, fade=2.0)
    t = np.linspace(0.0, chirp.duration, 200_001)
    signal = chirp.signal(t)
    assert chirp.hold == 4.0
    assert (chirp.frequency(t[:1])[0], chirp.frequency(t[-1:])[0]) == pytest.approx((0.5, 10.0))
    assert np.abs(signal).max() == pytest.approx(0.1, rel=1e-3)
    assert signal[[0, -1]] == pytest.approx([0.0, 0.0])
    crossings = t[1:][(signal[:-1] < 0.0) & (signal[1:] >= 0.0)]
    middle = 0.5 * (crossings[1:] + crossings[:-1])
    counted = 1.0 / np.diff(crossings)
    inside = (middle > 3.0) & (middle < 21.0)
    assert counted[inside] == pytest.approx(chirp.frequency(middle[inside]), rel=0.02)


@pytest.mark.parametrize("axis", CHIRP_AXES)
def test_chirps_move_their_axis_only(axis):
    chirp = FlownChirp(axis, 0.05, start_hz=1.0, stop_hz=4.0, seconds=5.0, fade=1.0)
    sure = Sensors(navigation=Navigation(position=0.0, velocity=0.0, tilt=0.0, yaw=0.0))
    flight = fly(setup(Wait(1), chirp, Wait(1), sensors=sure))
    ((start, flown),) = flight.reference.chirps
    during = flight.truth.loc[start + 1.0 : start + flown.duration]
    moved = during[["w_x", "w_y", "w_z"]].std().to_numpy()
    if axis == "throttle":
        assert during["a_d"].std() > 0.3
        assert moved.max() < 0.03
    else:
        assert moved.argmax() == CHIRP_AXES.index(axis)
        assert np.sort(moved)[-2] < 0.2 * moved.max()


def test_thrust_follows_the_curve_that_the_autopilot_inverts():
    """With MOT_THST_EXPO e: T / T_max = (1 - e) a + e a^2, and `actuator` is its inverse."""
    drive = Drive(speed_max=1000.0, response=FirstOrder(0.04), expo=0.65)
    numbers = drive_parameters(drive, Battery())
    for u in np.linspace(0.0, 1.0, 11):
        pwm = drive.pwm_at_zero_thrust + actuator(u, 0.65) * (drive.pwm_at_full_thrust - drive.pwm_at_zero_thrust)
        assert (drive.speed(pwm) / 1000.0) ** 2 == pytest.approx(u, abs=1e-12)
        assert drive_speed(pwm, 15.0, numbers) == pytest.approx(drive.speed(pwm, 15.0), rel=1e-12)
    assert drive.speed(1100.0) == 0.0
    assert drive.speed(2000.0) == 1000.0
    assert drive.speed(2000.0, 8.4) == 500.0


@pytest.mark.parametrize(
    ("altitude", "temperature", "pressure", "density"),
    # ISO 2533 / US Standard Atmosphere 1976, geopotential altitude.
    [(0, 288.15, 101325.0, 1.2250), (1000, 281.65, 89874.6, 1.11164), (5000, 255.65, 54019.9, 0.736116)],
)
def test_standard_atmosphere(altitude, temperature, pressure, density):
    for air, height in ((Atmosphere.standard(altitude), 0.0), (Atmosphere.standard(0.0), altitude)):
        assert air.temperature_at(height) == pytest.approx(temperature, rel=1e-6)
        assert air.pressure_at(height) == pytest.approx(pressure, rel=1e-5)
        assert air.density_at(height) == pytest.approx(density, rel=1e-5)


@pytest.mark.parametrize(("lat", "gravity"), [(0.0, 9.780325), (45.0, 9.806198), (80.0, 9.830617)])
def test_gravity_is_that_of_the_ellipsoid(lat, gravity):
    assert Place(name="x", lat_deg=lat, lon_deg=0.0, alt=0.0).gravity == pytest.approx(gravity, abs=5e-6)


def test_magnetic_field_of_zurich():
    """About 48.4 uT, dip 63.6 deg, declination 3.6 deg east in 2025 by the World Magnetic Model."""
    field = Place(name="Zurich", lat_deg=47.4, lon_deg=8.55, alt=488.0).magnetic_field(
        dt.datetime(2025, 3, 1, tzinfo=dt.UTC)
    )
    assert np.linalg.norm(field) == pytest.approx(48.4e-6, rel=0.01)
    assert math.degrees(math.atan2(field[1], field[0])) == pytest.approx(3.6, abs=0.4)
    assert math.degrees(math.atan2(field[2], np.hypot(field[0], field[1]))) == pytest.approx(63.6, abs=0.7)


def test_gusts_have_the_dryden_intensity_and_memory():
    """Long record: variance and, for the along-wind component, a correlation of 1/e after one time scale."""
    wind = Wind(speed=4.0, from_deg=180.0, height=20.0)
    sigma, length = wind.scales()
    dt = 0.05
    gusts = wind.sample(1_000_000, dt, np.random.RandomState(1)) - wind.mean
    # 50 000 s hold about 3000 independent spans of L/V = 15 s: standard deviations come out to 2 %.
    assert gusts.std(axis=0) == pytest.approx(sigma, rel=0.06)
    lag = round(length[0] / 4.0 / dt)
    along = gusts[:, 0]
    assert np.mean(along[lag:] * along[:-lag]) / along.var() == pytest.approx(math.exp(-1.0), abs=0.06)
