"""A motor that is weak from the beginning shows in roll, pitch and yaw together; a load to one side does not yaw."""

import numpy as np
import pytest

from logparse import MissingDataError, Vehicle
from sysid.rotors.motor_faults.trims import steady_trims, weak_from_start
from tests.sysid.failing_motor import Fault, craft, fly, remaining_thrust
from tests.sysid.trimmed_flights import REAL, trimmed

FRAMES = [("quad", "x"), ("hexa", "plus"), ("octa", "plus"), ("octa-quad", "x"), ("y6", "y6b")]
SECONDS = 40.0


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_a_motor_weak_from_the_beginning_is_named(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    motor = 1 + len(frame_class) % len(vehicle.motors)
    # 82 % of the signal above 1000 us: about a third of the thrust is missing.
    fault = Fault(motor, -1.0, 0.82)
    flown = [fly(vehicle, seed, fault, off=0.005) for seed in (3, 13)]
    trims = [steady_trims(tables, vehicle, 0.0, SECONDS) for tables in flown]
    # One flight alone names none: of one sound craft in thirty the trims are in a motor's proportion by chance.
    assert weak_from_start(trims[0], []) == ()
    (finding,) = weak_from_start(trims[0], trims[1:])
    assert (finding.id, finding.evidence["motor"]) == ("uneven-motor", f"m{motor}")
    assert finding.evidence["loss"] == pytest.approx(1.0 - remaining_thrust(flown[0], fault), abs=0.06)


@pytest.mark.parametrize(("frame_class", "frame_type"), FRAMES)
def test_sound_motors_raise_nothing_whatever_the_load(frame_class, frame_type):
    vehicle = craft(frame_class, frame_type)
    # Nothing; loads ahead, to one side and at a corner; motors twisted about their arms.
    for shift in (None, (0.0, 0.0, 0.1, 0.0), (0.0, 0.1, 0.0, 0.0), (0.0, 0.07, -0.07, 0.0), (0.0, 0.0, 0.0, 0.1)):
        flown = [fly(vehicle, seed, off=0.005, shift=shift) for seed in (4, 14)]
        trims = [steady_trims(tables, vehicle, 0.0, SECONDS) for tables in flown]
        assert weak_from_start(trims[0], trims[1:]) == ()


def test_readings_that_damage_made_do_not_count():
    vehicle = craft("quad", "x")
    tables = fly(vehicle, 4, off=0.005)
    clean = steady_trims(tables, vehicle, 0.0, SECONDS)
    tables.imu.iloc[[300, 500, 700], :4] = [[np.inf] * 4, [1e30] * 4, [np.nan] * 4]
    assert steady_trims(tables, vehicle, 0.0, SECONDS).trims == pytest.approx(clean.trims, abs=0.01)


def test_what_is_needed_is_said():
    tables = fly(craft("quad", "x"), 5, seconds=15.0)
    with pytest.raises(MissingDataError, match="too short"):
        steady_trims(tables, craft("quad", "x"), 0.0, 15.0)
    with pytest.raises(MissingDataError, match="frame"):
        steady_trims(tables, Vehicle(), 0.0, 15.0)


def test_a_hint_that_other_flights_do_not_bear_out_is_not_stated():
    """The last of three is trimmed as if m4 were weak, the others have no such pitch."""
    first, second, third = trimmed(*REAL)
    assert weak_from_start(third, [third])[0].evidence["motor"] == "m4"
    assert weak_from_start(third, [first, second]) == ()


def test_a_motor_that_is_weak_in_all_flights_or_became_weak_is_named():
    weak = trimmed((-0.15, -0.14, -0.16), (-0.12, -0.15, -0.14), (-0.16, -0.13, -0.15), variance=(2e-4,) * 3)
    (finding,) = weak_from_start(weak[0], weak[1:])
    assert (finding.evidence["motor"], finding.evidence["flights"]) == ("m4", 3)
    sound = trimmed((0.0, 0.0, 0.0), (0.01, 0.02, 0.01), variance=(2e-4,) * 3)
    assert weak_from_start(weak[0], sound)[0].evidence["motor"] == "m4"
