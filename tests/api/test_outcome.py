"""What the service reads of an analysis: the line of its list, and flights that their craft fits jointly."""

from pathlib import Path

import pytest

from api.work.outcome import Outcome, read_outcome
from api.work.worker import Member, Task, analyze_logs
from core.serialization import as_json, plain
from pipeline.results.report import FleetReport
from tests.paths import SAMPLES
from tests.reports.made import made


def flight(word: str, tone: str, day: str | None = "2026-03-14T09:00:00+00:00") -> dict[str, object]:
    return {
        "vehicle": {"firmware": "ArduCopter", "autopilot": "ArduPilot", "frame_class": "octa", "frame_type": "plus"},
        "log": {"start_utc": day},
        "answer": {
            "lines": [
                {"purpose": "Loops", "word": "slow", "tone": "bad"},
                {"purpose": "Happened", "word": word, "tone": tone, "text": f"{word}."},
            ]
        },
    }


def test_of_several_flights_the_worst_counts(tmp_path: Path) -> None:
    flights = [flight("yes", "good"), flight("no", "bad", "2026-01-02T00:00:00+00:00"), flight("mostly", "care", None)]
    (tmp_path / "report.json").write_text(as_json(made(FleetReport, flights=flights)))
    found = read_outcome(tmp_path)
    assert found == Outcome(craft="ArduCopter octa plus", flown="2026-01-02", happened="no.", health="no", tone="bad")


@pytest.mark.parametrize(
    "content", [None, "{", "[]", '{"kind": "flight"}', '{"kind": "fleet", "flights": [null]}', "\udc80"]
)
def test_what_cannot_be_read_gives_no_line(tmp_path: Path, content: str | None) -> None:
    if content is not None:
        (tmp_path / "report.json").write_bytes(content.encode("utf-8", "surrogatepass"))
    assert read_outcome(tmp_path) == Outcome()


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
