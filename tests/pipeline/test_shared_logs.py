"""Logs flown by strangers: a result or a clear reason for every file, whatever is wrong with it."""

from pathlib import Path

import pytest

import reports
from pipeline import AnalysisConfig, FleetResult, analyze_fleet

REAL = Path(__file__).parents[2].parent / "shared" / "logs" / "real"

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not REAL.is_dir(), reason="needs the shared logs beside the project"),
]


@pytest.fixture(scope="module")
def fleet() -> FleetResult:
    # One pole is enough to take every stage; the fits themselves are tested with sysid.
    return analyze_fleet([REAL], AnalysisConfig(poles=1, zeros=0))


def test_every_log_has_a_result_or_a_reason(fleet):
    logs = [path for path in REAL.iterdir() if path.suffix.lower() in (".bin", ".log", ".tlog", ".ulg")]
    seen = {flight.log.path for flight in fleet.flights} | {failure.path for failure in fleet.failures}
    assert seen == set(logs)
    for failure in fleet.failures:
        assert len(failure.reason) > 20
        assert "unexpected" not in failure.reason


def test_no_log_meets_a_bug(fleet):
    met = {
        flight.name: finding.reason
        for flight in fleet.flights
        for finding in flight.findings
        if finding.id == "internal-error"
    }
    assert not met


def test_what_could_not_be_done_says_why(fleet):
    for flight in fleet.flights:
        for stage in ("flight", "trajectory", "experiment"):
            if getattr(flight, stage) is None and stage not in flight.missing:
                assert flight.missing, f"{flight.name} has no {stage} and gives no reason for anything"
        for model in flight.models:
            if model.model is None or model.validation is None:
                assert model.missing, f"{flight.name} has no {model.title} and gives no reason"


def test_the_report_holds_them_all(fleet, tmp_path):
    page = reports.write(fleet, tmp_path).read_text("utf-8")
    assert page.count("/report.html") >= len(fleet.flights)
    for failure in fleet.failures:
        assert failure.path.name in page
