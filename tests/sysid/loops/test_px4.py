"""PX4's rate controller: responses are those of the recursion, settings those of a log; nothing is proposed."""

import numpy as np
import pytest
from scipy.signal import lfilter

from logparse import read_log
from sysid.loops import LoopError, design, read_settings, tune
from sysid.loops.controller import AngleController, GyroPath, LoopSettings, RateController
from sysid.loops.filters import low_pass_alpha, second_order
from tests.paths import REAL

CONTROLLER = RateController(P=0.15, I=0.2, D=0.003, FF=0.05, K=1.3, FLTD=30.0, of_target=0.0, loop_rate=800.0)


@pytest.fixture(scope="module")
def log():
    path = REAL / "PX4-flight-review-rs__gps_interference.ulg"
    if not path.exists():
        pytest.skip("../shared/logs/real is not here")
    return read_log(path)


def run(c: RateController, target: np.ndarray, rate: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Run the recursion from rest; torque and the part of it that is the integral."""
    error, alpha = target - rate, low_pass_alpha(c.loop_rate, c.FLTD)
    change = lfilter([alpha], [1.0, alpha - 1.0], np.diff(rate, prepend=rate[:1]) * c.loop_rate)
    integral = c.K * c.I * np.cumsum(error) / c.loop_rate
    return c.K * (c.P * error - c.D * change) + integral + c.FF * target, integral


@pytest.mark.parametrize("which", ["rate", "target"])
def test_responses_are_those_of_the_recursion(which):
    """An impulse through the recursion, transformed, at frequencies at which it has died out but for the integral."""
    n = 8000
    impulse = np.zeros(n)
    impulse[1] = 1.0  # after a sample at rest, from which the derivative is taken
    rest = np.zeros(n)
    total, integral = run(CONTROLLER, impulse, rest) if which == "target" else run(CONTROLLER, rest, impulse)
    hz = np.array([0.7, 3.0, 12.0, 45.0])
    turning = np.exp(-2j * np.pi * np.outer(hz, np.arange(n) - 1) / 800.0)
    # What the integral keeps goes on for ever: a geometric series.
    step = integral[-1]
    tail = step * np.exp(-2j * np.pi * hz * (n - 1) / 800.0) / (1.0 - np.exp(-2j * np.pi * hz / 800.0))
    torque = turning @ total + tail
    wanted = CONTROLLER.target_response(hz) if which == "target" else -CONTROLLER.error_response(hz)
    np.testing.assert_allclose(torque, wanted, rtol=1e-6)


def test_the_torque_of_yaw_has_its_own_filter():
    yaw = RateController(P=0.2, I=0.0, D=0.0, output_filter=2.0, loop_rate=800.0)
    assert abs(yaw.error_response(np.array([2.0]))[0]) == pytest.approx(0.2 / np.sqrt(2.0), rel=0.02)


def test_other_gains_keep_the_names_of_px4():
    settings = LoopSettings("roll", CONTROLLER, AngleController(P=6.5), GyroPath(40.0, 8000.0), autopilot="PX4")
    changed = settings.changed(P=0.1, gyro_filter=60.0)
    assert changed.parameters()["MC_ROLLRATE_P"] == 0.1
    assert changed.parameters()["MC_ROLLRATE_K"] == 1.3
    assert changed.parameters()["IMU_GYRO_CUTOFF"] == 60.0
    hz = np.array([5.0, 20.0])
    np.testing.assert_allclose(changed.gyro.response(hz), second_order(8000.0, 60.0).response(hz))


def test_settings_of_a_real_log(log):
    settings = read_settings(log, "roll")
    given = settings.parameters()
    assert given["MC_ROLLRATE_P"] == pytest.approx(0.0386804, rel=1e-5)
    assert given["IMU_DGYRO_CUTOFF"] == 30.0
    assert settings.controller.loop_rate == 800.0
    assert {name: log.parameters[name] for name in given} == given


def test_nothing_is_proposed_or_designed_for_px4(log):
    assert "PX4" in tune(log).refused
    assert "PX4" in design(log, "rates").refused


def test_another_px4_is_a_sentence(log):
    old = read_log(REAL / "PX4-pyulog__sample_appended_multiple.ulg")
    with pytest.raises(LoopError, match=r"1\.6"):
        read_settings(old, "roll")


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_torques_that_a_real_flight_logged_are_those_of_the_controller(log, axis):
    """Torque over error, rate of change and integral: the gains of the parameters, where the target stood still.

    Rows come every 20 ms, the loop ran at 800 Hz: where the target moves, the one that counted is not logged.
    """
    k = ("roll", "pitch").index(axis)
    rates, targets, torques = (
        log.messages[f"vehicle_{name}"] for name in ("angular_velocity", "rates_setpoint", "torque_setpoint")
    )
    t = torques.index.to_numpy()
    rows = np.searchsorted(rates["timestamp_sample"], torques["timestamp_sample"]).clip(0, len(rates) - 1)
    same = rates["timestamp_sample"].to_numpy()[rows] == torques["timestamp_sample"].to_numpy()
    latest = (np.searchsorted(targets.index, t, side="right") - 1).clip(1, len(targets) - 2)
    target = targets[axis].to_numpy()
    still = np.abs(np.diff(target, prepend=target[0], append=target[-1])).reshape(-1)
    still = np.maximum(still[:-1], still[1:])[latest] < 0.02
    kept = same & still & (t > log.flight.start + 2.0) & (t < log.flight.stop - 2.0)
    status = log.messages["rate_ctrl_status"]
    integral = np.interp(t, status.index, status[f"{axis}speed_integ"])
    error = target[latest] - rates[f"xyz[{k}]"].to_numpy()[rows]
    terms = np.column_stack([error, -rates[f"xyz_derivative[{k}]"].to_numpy()[rows], integral])[kept]
    torque = torques[f"xyz[{k}]"].to_numpy()[kept]
    gains = np.linalg.lstsq(terms, torque, rcond=None)[0]
    controller = read_settings(log, axis).controller
    assert kept.sum() > 100
    assert gains[0] == pytest.approx(controller.P, rel=0.12)  # what is left of the target's movement lowers it
    assert gains[1:] == pytest.approx([controller.D, 1.0], rel=0.05)
    assert np.corrcoef(terms @ [controller.P, controller.D, 1.0], torque)[0, 1] > 0.95
