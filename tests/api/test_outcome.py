"""What the service reads and keeps of an analysis: the line of its list, joint fits, products, gains."""

import json
from dataclasses import replace
from datetime import timedelta
from pathlib import Path
from types import SimpleNamespace

import pytest

from api.work import worker
from api.work.outcome import Outcome, read_outcome
from api.work.worker import Member, Task, analyze_logs
from core.serialization import as_json, plain
from logparse import LogError
from pipeline.fleet import crafts, job
from pipeline.results.report import FleetReport
from tests.paths import SAMPLES
from tests.pipeline import flown
from tests.pipeline.builders import NOON
from tests.pipeline.builders import flown as flown_entry
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
    outcome = read_outcome(tmp_path)
    assert outcome == Outcome(craft="ArduCopter octa plus", flown="2026-01-02", happened="no.", health="no", tone="bad")


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


@pytest.mark.whole
def test_two_flights_are_fitted_jointly_from_what_they_handed_over(tmp_path: Path) -> None:
    members = [member(name, tmp_path) for name in ("octa01_zurich_calm", "octa03_quito_high")]
    results = tmp_path / "joint" / "results"
    results.mkdir(parents=True)
    chosen = {"flights": ["of the service"], "mass": 4.3, **CHOSEN}
    analyze_logs(Task([], chosen, results, members), lambda *_: None)
    assert {"report.html", "report.json", "models.json", "models.mat", "craft.json", "sitl_frame.json"} <= {
        path.name for path in results.iterdir()
    }, (results / "report.json").read_text("utf-8")[:4000]
    outcome = read_outcome(results)
    assert (outcome.craft, outcome.trust in ("yes", "limited", "no")) == ("ArduCopter octa plus", True)


def test_products_are_kept_and_places_on_the_server_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr(job, "analyze_flights", flown.analyze_flights)
    monkeypatch.setattr(crafts, "identify_craft", flown.identify_craft)
    logs = []
    for number in (1, 2):
        log = tmp_path / "secret-place" / str(number) / f"flight{number}.bin"
        log.parent.mkdir(parents=True)
        log.write_text(f"octa {number}")
        logs.append((log, log.name))
    fractions = []
    results = tmp_path / "results"
    analyze_logs(Task(logs, {"poles": 1, "zeros": 0}, results), lambda stage, fraction: fractions.append(fraction))
    files = {path.relative_to(results).as_posix() for path in results.rglob("*") if path.is_file()}
    assert {"report.html", "report.json", "models.json", "rmse.csv"} <= files
    assert {f"flights/flight{number}/report.html" for number in (1, 2)} <= files
    assert "plotly.min.js" not in files, "the sandbox of reports lets no script be fetched"
    assert b'id="plotly"' in (results / "flights/flight1/report.html").read_bytes()
    assert any(name.startswith("tables/trajectory/") and name.endswith(".parquet") for name in files)
    assert not [name for name in files if b"secret-place" in (results / name).read_bytes()]
    assert not [name for name in files if name.rpartition("/")[2].startswith((".", "entry", "manifest"))]
    numbers = json.loads((results / "report.json").read_text("utf-8"))
    assert [flight["name"] for flight in numbers["flights"]] == ["flight1", "flight2"]
    assert fractions == sorted(fractions)


def test_gains_come_from_all_flights_with_chirps_or_the_newest_that_supports_some_alone(tmp_path, monkeypatch):
    """Chirps of two flights are one proposal; of flights with other settings the newest that supports one counts."""

    def tune(logs):
        names = [log.name for log in ([logs] if isinstance(logs, SimpleNamespace) else logs)]
        settings = {name.split("-")[0] for name in names}
        refused = "settings differ" if len(settings) > 1 else "too weak" if "weak" in settings else None
        loop = None if "calm" in settings else "identified"
        text = "+".join(names)
        axes = [SimpleNamespace(loop=loop)]
        return SimpleNamespace(refused=refused, axes=axes, proposed_file=lambda: text, rollback_file=lambda: "back")

    def read(source):
        if source == "gone":
            raise LogError("cannot be read")
        return (SimpleNamespace(name=source),)

    monkeypatch.setattr("sysid.loops.tune", tune)
    monkeypatch.setattr("logparse.read_flights", read)

    def proposed(*sources):
        entries = [
            replace(flown_entry(f"f{k}", start=NOON + timedelta(days=k)), source=source)
            for k, source in enumerate(sources)
        ]
        for entry in entries:
            (tmp_path / "flights" / entry.folder).mkdir(parents=True, exist_ok=True)
        worker._propose_of_crafts(entries, tmp_path)
        files = list(tmp_path.rglob("proposed.param"))
        texts = {file.parent.name: file.read_text("utf-8") for file in files}
        for file in files:
            file.unlink()
        return texts

    assert proposed("a-1", "a-2", "calm", "gone") == {"f1": "a-2+a-1"}
    assert proposed("a-1", "b-2", "weak") == {"f1": "b-2"}
    assert proposed("calm", "weak") == {}
