"""Every flight of a log: found over all power-ups, analysed with its own events, called by its number."""

from pathlib import Path

import pytest

from logparse import LogError, read_flights, read_log
from pipeline.execution.stages import NEXT_FLIGHT, Overall
from pipeline.flight.account import tell
from pipeline.results.span import Span, around

SHARED = Path(__file__).parents[3] / "shared" / "logs"
SAMPLE = Path(__file__).parents[2] / "sample_logs" / "octa01_zurich_calm.bin"

shared = pytest.mark.skipif(not SHARED.exists(), reason="needs the logs beside the repository")


def test_a_log_of_one_flight_is_that_log():
    (log,) = read_flights(SAMPLE)
    assert log.flight == read_log(SAMPLE).flight
    with pytest.raises(LogError, match="holds 1 flight, not 2"):
        log.of_flight(2)
    with pytest.raises(LogError, match="not 0"):
        log.of_flight(0)


@shared
def test_flights_of_one_power_up_share_what_was_read():
    first, second = read_flights(SHARED / "sitl" / "octa15_two_flights_logdisarmed.BIN")
    assert first.flights == second.flights == (first.flight, second.flight)
    assert first.tables is second.tables
    assert first.messages is second.messages


@shared
def test_flights_of_several_power_ups_come_in_the_order_of_the_file():
    logs = read_flights(SHARED / "real" / "pypi-fasttlogparser__pymavlink_flight.tlog")
    assert len(logs) == 11
    places = [(log.boot.start, log.flight.start) for log in logs]
    assert places == sorted(places)
    assert len({log.boot for log in logs}) == 2


@shared
def test_a_blow_is_told_of_the_flight_that_it_ended():
    """The first and the third flight end with a blow of 8 g; only the second, the longest, was looked at once."""
    logs = read_flights(SHARED / "real" / "erlerobot-logs__6-3-2014_7.BIN")
    blows = []
    for log in logs:
        account = tell(log, Span(log.flight.start, log.flight.stop))
        blows.append([each.t for each in account.happenings if each.id == "hard-landing"])
    assert [len(each) for each in blows] == [1, 0, 1]
    assert blows[2][0] == pytest.approx(256.1, abs=0.5)


def test_the_ground_between_flights_belongs_to_the_nearer():
    flights = (Span(10.0, 20.0), Span(30.0, 50.0), Span(70.0, 80.0))
    assert around(flights[0], flights).stop == around(flights[1], flights).start == 25.0
    assert around(flights[1], flights).stop == 60.0
    assert around(flights[2], flights).stop == float("inf")


def test_the_bar_goes_on_over_flights():
    seen = []
    report = Overall(lambda title, fraction: seen.append(fraction))
    for _ in range(2):
        report(NEXT_FLIGHT, 0.5)
        report("tables", 0.0)
        report("report", 0.0)
    assert seen == sorted(seen)
    assert seen[1] < 0.5 < seen[2] < seen[3] < 1.0
