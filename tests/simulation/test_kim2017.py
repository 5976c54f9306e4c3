"""Kim 2017: bench tables, linear model, LQR gain and recovery against the printed numbers."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simulation import CASES, kim2017, propagate
from simulation.controllers import hover_linearisation


def model(voltage=16.0):
    return hover_linearisation(kim2017.quadcopter(voltage), kim2017.at_voltage(kim2017.TRIM_SPEEDS, voltage))


def test_input_matrix_is_eq_23_but_for_the_yaw_row():
    """Roll and pitch rows agree to the printed digits; the yaw row is printed 3.28 (feet per metre) times too large."""
    _, B = model()
    assert B[2:4] == pytest.approx(kim2017.PRINTED_INPUT[:2], abs=0.6e-4)
    assert kim2017.PRINTED_INPUT[2] / B[4] == pytest.approx(np.full(4, 1 / 0.3048), rel=0.02)


def test_linear_model_is_the_slope_of_the_nonlinear_one():
    """Angular acceleration after a microsecond with one rotor 1 rad/s faster, against the columns of B."""
    craft, trim = kim2017.quadcopter(), kim2017.at_voltage(kim2017.TRIM_SPEEDS, 16.0)
    _, B = model()

    def acceleration(speeds):
        start = np.concatenate((np.zeros(6), [1.0], np.zeros(6), speeds))
        end = propagate(craft, start, lambda t, x: speeds, 1e-6, dt=1e-6).iloc[-1]
        return end[["w_x", "w_y", "w_z"]].to_numpy() * 1e6

    for motor in range(4):
        step = np.eye(4)[motor]
        slope = (acceleration(trim + step) - acceleration(trim - step)) / 2.0
        assert slope == pytest.approx(B[2:, motor], rel=1e-4, abs=1e-8)


def test_gain_is_eq_25():
    """The unrounded model gives the printed gain to 0.2 % in angles and integrals, 0.6 % in roll and pitch rate.

    The yaw-rate column (0.3 to 0.5 in print) follows the yaw row of the model, and is printed to one digit.
    """
    ratio = kim2017.gain() / kim2017.PRINTED_GAIN
    assert ratio[:, [0, 1, 5, 6]] == pytest.approx(np.ones((4, 4)), abs=0.002)
    assert ratio[:, [2, 3]] == pytest.approx(np.ones((4, 2)), abs=0.006)
    assert kim2017.gain()[:, 4] == pytest.approx(kim2017.PRINTED_GAIN[:, 4], abs=0.05)


def test_recovery_levels_the_craft_and_lets_it_yaw():
    """Figure 12: roll and pitch go to zero, height to its target, and yaw turns on because nothing controls it."""
    flight = kim2017.recovery()
    attitude = Rotation.from_quat(flight[["q_x", "q_y", "q_z", "q_w"]].to_numpy()).as_euler("ZYX", degrees=True)
    assert attitude[0] == pytest.approx([0.0, 20.0, 20.0], abs=1e-6)
    after = flight.index > 3.0
    assert np.abs(attitude[after, 1:]).max() < 1.0
    assert np.abs(flight["p_d"][flight.index > 15.0]).max() < 0.03
    assert flight["w_z"].iloc[-1] > 0.5


def test_unstable_height_is_told_with_the_flight():
    outcome = CASES["kim-recovery"].run({"height_p": 80.0, "duration": 1.0})
    assert "height_p = 80" in outcome.fault
    assert "height_p = 80" in outcome.notes[0]
