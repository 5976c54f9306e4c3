"""What an analysis found in short: craft, day and what happened, read from its report when it is done."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from api.work.flown import best
from logparse import Vehicle
from pipeline.errors import ConfigError
from pipeline.results.answer import Tone
from pipeline.results.model_report import ModelInShort, ModelReport
from pipeline.results.report import FlightReport
from reports.numbers.reading import read_report

#: Worst first.
_TONES = (Tone.BAD, Tone.CARE, Tone.GOOD, Tone.UNKNOWN)


@dataclass(frozen=True, slots=True)
class Found:
    """One line of the list of analyses; fields are None where the logs do not tell."""

    craft: str | None = None
    flown: str | None = None  #: Day of the first flight, ISO 8601.
    health: str | None = None  #: What happened in a few words, of several flights in the worst.
    tone: str | None = None
    trust: str | None = None  #: The most that is said of a model.


def read_found(file: Path) -> Found:
    """Read a report.json; nothing where there is none, or it is of another kind or version."""
    try:
        report = read_report(file)
    except (OSError, ConfigError):
        return Found()
    flights = [report] if isinstance(report, FlightReport) else report.flights
    groups = [] if isinstance(report, FlightReport) else report.groups
    if not flights:
        flown = [craft for group in groups if (craft := _craft(group.vehicle))]
        return Found(craft=", ".join(flown)[:200] or None, trust=_trust([m for g in groups for m in g.models]))
    crafts = list(dict.fromkeys(craft for flight in flights if (craft := _craft(flight.vehicle))))
    days = sorted(flight.log.start_utc[:10] for flight in flights if flight.log.start_utc)
    lines = [
        line
        for flight in flights
        for line in (() if flight.answer is None else flight.answer.lines)
        if line.purpose == "Happened"
    ]
    worst = min(lines, key=lambda line: _TONES.index(line.tone), default=None)
    return Found(
        craft=", ".join(crafts)[:200] or None,
        flown=days[0] if days else None,
        health=None if worst is None else worst.word[:40],
        tone=None if worst is None else str(worst.tone),
        trust=_trust([model for each in (*flights, *groups) for model in each.models]),
    )


def _trust(models: Sequence[ModelReport | ModelInShort]) -> str | None:
    return str(best(models)) if models else None


def _craft(vehicle: Vehicle) -> str:
    """Name a craft: ``ArduCopter octa plus``."""
    parts = (vehicle.firmware or vehicle.autopilot, vehicle.frame_class, vehicle.frame_type)
    return " ".join(part for part in parts if part)
