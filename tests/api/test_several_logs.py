"""Several logs in one analysis: what the service keeps of them, and what stays on the server."""

import json
from dataclasses import replace
from datetime import timedelta
from types import SimpleNamespace

from api.work import worker
from api.work.worker import Task, analyze_logs
from logparse import LogError
from pipeline.fleet import crafts, job
from tests.pipeline import flown
from tests.pipeline.builders import NOON
from tests.pipeline.builders import flown as flown_entry


def test_products_are_kept_and_places_on_the_server_are_not(tmp_path, monkeypatch):
    monkeypatch.setattr(job, "analyze_flights", flown.analyze_flights)
    monkeypatch.setattr(crafts, "identify_craft", flown.identify_craft)
    logs = []
    for number in (1, 2):
        log = tmp_path / "secret-place" / str(number) / f"flight{number}.bin"
        log.parent.mkdir(parents=True)
        log.write_text(f"octa {number}")
        logs.append((log, log.name))
    told = []
    results = tmp_path / "results"
    analyze_logs(Task(logs, {"poles": 1, "zeros": 0}, results), lambda stage, fraction: told.append(fraction))
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
    assert told == sorted(told)


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
        found = {file.parent.name: file.read_text("utf-8") for file in files}
        for file in files:
            file.unlink()
        return found

    assert proposed("a-1", "a-2", "calm", "gone") == {"f1": "a-2+a-1"}
    assert proposed("a-1", "b-2", "weak") == {"f1": "b-2"}
    assert proposed("calm", "weak") == {}
