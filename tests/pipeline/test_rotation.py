"""What one flight tells of how its craft turns: margins judged by their numbers, kept, and never an error."""

from dataclasses import replace

import pytest

import logparse
from pipeline.flight.next_flights import for_flight
from pipeline.flight.rotation import find_rotation
from pipeline.results.failure import Failure
from pipeline.results.rotation import LoopState, state_of
from pipeline.results.span import Span
from tests.pipeline.builders import margins, turning
from tests.reports.conftest import made_flight

SQUARE = "sample_logs/octa08_denver_square.bin"


@pytest.mark.parametrize(
    ("computed", "state"),
    [
        (margins(9.0, 60.0), LoopState.GOOD),
        (margins(5.9, 60.0), LoopState.THIN),
        (margins(9.0, 44.0), LoopState.THIN),
        (margins(None, 44.0), LoopState.THIN),
        (margins(None, 60.0), LoopState.UNKNOWN),
        (margins(9.0, 60.0, stable=False), LoopState.UNSTABLE),
        # Stable at the best estimate, unstable for a fifth of what the data leave possible: not to be relied on.
        (margins(9.0, 60.0, unstable=0.2), LoopState.THIN),
    ],
)
def test_margins_are_judged_by_their_numbers(computed, state):
    assert state_of(computed) is state


def test_an_ordinary_flight_tells_roll_and_pitch_and_why_not_yaw():
    log = logparse.read_log(SQUARE)
    found = find_rotation(log, Span(log.flight.start, log.flight.stop))
    axes = {axis.axis: axis for axis in found.axes}
    assert axes["roll"].determined
    assert axes["pitch"].determined
    assert not axes["yaw"].determined
    assert "short stick inputs" in axes["yaw"].reason
    assert all("SYSTEMID" in axis.loop_reason for axis in found.axes)


def test_only_the_sound_part_counts():
    log = logparse.read_log(SQUARE)
    start, stop = log.flight.start, log.flight.start + 40.0
    found = find_rotation(log, Span(start, stop))
    for axis in found.axes:
        if axis.rate is not None:
            assert axis.rate.seconds <= stop - start
    short = find_rotation(log, Span(start, start + 5.0))
    assert not short.determined
    assert all("s in the air" in axis.reason for axis in short.axes)


def test_advice_names_bits_and_axes():
    flight = replace(made_flight("a", seed=1, fit=False), rotation=turning(margins(9.0, 60.0)))
    advice = {each.id: each for each in for_flight(flight)}
    assert "SID_AXIS 11 for pitch and 12 for yaw" in advice["chirps-for-margins"].do
    assert "bit 12 (PID)" in advice["chirps-for-margins"].do
    without = for_flight(replace(flight, rotation=Failure("rotation", "no rates")))
    assert "chirps-for-margins" not in {each.id for each in without}


@pytest.mark.parametrize(
    ("gain", "phase", "state"),
    [
        ((6.5, 9.0), (46.0, 60.0), LoopState.GOOD),
        ((5.0, 9.0), (46.0, 60.0), LoopState.UNKNOWN),
        ((3.0, 5.5), (40.0, 60.0), LoopState.THIN),
        (None, (46.0, 60.0), LoopState.UNKNOWN),
    ],
)
def test_margins_of_ordinary_flying_say_only_what_the_whole_interval_says(gain, phase, state):
    bounds = {name: each for name, each in (("gain_db", gain), ("phase_deg", phase)) if each is not None}
    computed = replace(margins(7.0, 50.0), intervals=bounds)
    assert state_of(computed, ordinary=True) is state


def test_firmware_without_the_mode_is_not_told_to_fly_it(monkeypatch):
    log = logparse.read_log(SQUARE)
    monkeypatch.setitem(vars(log), "vehicle", replace(log.vehicle, firmware="ArduCopter", version="3.3-dev"))
    found = find_rotation(log, Span(log.flight.start, log.flight.stop))
    assert all("3.3-dev" in axis.loop_reason and "SYSTEMID" not in axis.loop_reason for axis in found.axes)
