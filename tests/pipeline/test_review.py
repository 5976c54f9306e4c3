"""A craft looked at after each flight: alarms keep to their rate over its whole life, what changed is named."""

import dataclasses
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from pipeline.fleet.review import review
from pipeline.results.drift import CraftNote
from tests.pipeline.builders import START, hovering
from tests.pipeline.histories import flights_of, series

NOW = datetime(2027, 1, 1, tzinfo=UTC)


def alerts_of_a_life(flights):
    """Look after every flight, as the service does; every alert once."""
    counts = {}
    for count in range(1, len(flights) + 1):
        for alert in review(flights[:count], now=NOW).alerts:
            counts.setdefault(alert.about, alert)
    return counts


def test_of_honest_histories_below_1_percent_raise_an_alarm():
    """Each is looked at after each of its 4 to 16 flights: the chance of any alarm at all is bounded by RATE.

    At that rate one set of 100 in fifty has more than three.
    """
    random = np.random.default_rng(20261122)
    lives = (alerts_of_a_life(flights_of(series(random, int(random.integers(4, 17))))) for _ in range(100))
    assert sum(bool(life) for life in lives) <= 3


@pytest.mark.parametrize("frame", ["quad", "octa"])
def test_a_motor_that_loses_3_percent_over_ten_flights_is_named(frame):
    """0.33 % a flight, seen by trims that scatter by 0.2 % between flights: no trim alone is that sure."""
    for seed in range(3):
        flights = hovering(np.random.default_rng(seed), frame, 10, weak=3, loss=0.03 / 9.0, scatter=0.002)
        alerts = [alert for alert in review(flights, now=NOW).alerts if alert.id == "motor-weakening"]
        assert alerts
        assert "motor m3 is weakening" in alerts[-1].text


def test_motors_whose_trims_only_scatter_raise_nothing():
    """Trims of which one scatters ten times as much as the others: looked at after each of 4 to 12 flights."""
    random = np.random.default_rng(31)
    lives = (hovering(random, "octa", 12, scatter=np.array([0.0005, 0.0005, 0.005])) for _ in range(6))
    assert not any(alerts_of_a_life(life) for life in lives)


def test_one_strange_flight_is_named_by_its_band():
    values = series(np.random.default_rng(1), 12)
    value, sigma = values["thrust over mass"][-1]
    values["thrust over mass"][-1] = (value * 0.8, sigma)
    (alert,) = review(flights_of(values), now=NOW).alerts
    assert (alert.id, alert.flight, alert.about) == ("parameter-outside", "f11", "outside|thrust over mass|f11")
    assert "±" in alert.text


def test_a_note_parts_the_flights_and_the_change_is_told():
    """New propellers before the seventh flight: no alarm of drift, but the difference with its error."""
    flights = flights_of(series(np.random.default_rng(5), 12, step=("thrust over mass", 0.68)))
    note = CraftNote(at=START + timedelta(days=5, hours=12), text="new propellers", boundary=True)
    reviewed = review(flights, [note], now=NOW)
    assert reviewed.boundary == note
    assert reviewed.pooled == tuple(f"f{k:02d}" for k in range(6, 12))
    assert reviewed.alerts == ()
    changed = [change for change in reviewed.since if change.significant]
    assert [change.parameter for change in changed] == ["thrust over mass"]
    assert abs(changed[0].difference - 0.68) < 3.0 * changed[0].difference_sigma
    assert reviewed.whole is not None
    assert len(reviewed.whole.flights) == 12
    mark = dataclasses.replace(note, boundary=False)
    assert review(flights, [mark], now=NOW).pooled == reviewed.whole.flights


def test_flights_that_come_out_of_order_or_with_a_clock_of_1980_find_their_place():
    flights = flights_of(series(np.random.default_rng(2), 6))
    unset = dataclasses.replace(flights[3], start_utc=datetime(1980, 1, 6, tzinfo=UTC))
    came = [flights[2], unset, flights[0], flights[1], flights[5], flights[4]]
    reviewed = review(came, now=NOW)
    assert reviewed.flights == ("f00", "f01", "f02", "f03", "f04", "f05")
    assert reviewed.remarks == ("the clock of f03 was not set: placed in the order in which the logs came",)
    none = [dataclasses.replace(flight, start_utc=None) for flight in came]
    assert review(none, now=NOW).flights == tuple(sorted(flight.name for flight in came))


def test_a_flight_that_came_twice_counts_once_and_two_craft_with_one_board_are_seen():
    flights = flights_of(series(np.random.default_rng(2), 5))
    copy = dataclasses.replace(flights[2], name="f02 (2)", format="tlog")
    reviewed = review([*flights, copy], now=NOW)
    assert reviewed.flights == ("f00", "f01", "f02", "f03", "f04")
    assert reviewed.remarks == ("1 of the logs is a further recording of flights that are here",)
    # Two craft with one board are seen by their clocks.
    far = dataclasses.replace(flights[1], name="other", sha256="other", origin=(0.5, 0.5, 0.0))
    (remark,) = review([*flights, far], now=NOW).remarks
    assert "f01 and other were in the air at the same time" in remark


def test_another_scaling_of_commands_is_not_pooled():
    flights = flights_of(series(np.random.default_rng(2), 5))
    built = {**flights[0].build, "spin_min": 0.2}
    flights[3:] = [dataclasses.replace(flight, build=built) for flight in flights[3:]]
    reviewed = review(flights, now=NOW)
    assert reviewed.pooled == ("f03", "f04")
    assert "3 of the flights were flown with another build" in reviewed.remarks[0]
