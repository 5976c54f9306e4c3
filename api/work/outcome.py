"""What an analysis found, as the list of analyses and the craft keep it: read from its results when it is done."""

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from core.serialization import plain, restored
from logparse import Vehicle
from pipeline.config import ConfigError
from pipeline.results.answer import Answer, AnswerLine, Tone
from pipeline.results.fleet import FlightEntry
from pipeline.results.model import ModelReport
from pipeline.results.report import FleetReport, FlightReport
from reports.report_json import read_report
from sysid.validation.uses import Trust, Verdict

#: The file of the results that holds the entries of flights for their craft; for the service only.
FILE = "flights.json"

#: Worst first, and best first.
_TONES = (Tone.BAD, Tone.CARE, Tone.GOOD, Tone.UNKNOWN)
_TRUST = (Trust.YES, Trust.LIMITED, Trust.NO, Trust.UNKNOWN)


@dataclass(frozen=True, slots=True)
class Reached:
    """How far an analysis is."""

    stage: str = ""
    progress: float = 0.0
    happened: str | None = None  #: In the flight, in a sentence; told before models are fitted.


@dataclass(frozen=True, slots=True)
class Flown:
    """A flight as its craft keeps it."""

    entry: FlightEntry
    answers: tuple[AnswerLine, ...] = ()
    trust: Trust = Trust.UNKNOWN  #: The most that is said of a model of it.


@dataclass(frozen=True, slots=True)
class Outcome:
    """One line of the list of analyses, and its flights; fields are None where the logs do not tell."""

    craft: str | None = None
    flown: str | None = None  #: Day of the first flight, ISO 8601.
    happened: str | None = None  #: In a sentence, of several flights in the worst.
    health: str | None = None  #: The same in a few words.
    tone: str | None = None
    trust: str | None = None  #: The most that is said of a model.
    flights: tuple[Flown, ...] = ()


def write_flights(entries: Iterable[FlightEntry], folder: Path) -> None:
    """Write the entries of flights into a folder of results."""
    (folder / FILE).write_text(json.dumps(plain(list(entries))), encoding="utf-8")


def read_outcome(folder: Path) -> Outcome:
    """Read a folder of results; nothing where there is no report, or it is of another kind or version."""
    try:
        report = read_report(folder / "report.json")
    except (OSError, ConfigError):
        return Outcome()
    flights: Sequence[FlightReport]
    flights = [report] if isinstance(report, FlightReport) else report.flights
    groups = report.groups if isinstance(report, FleetReport) else ()
    crafts = dict.fromkeys(name for flight in flights or groups if (name := _craft(flight.vehicle)))
    days = sorted(flight.log.start_utc[:10] for flight in flights if flight.log.start_utc)
    happened = [line for flight in flights for line in answers(flight) if line.purpose == "Happened"]
    worst = min(happened, key=lambda line: _TONES.index(line.tone), default=None)
    models = [model for flight in (*flights, *groups) for model in flight.models]
    return Outcome(
        craft=", ".join(crafts)[:200] or None,
        flown=days[0] if days else None,
        happened=None if worst is None else worst.text[:300],
        health=None if worst is None else worst.word[:40],
        tone=None if worst is None else str(worst.tone),
        trust=str(best(models)) if models else None,
        flights=tuple(_flights(folder, flights)),
    )


def _flights(folder: Path, reports: Sequence[FlightReport]) -> list[Flown]:
    """Read the entries that were handed over, with what the reports say of them; none where none were."""
    try:
        entries = restored(json.loads((folder / FILE).read_bytes()), list[FlightEntry])
    except (OSError, ValueError):
        return []
    said = {flight.name: flight for flight in reports}
    return [of_report(entry, said.get(entry.name)) for entry in entries]


@dataclass(frozen=True, slots=True)
class Judged:
    """Of a model in report.json, what its craft keeps."""

    verdict: Verdict


@dataclass(frozen=True, slots=True)
class Said:
    """Of report.json, what the craft of a flight keeps: of a thousand flights nobody waits for the rest."""

    answer: Answer | None
    models: tuple[Judged, ...]


def of_report(entry: FlightEntry, report: FlightReport | Said | None) -> Flown:
    """Return a flight with what its report says."""
    return Flown(entry) if report is None else Flown(entry, answers(report), best(report.models))


def without_experiments(flown: Sequence[Flown]) -> list[Flown]:
    """Return flights as no joint fit can use them: they were sampled at another rate than others."""
    return [replace(flight, entry=replace(flight.entry, experiments=())) for flight in flown]


def answers(report: FlightReport | Said) -> tuple[AnswerLine, ...]:
    """Return the first screen of a report."""
    return () if report.answer is None else tuple(report.answer.lines)


def best(models: Iterable[ModelReport | Judged]) -> Trust:
    """Return the most that is said of one of several models."""
    return min((model.verdict.trust for model in models), key=_TRUST.index, default=Trust.UNKNOWN)


def _craft(vehicle: Vehicle) -> str:
    """Name a craft: ``ArduCopter octa plus``."""
    parts = (vehicle.firmware or vehicle.autopilot, vehicle.frame_class, vehicle.frame_type)
    return " ".join(part for part in parts if part)
