"""Which logs belong together, and which must not be counted twice."""

import dataclasses
from datetime import UTC, datetime, timedelta

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from logparse import Motor, Vehicle
from pipeline.flight.craft import build_of, by_craft, changes, fingerprint, kept_apart, same_flight, tune_of
from pipeline.results.span import Span
from tests.pipeline.builders import NOON, OCTA, flown


@pytest.mark.parametrize(
    ("other", "same"),
    [
        (flown("telemetry", form="tlog", start=NOON + timedelta(seconds=1)), True),
        (flown("copy", sha256="a", start=datetime(2020, 1, 1, tzinfo=UTC)), True),
        # Simulators fly faster than the clock, so that their flights overlap in time.
        (flown("elsewhere", lat=0.8001), False),
        (flown("next", start=NOON + timedelta(minutes=2)), False),
    ],
    ids=lambda case: getattr(case, "name", ""),
)
def test_the_same_flight_is_known_by_its_content_or_by_place_and_time(other, same):
    assert same_flight(flown("a"), other) is same


def test_flights_of_one_simulated_place_and_time_are_told_by_their_clocks():
    """Chirps on one axis after the other, each flown by one script from one place, passed for copies of one log."""
    roll, pitch = flown("a"), flown("b")
    assert pitch.flight is not None
    assert same_flight(roll, pitch)  # cut or thinned, of the same boot
    pitch = dataclasses.replace(pitch, flight=Span(pitch.flight.start + 0.045, pitch.flight.stop - 0.25))
    assert not same_flight(roll, pitch)
    assert same_flight(roll, dataclasses.replace(pitch, format="tlog"))  # of another clock


def test_crafts_are_kept_apart_and_flights_without_motors_or_position_left_out():
    bare = dataclasses.replace(flown("d", lat=0.3), experiments=())
    drifted = dataclasses.replace(flown("e", lat=0.4), position_known=False)
    crafts = by_craft([flown("c", craft="quad", lat=0.1), flown("b"), flown("a", lat=0.2), bare, drifted])
    assert [[flight.name for flight in craft] for craft in crafts] == [["c"], ["a", "b"]]


def test_board_ids_tell_twins_apart_but_not_in_a_simulator():
    twins = [dataclasses.replace(OCTA, board_id=board) for board in ("one", "two")]
    assert len({fingerprint(twin, {}, simulated=False) for twin in twins}) == 2
    assert len({fingerprint(twin, {}, simulated=True) for twin in twins}) == 1
    # Tuning tells them apart where no board id does.
    gains = [{"ATC_RAT_RLL_P": 0.135}, {"ATC_RAT_RLL_P": 0.4}]
    assert len({fingerprint(OCTA, gain, simulated=False) for gain in gains}) == 2
    known = dataclasses.replace(OCTA, board_id="one")
    assert len({fingerprint(known, gain, simulated=False) for gain in gains}) == 1, "tuning must not split a craft"


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 6), st.integers(0, 2), st.sampled_from(["dataflash", "tlog"])), min_size=1, max_size=8
    )
)
def test_of_any_flights_each_is_kept_once(flights):
    """Starts 20 s apart overlap by more than half; places 1e-4 rad apart are 600 m apart. Compared pair by pair."""
    entries = [
        flown(f"{k}", start=NOON + timedelta(seconds=20 * when), lat=0.8 + 1e-4 * where, form=form)
        for k, (when, where, form) in enumerate(flights)
    ]
    kept = [flight for craft in by_craft(entries) for flight in craft]
    for flight in entries:
        assert flight in kept or any(_reached(flight, other, entries) for other in kept)
    for a in kept:
        assert not any(same_flight(a, b) for b in kept if a is not b)


def _reached(flight, other, entries):
    """Whether two recordings are the same flight, directly or through others."""
    names, new = {flight.name}, [flight]
    while new:
        at = new.pop()
        for entry in entries:
            if entry.name not in names and same_flight(at, entry):
                names.add(entry.name)
                new.append(entry)
    return other.name in names


def test_a_changed_tune_is_said_between_the_flights_where_it_changed():
    days = [NOON + timedelta(days=k) for k in range(3)]
    gains = [{"ATC_RAT_RLL_P": p, "ATC_RAT_PIT_P": 0.135, "firmware": "ArduCopter 4.5.7"} for p in (0.135, 0.135, 0.18)]
    flights = [
        flown(f"{k}", start=day, board="x", tune=gain) for k, (day, gain) in enumerate(zip(days, gains, strict=True))
    ]
    (change,) = changes(flights[::-1])
    assert (change.id, change.evidence["before"], change.evidence["after"]) == ("tune-changed", "1", "2")
    assert "ATC_RAT_RLL_P 0.135 → 0.18" in change.reason
    assert not changes(flights[:2])
    # What a log lacks did not change.
    assert not changes([flown("a", tune={"PSC_VELXY_P": 2.0}), flown("b", tune={})])


def test_a_changed_thrust_curve_keeps_flights_apart_and_says_so():
    other = dataclasses.replace(OCTA, thrust_expo=0.5)
    boarded = [dataclasses.replace(vehicle, board_id="x") for vehicle in (OCTA, other)]
    prints = [fingerprint(vehicle, {}, simulated=False) for vehicle in boarded]
    assert len(set(prints)) == 2
    flights = [
        flown("a", board="x", craft=prints[0]),
        flown("b", board="x", craft=prints[1], vehicle=other, lat=0.1),
        flown("c", board="y", craft="another", lat=0.2),
    ]
    why = kept_apart(by_craft(flights))
    (reason,) = why[prints[0]]
    assert "thrust_expo 0.65 → 0.5" in reason.reason
    assert "b" in reason.reason
    assert not why["another"]


def test_what_is_learned_in_flight_is_no_change_of_tune():
    logged = {
        "ATC_RAT_RLL_P": 0.1,
        "MOT_THST_HOVER": 0.3,
        "INS_GYROFFS_X": 0.01,
        "WPNAV_SPEED": 500.0,
        "PSC_VELXY_P": 2.0,
    }
    vehicle = Vehicle(firmware="ArduCopter", version="4.5.7", motors=(Motor(1, 1, 0.0, 1, 0, 0.0, 0.0, 0.0),))
    assert tune_of(vehicle, logged) == {"ATC_RAT_RLL_P": 0.1, "PSC_VELXY_P": 2.0, "firmware": "ArduCopter 4.5.7"}
    assert build_of(vehicle)["motors"] == 1
