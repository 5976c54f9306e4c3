"""How long machine access takes to answer on a store of 1,000 flights of five craft: over HTTP, and of a folder.

Every flight is that of a sample log under another name and on another day, with its parameters scattered by their own
errors, so that entries and reports have the size and shape of real ones.
"""

import dataclasses
import random
import tempfile
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np
from fastapi.testclient import TestClient

import pipeline
import reports
from api import Settings, create_app
from api.machine.folder_library import FolderLibrary
from api.machine.tools import Tools
from api.work.craft_flights import keep
from api.work.flown import Flown
from benchmarks._measure import SAMPLES, Row, row
from core.serialization import as_json
from pipeline.results.entry import FlightEntry
from pipeline.storage.manifest import MANIFEST
from pipeline.storage.store import FolderStore
from reports.numbers.reading import read_report

FLIGHTS, CRAFT, CALLS = 1000, 5, 300


def run() -> list[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        entries = _fly(folder / "out")
        served = _over_http(folder, entries)
        read = _of_folder(folder / "out", entries)
    return [
        row(f"questions over HTTP on {FLIGHTS} flights, 95 % of calls below", f"{served:.2f} s", goal="2 s"),
        row(f"questions of a folder of {FLIGHTS} flights, 95 % of calls below", f"{read:.2f} s", goal="2 s"),
    ]


def _fly(out: Path) -> list[FlightEntry]:
    """Analyse a log, and make a folder of many flights of it."""
    log = SAMPLES / "octa01_zurich_calm.bin"
    pipeline.analyze_fleet([log], pipeline.AnalysisConfig(), None, None, store=out, publish=reports.write)
    (first,) = (out / "flights").iterdir()
    entry = FolderStore(out).read_as(f"flights/{first.name}/entry.json", FlightEntry)
    assert entry is not None
    report = (first / "report.json").read_bytes()
    chance = np.random.default_rng(20261122)
    entries = []
    for number in range(FLIGHTS):
        name = f"flight{number:04d}"
        rows = tuple(dataclasses.replace(p, value=chance.normal(p.value, p.sigma)) for p in entry.parameters)
        start = datetime(2024, 1, 1, tzinfo=UTC) + timedelta(hours=7 * number)
        craft = f"craft{number % CRAFT}"
        made = dataclasses.replace(
            entry, name=name, folder=name, sha256=name, start_utc=start, craft=craft, vehicle=craft, parameters=rows
        )
        (out / "flights" / name).mkdir()
        (out / "flights" / name / "report.json").write_bytes(report)
        (out / "flights" / name / "entry.json").write_text(as_json(made))
        entries.append(made)
    return entries


def _over_http(folder: Path, entries: Sequence[FlightEntry]) -> float:
    """Return the time within which 95 % of calls are answered, s."""
    report = read_report(folder / "out" / "flights" / entries[0].folder)
    answers = report.answer.lines if report.answer is not None else ()
    (folder / "out" / MANIFEST).unlink()  # else the service brought the folder's flights too
    app = create_app(Settings(data=folder / "data", out=folder / "out"))
    with app.state.parts.database.write() as session:
        for entry in entries:
            place = (None, None, f"flights/{entry.folder}")
            keep(session, "", f"{int(entry.name[6:]):032x}", Flown(entry, answers), place)
    with TestClient(app, base_url="http://localhost") as client:
        began = time.perf_counter()
        crafts = client.get("/api/v1/crafts").json()["items"]
        while not all(each["current"] for each in crafts) and time.perf_counter() - began < 120.0:
            time.sleep(0.5)
            crafts = client.get("/api/v1/crafts").json()["items"]

        def ask(question: str, named: dict[str, Any]) -> None:
            client.get(f"/api/v1/questions/{_PATHS[question]}", params=named).raise_for_status()

        return _p95(ask, [each["id"] for each in crafts])


def _of_folder(out: Path, entries: Sequence[FlightEntry]) -> float:
    tools = Tools(FolderLibrary(out))

    def ask(question: str, named: dict[str, Any]) -> None:
        getattr(tools, question)(**named)

    return _p95(ask, [f"craft{number}" for number in range(CRAFT)])


_PATHS = {
    "list_flights": "flights",
    "list_craft": "craft",
    "get_answers": "answers",
    "get_parameters": "parameters",
    "get_margins": "margins",
    "get_health": "health",
    "get_predictions": "predictions",
    "get_changes": "changes",
    "compare": "comparison",
    "what_to_fly": "advice",
}


def _p95(ask: Callable[[str, dict[str, Any]], None], crafts: Sequence[str]) -> float:
    chance = random.Random(7)
    took: dict[str, list[float]] = {}
    for _ in range(CALLS):
        question = chance.choice(list(_PATHS))
        flight, other = (f"flight{chance.randrange(FLIGHTS):04d}" for _ in range(2))
        named: dict[str, Any] = {"flight": flight}
        if question == "list_flights":
            named = {"limit": 1000}
        elif question == "list_craft":
            named = {}
        elif question == "get_changes" or (question == "get_parameters" and chance.random() < 0.5):
            named = {"craft": chance.choice(crafts)}
        elif question == "compare":
            named = {"before": flight, "after": other}
        began = time.perf_counter()
        ask(question, named)
        took.setdefault(question, []).append(time.perf_counter() - began)
    for question, times in sorted(took.items()):
        print(f"  {question:16} median {np.median(times):6.3f} s, worst {max(times):6.3f} s")
    return float(np.quantile([each for times in took.values() for each in times], 0.95))
