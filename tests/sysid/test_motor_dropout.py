"""Motors that drop out for moments are named with number and second; gusts, sticks and lasting losses are not."""

import pytest

from sysid.rotors.motor_faults import find_motor_faults
from tests.sysid.failing_motor import Fault, craft, fly

FRAMES = [("quad", "x"), ("hexa", "plus"), ("octa", "plus"), ("octa-quad", "x"), ("y6", "y6b")]


def dropouts_in(tables, vehicle, start, stop):
    return [one for one in find_motor_faults(tables, vehicle, start, stop) if one.kind == "pulse"]


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_dropouts_of_a_motor_are_named_with_its_number_and_their_seconds(frame_class, frame_type):
    """Half of the output lost for a second, three times: most are found, and none of another motor."""
    vehicle = craft(frame_class, frame_type)
    times = (11.3, 19.8, 28.4)
    count = 0
    for seed in range(12):
        motor = 1 + seed % len(vehicle.motors)
        tables = fly(vehicle, seed, *(Fault(motor, t, 0.5, t + 1.0) for t in times))
        for one in dropouts_in(tables, vehicle, 0.0, 40.0):
            assert one.motor == motor
            assert min(abs(one.t - t) for t in times) < 1.0
            assert 0.25 <= one.loss <= 1.0
            count += 1
    assert count >= 0.6 * 3 * 12  # 0.81 with six motors, more with others


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_sound_motors_in_gusts_drop_out_never(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    for seed in range(12):
        assert dropouts_in(fly(vehicle, 50 + seed, gust=0.01, drift=0.03), vehicle, 0.0, 40.0) == []


def test_a_lasting_loss_is_no_dropout():
    vehicle = craft("quad", "x")
    dropouts = dropouts_in(fly(vehicle, 5, Fault(2, 20.0, 0.6)), vehicle, 0.0, 40.0)
    assert all(one.t > 19.0 for one in dropouts)
    assert len(dropouts) < 2
