"""A motor that is weak from the beginning shows in roll, pitch and yaw together; a load to one side does not yaw."""

import pytest

from logparse import MissingDataError, Vehicle
from sysid.rotors.steady_imbalance import weak_from_start
from tests.sysid.failing_motor import Fault, craft, fly, remaining_thrust

FRAMES = [("quad", "x"), ("hexa", "plus"), ("octa", "plus"), ("octa-quad", "x"), ("y6", "y6b")]
SECONDS = 40.0


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_a_motor_weak_from_the_beginning_is_named(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    motor = 1 + len(frame_class) % len(vehicle.motors)
    # 82 % of the signal above 1000 us: about a third of the thrust is missing.
    fault = Fault(motor, -1.0, 0.82)
    tables = fly(vehicle, 3, fault, off=0.005)
    (finding,) = weak_from_start(tables, vehicle, 0.0, SECONDS)
    assert (finding.id, finding.evidence["motor"]) == ("uneven-motor", f"m{motor}")
    assert finding.evidence["loss"] == pytest.approx(1.0 - remaining_thrust(tables, fault), abs=0.06)


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_sound_motors_raise_nothing_whatever_the_load(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    # Nothing; loads ahead, to one side and at a corner; motors twisted about their arms.
    for shift in (None, (0.0, 0.0, 0.1, 0.0), (0.0, 0.1, 0.0, 0.0), (0.0, 0.07, -0.07, 0.0), (0.0, 0.0, 0.0, 0.1)):
        tables = fly(vehicle, 4, off=0.005, shift=shift)
        assert weak_from_start(tables, vehicle, 0.0, SECONDS) == ()


def test_what_is_needed_is_said():
    tables = fly(craft("quad", "x"), 5, seconds=15.0)
    with pytest.raises(MissingDataError, match="too short"):
        weak_from_start(tables, craft("quad", "x"), 0.0, 15.0)
    with pytest.raises(MissingDataError, match="frame"):
        weak_from_start(tables, Vehicle(), 0.0, 15.0)
