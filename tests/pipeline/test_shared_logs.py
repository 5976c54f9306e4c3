"""Logs flown by strangers: a result or a clear reason for every file, whatever is wrong with it."""

from pathlib import Path

import pytest

import reports
from pipeline import AnalysisConfig, FleetResult, analyze_fleet
from tests.forms import short_and_whole
from tests.paths import REAL

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not REAL.is_dir(), reason="needs the shared logs beside the project"),
]


def logs() -> list[Path]:
    paths = (path for path in REAL.iterdir() if path.suffix.lower() in (".bin", ".log", ".tlog", ".ulg"))
    return sorted(paths, key=lambda path: path.stat().st_size)


@pytest.fixture(scope="module", params=short_and_whole(slice(6), slice(0, None, 2)), ids=["small", "every second"])
def asked(request) -> list[Path]:
    """Return the smallest logs, or every second by size: what is told of each flight is looked at for all of them."""
    return logs()[request.param]


@pytest.fixture(scope="module")
def fleet(asked) -> FleetResult:
    # One pole, and rows no more often than needed, take every stage; the fits themselves are tested with sysid.
    return analyze_fleet(asked, AnalysisConfig(rate=10.0, poles=1, zeros=0), publish=reports.publish)


@pytest.fixture(scope="module")
def flights(fleet):
    """Return the numbers of every flight, by name."""
    return {flight.name: fleet.store.read_json(f"flights/{flight.folder}/report.json") for flight in fleet.flights}


def test_every_log_has_a_result_or_a_reason(fleet, asked):
    names = {Path(flight.source).name for flight in fleet.flights} | {failure.file for failure in fleet.failures}
    assert names == {path.name for path in asked}
    for failure in fleet.failures:
        assert len(failure.reason) > 20
        assert "unexpected" not in failure.reason


def test_no_log_meets_a_bug(flights):
    met = {
        name: finding["reason"]
        for name, flight in flights.items()
        for finding in flight["findings"]
        if finding["id"] == "internal-error"
    }
    assert not met


def test_what_could_not_be_done_says_why(flights):
    for name, flight in flights.items():
        for stage in ("flight", "trajectory"):
            assert flight[stage] is not None or flight["missing"].get(stage), f"{name} has no {stage} and no reason"
        for model in flight["models"]:
            if model["model"] is None or not model["rmse"]:
                assert model["missing"], f"{name} has no {model['title']} and gives no reason"


def test_the_report_holds_them_all(fleet):
    reports.write_fleet(fleet)
    page = fleet.store.read("report.html").decode()
    assert page.count("/report.html") >= len(fleet.flights)
    for failure in fleet.failures:
        assert failure.file in page
