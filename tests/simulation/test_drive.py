"""Drives and rotors against their closed forms."""

import numpy as np
import pytest

from simulation import elhesasy2024, propagate
from simulation._kernels import actuator, drive_speed
from simulation.drive import Battery, Drive, FirstOrder, drive_parameters

OCTA = elhesasy2024.octocopter()


def test_rotor_speed_steps_with_the_first_order_lag():
    start = np.zeros(13 + 8)
    start[6] = 1.0
    flight = propagate(OCTA, start, lambda t, x: np.full(8, 700.0), 0.2, gravity=0.0)
    expected = 700.0 * (1.0 - np.exp(-flight.index.to_numpy() / 0.04))
    assert np.abs(flight["w1"] - expected).max() < 1e-4


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
