"""The pipeline itself hands flights over to their craft, and fits them jointly from what was handed over."""

from pathlib import Path

import pytest

from api.work.outcome import read_outcome
from api.work.worker import Member, Task, analyze_logs
from core.serialization import plain
from tests.api.programs import PROJECT

SAMPLES = PROJECT / "sample_logs"
#: Models of few parameters: what is tested is how they are handed over.
CHOSEN = {"poles": 1, "zeros": 0, "time_limit": 3600.0}


def member(name: str, folder: Path) -> Member:
    """Analyse a sample log as the service does, and take what it hands over."""
    results = folder / name
    results.mkdir()
    analyze_logs(Task([(SAMPLES / f"{name}.bin", f"{name}.bin")], CHOSEN, results), lambda *_: None)
    (flown,) = read_outcome(results).flights
    assert (flown.entry.name, flown.answers[0].purpose) == (name, "Happened")
    files = {path.parts[-4]: path for path in (results / "experiments").rglob("part.parquet")}
    assert set(files) == set(flown.entry.experiments)
    return Member(name, plain(flown.entry), files)


@pytest.mark.slow
def test_two_flights_are_fitted_jointly_from_what_they_handed_over(tmp_path: Path) -> None:
    members = [member(name, tmp_path) for name in ("octa01_zurich_calm", "octa03_quito_high")]
    results = tmp_path / "joint" / "results"
    results.mkdir(parents=True)
    chosen = {"flights": ["of the service"], "mass": 4.3, **CHOSEN}
    analyze_logs(Task([], chosen, results, members), lambda *_: None)
    assert {"report.html", "report.json", "models.json", "models.mat", "craft.json", "sitl_frame.json"} <= {
        path.name for path in results.iterdir()
    }, (results / "report.json").read_text("utf-8")[:4000]
    found = read_outcome(results)
    assert (found.craft, found.trust in ("yes", "limited", "no")) == ("ArduCopter octa plus", True)
