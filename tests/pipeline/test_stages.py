"""A stage may fail; the others go on, and the user learns why."""

import logging
from pathlib import Path

import pytest

import estimation
from logparse import FlightLog, MissingDataError, read_log
from pipeline.execution.progress import Clock
from pipeline.execution.stages import STAGES, Overall, Stages, silent
from pipeline.flight.analysis import analyze
from pipeline.flight.workload import expected_seconds
from pipeline.results.failure import Failure
from pipeline.results.span import Span


def test_a_foreseen_error_becomes_a_reason():
    stages = Stages(silent, 3600.0)

    def work(_):
        raise MissingDataError("no GPS: set bit 2 of LOG_BITMASK")

    assert stages.run("trajectory", work) == Failure("trajectory", "no GPS: set bit 2 of LOG_BITMASK")
    assert not stages.findings
    assert stages.timings["trajectory"] >= 0.0


def test_a_bug_becomes_a_finding_and_a_line_in_the_log(caplog):
    stages = Stages(silent, 3600.0)
    with caplog.at_level(logging.ERROR):
        assert "ZeroDivisionError" in stages.run("model", lambda _: 1 / 0).reason
    assert [finding.id for finding in stages.findings] == ["internal-error"]
    assert "Traceback" in caplog.text


@pytest.mark.parametrize("stage", ["tables", "flights"])
def test_a_bug_in_what_nothing_can_be_done_without_is_not_blamed_on_the_log(stage, monkeypatch):
    """An OverflowError in the reader once said that the log cannot be used."""

    def overflow(_):
        raise OverflowError("cannot convert float infinity to integer")

    monkeypatch.setattr(FlightLog, stage, property(overflow))
    if stage == "flights":
        monkeypatch.setattr(estimation, "estimate", lambda *_, **__: overflow(None))
    with pytest.raises(OverflowError, match="infinity"):
        analyze(sorted((Path(__file__).parents[2] / "sample_logs").glob("*.bin"))[0])


def test_a_stage_that_takes_too_long_is_given_up():
    stages = Stages(silent, 0.01)

    def work(report):
        while True:
            report("fit", 0.5)

    assert "--time-limit" in stages.run("model", work).reason


@pytest.mark.parametrize("pace", [0.5, 1.0, 4.0])
@pytest.mark.parametrize("wrong", [0.5, 1.0, 2.0])
def test_the_share_of_time_is_right_on_slow_and_fast_computers_and_with_a_stage_guessed_wrong(pace, wrong):
    clock, heard = [0.0], []
    report = Overall(lambda title, fraction: heard.append(fraction), loaded=0.7)
    takes = {"read": 0.1, "rotation": 1.0, "trajectory": 1.5 * wrong, "motors": 1.0, "rigid_body": 0.5, "report": 0.3}
    whole = pace * (0.7 + sum(takes.values()))
    shares = []
    for name, seconds in takes.items():
        for step in range(11):
            report(name, 0.1 * step)
            shares.append(0.7 * pace / whole + clock[0] / whole)
            clock[0] += pace * seconds / 10.0 if step < 10 else 0.0
        if name == "read":
            report.expect(takes | {"trajectory": 1.5})
    assert heard == sorted(heard)
    told = [(each, share) for each, share in zip(heard, shares, strict=True) if share > 0.2]
    assert all(share / 1.5 < each < share * 1.5 for each, share in told)
    assert heard[-1] == pytest.approx(1.0)


def test_what_a_log_lacks_is_not_waited_for():
    log = read_log("sample_logs/octa01_zurich_calm.bin")
    flight = Span(log.flight.start, log.flight.stop)
    seconds = expected_seconds(log, flight)
    assert seconds.keys() <= STAGES.keys()
    assert all(each > 0.0 for each in seconds.values())
    assert "motors" not in expected_seconds(log, Span(flight.start, flight.start + 10.0))
    assert expected_seconds(log, None).keys() == {"read", "tables", "account", "trajectory", "report"}


def test_the_time_to_go_is_right_for_even_work_whatever_came_before_it():
    clock = Clock()
    clock.reach(0.0, 7.0)
    clock.reach(0.02, 10.0)  # from here on 1 % a second; loading packages took ten
    for second in range(1, 98):
        clock.reach(0.02 + 0.01 * second, 10.0 + second)
        left = clock.left(10.0 + second)
        assert left == pytest.approx(98.0 - second, abs=1e-6) if second >= 10 else left == 0.0
    # It counts down while nothing new is heard, also where a stage is reported again.
    clock.reach(0.5, 108.5)
    assert clock.left(107.5) == pytest.approx(0.5, abs=1e-6)
    assert clock.left(200.0) == 0.0
