"""What was flown where, together, and which judging flights leave it."""

import dataclasses
import json
from math import pi

import numpy as np

from core.quantity import readable
from core.serialization import plain
from pipeline.fleet.envelope import envelope
from tests.pipeline.builders import covering, flown
from tests.pipeline.coverages import coverage_of

SLOW = np.linspace(0.0, 6.9, 1000)


def test_time_adds_up_over_flights():
    flights = [
        covering("a", ground_speed=SLOW),
        covering("b", ground_speed=SLOW + 2.0),
        covering("c", ground_speed=SLOW),
    ]
    found = envelope(flights, ["a", "b"], ["c"])
    speed = found.quantities["ground_speed"]
    assert sum(speed.training) == 200.0
    assert sum(speed.held_out) == 100.0
    assert speed.first == 0
    assert found.map.training == ((0, 1, 200.0),)
    assert [wind.part for wind in found.winds] == ["training", "training", "held-out"]
    edges = speed.step * (speed.first + np.arange(len(speed.training)))
    counts = np.histogram(np.concatenate([SLOW, SLOW + 2.0]), np.append(edges, edges[-1] + speed.step))[0]
    assert np.allclose(speed.training, counts / 10.0, atol=0.06)


def test_leaving_the_fitted_range_is_found_with_its_part_and_reach():
    fast = np.concatenate([np.full(700, 3.0), np.full(300, 14.5)])
    found = envelope([covering("a", ground_speed=SLOW), covering("b", ground_speed=fast)], ["a"], ["b"])
    (out,) = found.outside
    assert (out.flight, out.quantity, out.fitted) == ("b", "ground_speed", (0.0, 7.0))
    assert (out.part, out.reach) == (0.3, 14.5)
    (finding,) = found.findings
    assert finding.id == "outside-fitted-range"
    assert "ground speed up to 14.5 m/s (fitted to 7 m/s) for 30 % of its time" in finding.reason


def test_one_bin_beyond_or_a_blip_is_no_extrapolation():
    near = np.concatenate([np.full(700, 3.0), np.full(300, 7.5)])
    blip = np.concatenate([np.full(970, 3.0), np.full(30, 20.0)])
    flights = [covering("a", ground_speed=SLOW), covering("b", ground_speed=near), covering("c", ground_speed=blip)]
    assert not envelope(flights, ["a"], ["b", "c"]).outside


def test_a_blip_in_training_fits_nothing():
    """Half a per cent of training time is left out at either end: 0.3 s of 100 s at 20 m/s are no range."""
    training = np.concatenate([SLOW[:997], [20.0] * 3])
    fast = np.full(1000, 19.5)
    found = envelope([covering("a", ground_speed=training), covering("b", ground_speed=fast)], ["a"], ["b"])
    assert found.quantities["ground_speed"].fitted == (0.0, 7.0)
    assert found.outside[0].part == 1.0


def test_ranges_below_are_left_too_and_angles_are_told_in_degrees():
    flights = [
        covering("a", density=np.full(1000, 1.2), tilt=np.full(1000, 0.05)),
        covering("b", density=np.full(1000, 0.9), tilt=np.full(1000, 0.3)),
    ]
    found = envelope(flights, ["a"], ["b"])
    assert [out.quantity for out in found.outside] == ["density", "tilt"]
    assert "air density down to 0.9 kg/m^3 (fitted from 1.18 kg/m^3)" in found.findings[0].reason or (
        "air density down to 0.9 kg/m^3 (fitted from 1.2 kg/m^3)" in found.findings[0].reason
    )
    assert "tilt up to 17.2° (fitted to 5°)" in found.findings[0].reason
    assert readable("rad/s", pi / 6) == "30°/s"


def test_where_the_position_is_poor_nothing_is_called_extrapolation():
    lost = covering("b", ground_speed=np.full(900, 25.0))
    lost = dataclasses.replace(lost, coverage=coverage_of(lost.coverage, health={"position_sigma": {"max": 18.0}}))
    assert not envelope([covering("a", ground_speed=SLOW), lost], ["a"], ["b"]).outside


def test_how_far_is_told_by_what_was_flown_and_not_by_a_blip():
    mostly = np.concatenate([np.full(980, 12.5), np.full(20, 30.0)])
    found = envelope([covering("a", ground_speed=SLOW), covering("b", ground_speed=mostly)], ["a"], ["b"])
    assert found.outside[0].reach == 12.5
    assert readable("part of full thrust", 0.65) == "65 % of full thrust"


def test_flights_without_coverage_leave_no_trace_and_no_error():
    bare = flown("bare")
    assert envelope([bare], ["bare"], []) is None
    found = envelope([bare, covering("a", ground_speed=SLOW)], [], ["a", "bare"])
    assert found.held_out == ("a",)
    assert found.quantities["ground_speed"].fitted is None
    assert not found.outside
    json.dumps(plain(found), allow_nan=False)
