"""Every flight of a log, and the part of a long one; called by its number, LOG#2."""

import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from logparse import LogError, Tables, read_flights, read_log
from pipeline.execution.stages import NEXT_FLIGHT, Overall
from pipeline.flight.account import account_of_flight
from pipeline.flight.training import LONGEST, busiest, part_findings
from pipeline.results.span import Span, around
from rotorid.cli.main import app
from rotorid.cli.options import open_log
from tests.paths import SAMPLES, SHARED, SITL

SAMPLE = SAMPLES / "octa01_zurich_calm.bin"

shared = pytest.mark.skipif(not SHARED.exists(), reason="needs the logs beside the repository")


def test_a_log_of_one_flight_is_that_log():
    (log,) = read_flights(SAMPLE)
    assert log.flight == read_log(SAMPLE).flight
    with pytest.raises(LogError, match="holds 1 flight, not 2"):
        log.of_flight(2)
    with pytest.raises(LogError, match="not 0"):
        log.of_flight(0)


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
        account = account_of_flight(log, Span(log.flight.start, log.flight.stop))
        blows.append([happening.t for happening in account.happenings if happening.id == "hard-landing"])
    assert [len(blow) for blow in blows] == [1, 0, 1]
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


# Models of a flight of hours are made of the half hour in which most was asked of the craft.


HOURS = Span(100.0, 100.0 + 5.0 * LONGEST)


def _log(chirps: pd.DataFrame | None = None) -> SimpleNamespace:
    """Return a flight that is steered everywhere, three times as much in the third half hour."""
    t = np.arange(HOURS.start, HOURS.stop, 0.1)
    size = np.where((t > 100.0 + 2.0 * LONGEST) & (t < 100.0 + 3.0 * LONGEST), 0.3, 0.1)
    angles = {name: size * np.sin(t + k) for k, name in enumerate(("roll", "pitch", "yaw"))}
    return SimpleNamespace(tables=Tables(setpoints=pd.DataFrame(angles, index=t), systemid=chirps))


def test_the_busiest_half_hour_is_taken_and_named() -> None:
    part = busiest(_log(), HOURS)
    assert part.stop - part.start == pytest.approx(LONGEST)
    assert part.start == pytest.approx(100.0 + 2.0 * LONGEST, abs=0.1 * LONGEST)
    (finding,) = part_findings(HOURS, part)
    assert finding.id == "part-excluded"
    assert "lasts 150 min" in finding.reason


def test_usual_flights_and_those_with_chirps_count_as_a_whole() -> None:
    usual = Span(100.0, 100.0 + LONGEST)
    assert busiest(_log(), usual) == usual
    assert part_findings(usual, usual) == ()
    assert busiest(_log(pd.DataFrame({"axis": [10.0]})), HOURS) == HOURS
    # Where neither targets nor attitude are logged it is the first half hour.
    assert busiest(SimpleNamespace(tables=Tables()), HOURS) == Span(100.0, 100.0 + LONGEST)


# LOG#2 on the command line: the second flight of a log, for commands that look at one flight.


TWO = SITL / "octa15_two_flights_logdisarmed.BIN"


@pytest.mark.skipif(not TWO.exists(), reason="needs the logs beside the repository")
def test_a_flight_is_chosen_by_its_number(capsys):
    first, second = (open_log(Path(f"{TWO}#{k}")) for k in (1, 2))
    assert first.flight.stop <= second.flight.start
    assert second.name == f"{TWO.name}#2"
    assert capsys.readouterr().err == ""
    longest = max(first.flight, second.flight, key=lambda flight: flight.duration)
    assert open_log(TWO).flight == longest
    assert "holds 2 flights" in capsys.readouterr().err
    with pytest.raises(LogError, match="holds 2 flights, not 3"):
        open_log(Path(f"{TWO}#3"))


@pytest.mark.skipif(not TWO.exists(), reason="needs the logs beside the repository")
def test_commands_take_the_flight(tmp_path):
    done = CliRunner().invoke(app, ["frequency", f"{TWO}#2", "--axis", "roll", "--json", "--out", str(tmp_path)])
    assert json.loads(done.stdout)["logs"] == [f"{TWO.name}#2"]
    done = CliRunner().invoke(app, ["inspect", f"{TWO}#2", "--json"])
    seen = json.loads(done.stdout)
    assert len(seen["flights"]) == 1
    assert all(table["start"] >= seen["flights"][0]["start"] for table in seen["tables"])
    done = CliRunner().invoke(app, ["analyze", f"{TWO}#3", "--out", str(tmp_path)])
    assert isinstance(done.exception, LogError)
    done = CliRunner().invoke(app, ["tune", f"{TWO}#1"])
    assert done.exit_code == 3
    assert "SYSTEMID" in done.output


def test_a_file_that_is_not_there_is_wrong_usage():
    for name in ("nowhere.bin", "nowhere.bin#1"):
        done = CliRunner().invoke(app, ["tune", name])
        assert done.exit_code == 2
        assert "does not exist" in done.output


def test_a_file_may_be_called_so(tmp_path):
    odd = tmp_path / "flight#7"
    odd.write_bytes(SAMPLE.read_bytes())
    assert open_log(odd).path == odd
