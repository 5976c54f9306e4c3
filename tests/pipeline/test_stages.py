"""A stage may fail; the others go on, and the user learns why."""

import logging
from pathlib import Path

import pytest

import estimation
from logparse import FlightLog, MissingDataError
from pipeline.execution.progress import Clock
from pipeline.execution.stages import STAGES, Stages, overall, silent
from pipeline.flight.analysis import analyze
from pipeline.results.failure import Failure


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


def test_progress_names_the_stage():
    seen = []
    Stages(lambda stage, fraction: seen.append((stage, fraction)), 3600.0).run(
        "read", lambda report: report("inner", 0.5)
    )
    assert seen == [("read", 0.0), ("read", 0.5), ("read", 1.0)]


def test_overall_progress_only_grows():
    seen = []
    report = overall(lambda _, fraction: seen.append(fraction))
    for stage in STAGES:
        for fraction in (0.0, 0.5, 1.0):
            report(stage, fraction)
    assert seen == sorted(seen)
    assert seen[0] == 0.0
    assert abs(seen[-1] - 1.0) < 1e-9


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


def test_stages_that_come_for_each_kind_of_model_do_not_move_the_bar():
    seen = []
    report = overall(lambda title, fraction: seen.append(fraction))
    for name, fraction in (("motors", 1.0), ("validation", 1.0), ("orders", 1.0), ("experiment", 1.0), ("mixer", 0.0)):
        report(name, fraction)
    assert len(set(seen)) == 1
    assert sum(stage.share for stage in STAGES.values()) == pytest.approx(1.0)
