"""What the stick may ask for: bounds from the craft's gain, the room of the mixer in hover and the rate loops."""

import math

import pytest

from core.parameter import Parameter
from logparse import read_log
from sysid.autopilot.gathering import feed_forward, gains_of_craft, stick_values
from sysid.loops.tuning import tune


@pytest.fixture(scope="module")
def chirped():
    log = read_log("sample_logs/quad02_delft_systemid.bin")
    tuning = tune(log)
    return tuning, gains_of_craft([log], tuning)


def test_an_acceleration_without_limit_gets_that_of_half_the_room(chirped):
    """In hover at 0.25 an axis' input has room for 0.5 of its full range."""
    flown = {"MOT_THST_HOVER": 0.25, "ATC_ACCEL_R_MAX": 1000.0, "ATC_ACCEL_P_MAX": 0.0, "ATC_INPUT_TC": 0.15}
    flown["ATC_ACC_P_MAX"] = 0.0  # in degrees: its name since 4.7
    sticks = {value.name: value for value in stick_values(*chirped, flown)}
    forward = {value.name: value for value in feed_forward(chirped[1], {})}
    gain = 1.0 / forward["ATC_RAT_PIT_D_FF"].proposed.value
    proposed = {name: value.proposed.value for name, value in sticks.items() if value.proposed.value is not None}
    most = 0.25 * gain * math.degrees(1.0)
    assert proposed == pytest.approx({"ATC_ACCEL_P_MAX": 100.0 * most, "ATC_ACC_P_MAX": most}, rel=1e-3)
    assert sticks["ATC_ACCEL_R_MAX"].right
    assert sticks["ATC_INPUT_TC"].right


def test_a_feed_forward_beyond_what_is_documented_says_so():
    """A craft of 21.5 rad/s^2 about yaw needs 0.047; ArduPilot documents 0 to 0.02."""
    gains = {"roll": Parameter(785.0, 12.0, "rad/s^2"), "yaw": Parameter(21.5, 0.9, "rad/s^2")}
    roll, yaw = (value.proposed for value in feed_forward(gains, {}))
    assert yaw.value == pytest.approx(1.0 / 21.5, rel=1e-3)
    assert "beyond the 0.02 that is documented" in yaw.reason
    assert "documented" not in roll.reason


def test_a_stick_sharper_than_the_rate_loops_is_softened(chirped):
    (stick,) = stick_values(*chirped, {"ATC_INPUT_TC": 0.01})
    assert stick.proposed.value == pytest.approx(0.5 / (math.pi * 3.0), rel=0.5)
