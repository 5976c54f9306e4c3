"""Logs of a few words whose analysis hands a flight over to its craft, in place of the pipeline."""

import dataclasses
import json
from datetime import UTC, datetime, timedelta
from pathlib import Path

from api.work import outcome
from api.work.worker import Task, TaskProgress
from core.serialization import as_json
from logparse import LogError
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.report import FleetReport, FlightReport
from tests.pipeline.builders import flown as made_entry
from tests.pipeline.builders import stated
from tests.reports.made import made

#: When the first of these flights took off.
START = datetime(2025, 6, 1, 8, tzinfo=UTC)


def log(day: float | None, thrust: float = 8.5, craft: str = "octa", word: str = "yes", **facts: object) -> bytes:
    """Write a log: a flight on a day, with what it says of its thrust, and whether it was healthy."""
    return json.dumps({"day": day, "thrust": thrust, "craft": craft, "word": word, **facts}).encode()


def analyze(task: Task, progress: TaskProgress) -> None:
    """Hand flights over, or fit those of a craft jointly, as the files say."""
    progress("parsing", 0.0)
    if task.members:
        _join(task)
        return
    entries, reports = [], []
    for path, name in task.logs:
        content = path.read_bytes()
        try:
            facts = {"thrust": 8.5, "craft": "octa", "word": "yes", **json.loads(content)}
            start = None if facts["day"] is None else START + timedelta(days=facts["day"])
        except (ValueError, TypeError, KeyError) as error:
            raise LogError(f"{name} is no log of these tests") from error
        entry = made_entry(Path(name).stem, start=start, craft=facts["craft"], sha256=flown_digest(content))
        row = stated("thrust over mass", facts["thrust"], 0.03, "m/s^2")
        entries.append(dataclasses.replace(entry, parameters=(row,), build={"frame class": facts["craft"]}))
        tone = Tone.GOOD if facts["word"] == "yes" else Tone.BAD
        line = AnswerLine(purpose="Happened", word=facts["word"], tone=tone, text=facts.get("text", "No event."))
        trust = facts.get("trust", "no")
        model = {"verdict": {"trust": trust}}
        reports.append((Path(name).stem, {"lines": [line]}, model))
        if len(task.logs) > 1:
            own = task.folder / "flights" / entry.folder
            own.mkdir(parents=True)
            (own / "models.json").write_text(json.dumps({"alone": entry.name}))
            if "gains" in facts:
                (own / "proposed.param").write_text(facts["gains"])
        place = task.folder / f"experiments/motors/vehicle={entry.vehicle}/flight={entry.folder}/part.parquet"
        place.parent.mkdir(parents=True)
        place.write_bytes(b"PAR1" + content)
    name, answer, model = reports[0]
    log = {"sha256": entries[0].sha256}
    report = made(FlightReport, name=name, log=log, answer={"lines": answer["lines"]}, models=[model])
    (task.folder / "report.json").write_text(as_json(report))
    page = f"<!doctype html><title>report</title>SHA-256 {entries[0].sha256}"
    (task.folder / "report.html").write_text(page)
    (task.folder / "models.json").write_text(json.dumps({"of": name}))
    (task.folder / "models.mat").write_bytes(b"MATLAB")
    outcome.write_flights(entries, task.folder)


def flown_digest(content: bytes) -> str:
    """Return the digest of a log."""
    import hashlib

    return hashlib.sha256(content).hexdigest()


def _join(task: Task) -> None:
    for member in task.members:
        assert {kind: file.read_bytes()[:4] for kind, file in member.experiments.items()} == {"motors": b"PAR1"}
    names = [member.name for member in task.members]
    report = made(FleetReport, groups=[{"models": [{"verdict": {"trust": "yes"}}], "training": names}])
    (task.folder / "report.json").write_text(as_json(report))
    (task.folder / "report.html").write_text("<!doctype html><title>joint</title>")
    (task.folder / "models.json").write_text(json.dumps({"joint": names}))
    (task.folder / "sitl_frame.json").write_text(json.dumps({"mass": 4.3}))
