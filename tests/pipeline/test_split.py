"""The split into flights that train and flights that judge: what an engineer would ask of it, for any folder."""

import dataclasses
from collections import Counter
from datetime import UTC, datetime

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline import AnalysisConfig
from pipeline.fleet.homogeneity import day_of, places_of
from pipeline.fleet.split import MOST_JUDGING, MOST_TRAINING, choose_split
from pipeline.flight.training import excitation, position_sigma
from tests.pipeline.builders import flight, flown
from tests.pipeline.coverages import coverage_of

CONFIG = AnalysisConfig()


FLEETS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.floats(0.2, 5.0)), min_size=2, max_size=38).map(
    lambda flights: [flight(f"f{k:02d}", moves, day=d, place=p) for k, (d, p, moves) in enumerate(flights)]
)


@settings(max_examples=200, deadline=None)
@given(FLEETS)
def test_halves_are_even_at_every_place_on_every_day(flights):
    split = choose_split(flights, CONFIG)
    assert sorted((*split.training, *split.held_out)) == [entry.name for entry in flights]
    assert abs(len(split.training) - len(split.held_out)) <= 1
    places = places_of(flights)
    ahead = Counter()
    for entry in flights:
        ahead[places[entry.name], day_of(entry)] += 1 if entry.name in split.training else -1
    assert max(map(abs, ahead.values())) <= 1


@settings(max_examples=100, deadline=None)
@given(FLEETS, st.randoms(use_true_random=False))
def test_the_order_of_the_files_does_not_matter_and_the_liveliest_flight_trains(flights, random):
    split = choose_split(flights, CONFIG)
    best = max(excitation(entry) for entry in flights)
    assert any(excitation(entry) == best for entry in flights if entry.name in split.training)
    shuffled = list(flights)
    random.shuffle(shuffled)
    assert choose_split(shuffled, CONFIG) == split


def test_both_sides_cover_the_range_of_excitation():
    """Every flight on a day of its own at a place of its own: excitation alone decides. 30 fleets, unseen by design."""
    for seed in range(30):
        moves = np.random.default_rng(seed).lognormal(0.0, 0.7, 16)
        flights = [flight(f"f{k:02d}", float(m), day=k, place=k) for k, m in enumerate(moves)]
        split = choose_split(flights, CONFIG)
        order = sorted(flights, key=excitation)
        for quarter in range(4):
            part = [entry.name in split.training for entry in order[4 * quarter : 4 * quarter + 4]]
            assert 1 <= sum(part) <= 3, "neither side lacks a quarter of the range"


def test_two_flights_and_one():
    split = choose_split([flight("calm", 0.3), flight("lively", 2.0)], CONFIG)
    assert (split.training, split.held_out) == (("lively",), ("calm",))
    split = choose_split([flight("only")], CONFIG)
    assert (split.training, split.held_out) == (("only",), ())
    assert "no other is there to judge" in split.sentence


def test_poor_position_and_standing_still_never_train_and_say_why():
    flights = [flight("a", 0.06), flight("b", sigma=9.0), flight("c"), flight("d", 2.0)]
    split = choose_split(flights, CONFIG)
    assert split.training == ("d",)
    assert set(split.held_out) == {"a", "b", "c"}
    assert "its position is poor: the horizontal 1-sigma grows to 9.0 m" in split.never_train["b"]
    assert "hardly moves" in split.never_train["a"]
    assert "a never trains" in split.sentence
    assert "b never trains" in split.sentence


def test_what_was_not_measured_is_not_taken_for_perfect():
    """A flight whose coverage failed had a position sigma of 0 and trained."""
    failed = dataclasses.replace(flight("a", 9.0), coverage=None, missing={"coverage": "the log has a hole"})
    unsure = dataclasses.replace(
        flight("b", 9.0),
        coverage=coverage_of(flight("b").coverage, health={"position_sigma": {"median": None, "max": None}}),
    )
    loud = dataclasses.replace(
        flight("c"),
        coverage=coverage_of(flight("c").coverage, excitation={"acceleration_rms": 9.0, "acceleration_noise": None}),
    )
    split = choose_split([failed, unsure, loud, flight("d"), flight("e", 2.0)], CONFIG)
    assert split.training == ("e",)
    assert split.never_train == {
        "a": "how accurate its position is was not determined (the log has a hole)",
        "b": "how accurate its position is was not determined",
        "c": "how much it moves was not determined",
    }
    assert position_sigma(failed) is None
    assert excitation(failed) is None
    # Where nothing can train nothing does.
    split = choose_split([flight("a", 0.01), flight("b", 0.02)], CONFIG)
    assert split.training == ()
    assert split.held_out == ("a", "b")
    assert split.sentence.startswith("no flight can train: a never trains")


def many_flights():
    """Return 203 flights of 29 days at three places."""
    moved = np.random.default_rng(7).lognormal(0.0, 0.5, 203)
    return [flight(f"f{k:03d}", float(m), day=k // 7, place=k % 3) for k, m in enumerate(moved)]


def test_large_fleets_train_on_no_more_than_help():
    flights = many_flights()
    split = choose_split(flights, CONFIG)
    assert len(split.training) == MOST_TRAINING
    assert len(split.held_out) == 203 - MOST_TRAINING
    chosen = [entry for entry in flights if entry.name in split.training]
    assert max(map(excitation, flights)) == max(map(excitation, chosen))
    assert set(places_of(flights).values()) == {places_of(flights)[entry.name] for entry in chosen}
    assert len({day_of(entry) for entry in chosen}) >= MOST_TRAINING // 2
    assert "less than 2.5 %" in split.sentence


def test_large_fleets_are_judged_on_no_more_than_tell():
    """Free runs of a thousand flights took gigabytes, and tell the mean error no better."""
    flights = many_flights()
    split = choose_split(flights, CONFIG)
    assert len(split.judging) == MOST_JUDGING
    assert set(split.judging) < set(split.held_out)
    judges = [entry for entry in flights if entry.name in split.judging]
    assert {day_of(entry) for entry in judges} == {day_of(entry) for entry in flights}
    assert "judged on 100 of those held out" in split.sentence
    named = choose_split(flights, AnalysisConfig(training=("f00*",)))
    assert named.judging == named.held_out


def test_names_of_the_user_count():
    flights = [flight(name) for name in ("march1", "march2", "april1", "april2")]
    split = choose_split(flights, AnalysisConfig(training=("MARCH*",)))
    assert (split.training, split.held_out) == (("march1", "march2"), ("april1", "april2"))
    split = choose_split(flights, AnalysisConfig(validation=("april?",)))
    assert (split.training, split.held_out) == (("march1", "march2"), ("april1", "april2"))
    split = choose_split(flights, AnalysisConfig(training=("march1",), validation=("april*", "march1")))
    assert (split.training, split.held_out) == (("march1",), ("april1", "april2"))
    assert list(split.unused) == ["march2"]
    assert "by the user" in split.sentence


def test_a_day_is_that_of_the_sun_at_the_place():
    """23:30 UTC is the next morning in Sydney, and the same day in Zurich."""
    late = dataclasses.replace(flown("x", start=datetime(2024, 5, 2, 22, 30, tzinfo=UTC)), origin=(-0.59, 2.64, 0.0))
    assert day_of(late) == "2024-05-03"
    assert day_of(dataclasses.replace(late, origin=(0.83, 0.15, 0.0))) == "2024-05-02"


def test_flights_without_date_or_place_are_divided_all_the_same():
    measured = flight("measured").coverage
    bare = [dataclasses.replace(flown(f"f{k}", start=None), origin=None, track=(), coverage=measured) for k in range(5)]
    split = choose_split(bare, CONFIG)
    assert len(split.training) in (2, 3)
    assert not split.never_train
