"""What an analysis found in short: craft, day and health, read from its report when it is done."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

#: Worst first.
_TONES = ("bad", "care", "good", "unknown")


@dataclass(frozen=True, slots=True)
class Found:
    """One line of the list of analyses; fields are None where the logs do not tell."""

    craft: str | None = None
    flown: str | None = None  #: Day of the first flight, ISO 8601.
    health: str | None = None  #: The answer in a word or two, of several flights the worst.
    tone: str | None = None


def read_found(file: Path) -> Found:
    """Read a report.json; nothing where there is none, or it is of another kind."""
    try:
        report = json.loads(file.read_text("utf-8"))
        flights = report["flights"] if report["kind"] == "fleet" else [report]
        crafts = list(dict.fromkeys(craft for flight in flights if (craft := _craft(flight["vehicle"]))))
        days = sorted(flight["log"]["start_utc"][:10] for flight in flights if flight["log"]["start_utc"])
        lines = [line for flight in flights for line in lines_of(flight["answer"]) if line["purpose"] == "Healthy"]
    except (OSError, ValueError, KeyError, TypeError):
        return Found()
    worst = min(lines, key=lambda line: _TONES.index(line["tone"]) if line["tone"] in _TONES else 9, default=None)
    return Found(
        craft=", ".join(crafts)[:200] or None,
        flown=days[0] if days else None,
        health=None if worst is None else str(worst["word"])[:40],
        tone=None if worst is None else str(worst["tone"])[:10],
    )


def _craft(vehicle: dict[str, Any]) -> str:
    """Name a craft: ``ArduCopter octa plus``."""
    parts = (vehicle["firmware"] or vehicle["autopilot"], vehicle["frame_class"], vehicle["frame_type"])
    return " ".join(part for part in parts if part)


def lines_of(answer: Any) -> list[dict[str, Any]]:
    """Return the lines of an answer, which a folder's report keeps without the rest."""
    lines = answer["lines"] if isinstance(answer, dict) else answer
    return list(lines or [])
