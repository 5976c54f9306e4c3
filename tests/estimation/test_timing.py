"""Times of validity, integrals and noise of the IMU; attitude and the local frame against other people's code."""

from datetime import UTC, datetime

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.spatial.transform import Rotation

from core.attitude import error_rotation, euler_from_quat, matrix_from_quat, multiply, quat_from_euler
from estimation.place import ARDUPILOT_RADIUS, LocalFrame, world_field
from estimation.timing import InertialSignal, filter_delay, noise_density
from logparse import Geodetic
from logparse.craft.vehicle import is_simulated
from tests.timed import inertial


def test_increments_are_integrals_at_the_time_of_movement():
    """A sine seen 11 ms late through the filter is integrated where it happened, between any two times."""
    t = np.arange(0.0, 10.0, 0.02)
    w = 2.0 * np.pi * 1.5
    delay = filter_delay(20.0)
    wave = np.sin(w * (t - delay))[:, None] * np.array([1.0, 2.0, 3.0])
    parameters = {"INS_GYRO_FILTER": 20.0, "INS_ACCEL_FILTER": 20.0}
    signal = InertialSignal.of(inertial(t, wave, wave), parameters, (1e-4, 1e-3))
    at = np.array([2.0, 2.013, 2.5, 7.77])
    angle, velocity, _ = signal.increments(at)
    exact = (np.cos(w * at[:-1]) - np.cos(w * at[1:]))[:, None] / w * np.array([1.0, 2.0, 3.0])
    # Cubic splines at 13 samples a period: 1e-4 of the amplitude.
    np.testing.assert_allclose(angle, exact, atol=3e-5)
    np.testing.assert_allclose(velocity, exact, atol=3e-5)


@pytest.mark.parametrize(("cutoff", "rate"), [(0.0, 50.0), (20.0, 400.0)])
def test_noise_density_is_that_of_the_noise(cutoff, rate):
    """White noise of known density, filtered and sampled as an autopilot does, is found again within a fifth."""
    rng = np.random.default_rng(1)
    fine = 4000.0 if cutoff else rate
    density = np.array([2e-3, 0.05])
    noise = rng.normal(size=(int(100 * fine), 6)) * np.repeat(density, 3) * np.sqrt(fine)
    if cutoff:
        b, a = butter(2, cutoff, fs=fine)
        noise = lfilter(b, a, noise, axis=0)
    values = noise[:: round(fine / rate)]
    t = np.arange(len(values)) / rate
    sigma = np.sqrt(noise_density(t, values, (cutoff, cutoff), (1e-6, 1e-6)))
    np.testing.assert_allclose(np.median(sigma, axis=0), density, rtol=0.2)


def test_movement_that_is_too_fast_for_the_sampling_does_not_count_as_lasting_noise():
    """Steps of the rate every five seconds, through the autopilot's filter: the noise between them stays what it is."""
    rng = np.random.default_rng(3)
    fine, rate = 4000.0, 50.0
    density = np.array([6e-4, 0.02])
    noise = rng.normal(size=(int(100 * fine), 6)) * np.repeat(density, 3) * np.sqrt(fine)
    steps = np.repeat(rng.uniform(-1.0, 1.0, (20, 6)) * np.repeat([1.0, 5.0], 3), int(5 * fine), axis=0)
    b, a = butter(2, 20.0, fs=fine)
    values = lfilter(b, a, noise + steps, axis=0)[:: round(fine / rate)]
    measured = noise_density(np.arange(len(values)) / rate, values, (20.0, 20.0), (1e-6, 1e-6))
    np.testing.assert_allclose(np.median(measured, axis=0), density**2, rtol=0.2)
    # What the steps alias to is added where they are; all of their misfit would be ten times as much.
    assert (measured.mean(axis=0) < 2.5 * density**2).all()


ZURICH = Geodetic(np.radians(47.4), np.radians(8.5), 480.0)


def scalar_last(quat):
    return np.roll(quat, -1, axis=-1)


def test_attitude_is_scipys_yaw_pitch_roll():
    rng = np.random.default_rng(0)
    euler = rng.uniform([-3.0, -1.5, -3.0], [3.0, 1.5, 3.0], (50, 3))
    quat = quat_from_euler(*euler.T)
    theirs = Rotation.from_euler("ZYX", euler[:, ::-1])
    np.testing.assert_allclose(matrix_from_quat(quat), theirs.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(euler_from_quat(quat), euler, atol=1e-9)
    product = Rotation.from_quat(scalar_last(quat[0])) * Rotation.from_quat(scalar_last(quat[1]))
    np.testing.assert_allclose(matrix_from_quat(multiply(quat[0], quat[1])), product.as_matrix(), atol=1e-12)


def test_error_rotation_takes_the_estimate_to_the_truth():
    rng = np.random.default_rng(1)
    estimate = quat_from_euler(*rng.uniform(-1.0, 1.0, (3, 20)))
    phi = rng.normal(0.0, 0.2, (20, 3))
    true = np.roll((Rotation.from_rotvec(phi) * Rotation.from_quat(scalar_last(estimate))).as_quat(), 1, axis=-1)
    np.testing.assert_allclose(error_rotation(estimate, true), phi, atol=1e-12)
    np.testing.assert_allclose(error_rotation(estimate, -true), phi, atol=1e-12)


def test_the_simulator_of_the_firmware_lives_on_a_sphere():
    frame = LocalFrame.at(ZURICH, spherical=True)
    degree = np.radians(1.0)
    north = frame.to_ned(np.array([ZURICH.lat + degree]), np.array([ZURICH.lon]), np.array([480.0]))[0, 0]
    assert north == pytest.approx(111318.84502145034)
    assert pytest.approx(6378100.0, rel=1e-6) == ARDUPILOT_RADIUS
    assert is_simulated({"SIM_WIND_SPD": 0.0})
    assert not is_simulated({"SIMPLE": 1.0})


def test_gravity_and_longitude_across_the_date_line():
    # Somigliana at 45 degrees and sea level: 9.80620 m/s^2 (NIMA TR8350.2).
    assert LocalFrame.at(Geodetic(np.radians(45.0), 0.0, 0.0)).gravity == pytest.approx(9.80620, abs=1e-4)
    frame = LocalFrame.at(Geodetic(0.0, np.pi - 1e-6, 0.0))
    east = frame.to_ned(np.array([0.0]), np.array([-np.pi + 1e-6]), np.array([0.0]))[0, 1]
    assert east == pytest.approx(2e-6 * 6378137.0, rel=1e-6)


def test_world_field_has_the_published_value():
    """WMM2020 test value of NOAA: 80 N, 0 E, sea level, 2020.0: X 6570.4, Y -146.3, Z 54606.0 nT."""
    field = world_field(Geodetic(np.radians(80.0), 0.0, 0.0), {}, datetime(2020, 1, 1, tzinfo=UTC))
    np.testing.assert_allclose(field.ned * 1e9, [6570.4, -146.3, 54606.0], atol=1.0)
    assert field.declination_source == "WMM"
    declined = world_field(ZURICH, {"COMPASS_DEC": 0.05}, None)
    assert np.arctan2(declined.ned[1], declined.ned[0]) == pytest.approx(0.05)
    assert declined.declination_source == "COMPASS_DEC"


def test_the_simulator_of_the_firmware_has_the_field_of_the_autopilots_tables():
    """On a grid point the table is the model of its year; between, it is linear, and declination is what was logged."""
    corner = Geodetic(np.radians(40.0), np.radians(10.0), 0.0)
    simulated = {"SIM_WIND_SPD": 0.0}
    exact = world_field(corner, {}, datetime(2023, 1, 1, tzinfo=UTC))
    table = world_field(corner, simulated, datetime(2026, 1, 1, tzinfo=UTC))
    np.testing.assert_allclose(table.ned, exact.ned, atol=2e-8)
    assert table.declination_source == "autopilot table"
    sides = [world_field(Geodetic(corner.lat, np.radians(lon), 0.0), simulated, None).ned for lon in (10.0, 20.0)]
    middle = world_field(Geodetic(corner.lat, np.radians(15.0), 0.0), simulated, None).ned
    assert np.linalg.norm(middle) == pytest.approx(np.mean([np.linalg.norm(side) for side in sides]), rel=1e-6)
    field = world_field(ZURICH, {**simulated, "COMPASS_DEC": 0.05}, datetime(2026, 1, 1, tzinfo=UTC))
    assert np.arctan2(field.ned[1], field.ned[0]) == pytest.approx(0.05)
    for pole in (-90.0, 90.0):
        assert np.isfinite(world_field(Geodetic(np.radians(pole), np.pi, 0.0), simulated, None).ned).all()
