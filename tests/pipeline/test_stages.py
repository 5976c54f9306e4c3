"""A stage may fail; the others go on, and the user learns why."""

import logging
from pathlib import Path

import pytest

import estimation
from logparse import FlightLog, MissingDataError
from pipeline.execution.stages import STAGES, Stages, overall, silent
from pipeline.flight.analysis import analyze


def test_a_foreseen_error_becomes_a_reason():
    stages = Stages(silent, 3600.0)

    def work(_):
        raise MissingDataError("no GPS: set bit 2 of LOG_BITMASK")

    assert stages.run("trajectory", work) is None
    assert stages.missing == {"trajectory": "no GPS: set bit 2 of LOG_BITMASK"}
    assert not stages.findings
    assert stages.timings["trajectory"] >= 0.0


def test_a_bug_becomes_a_finding_and_a_line_in_the_log(caplog):
    stages = Stages(silent, 3600.0)
    with caplog.at_level(logging.ERROR):
        assert stages.run("model", lambda _: 1 / 0) is None
    assert "ZeroDivisionError" in stages.missing["model"]
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

    assert stages.run("model", work) is None
    assert "--time-limit" in stages.missing["model"]


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
