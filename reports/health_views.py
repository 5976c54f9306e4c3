"""The timeline of a flight as tables and sentences."""

from __future__ import annotations

from typing import Any

from logparse.quantity import number
from reports.rows import Numbers

#: Most events that the table shows; the rest is counted.
_MOST = 40
#: Events of one kind that stand apart; more become one row.
_APART = 3
_WORDS = {"info": "note"}


def timeline(health: Numbers | None) -> Numbers | None:
    """Lay out the notable events, worst kinds kept when there are too many, and the quiet ones for a folded table."""
    if health is None:
        return None
    events = health["events"]
    notable = [event for event in events if event["severity"] != "info"]
    grouped = _grouped(notable)
    shown = sorted(grouped, key=lambda event: (event["severity"] != "error", event["t_s"]))[:_MOST]
    shown.sort(key=lambda event: event["t_s"])
    quiet = [event for event in events if event["severity"] == "info"]
    return {
        "sentence": sentence(health),
        "rows": [_row(event) for event in shown],
        "more": len(grouped) - len(shown),
        "quiet": [_row(event) for event in quiet[: 5 * _MOST]],
        "quiet_count": len(quiet),
        "motors_missing": health["motors_missing"],
    }


def _grouped(events: list[Numbers]) -> list[Numbers]:
    """Make one of the events of a kind where there are many, in the words of its worst and longest."""
    kinds: dict[str, list[Numbers]] = {}
    for event in events:
        kinds.setdefault(event["id"], []).append(event)
    grouped = []
    for alike in kinds.values():
        if len(alike) <= _APART:
            grouped += alike
            continue
        worst = max(alike, key=lambda event: (event["severity"] == "error", event["end_s"] - event["t_s"]))
        last = max(event["t_s"] for event in alike)
        reason = f"{len(alike)} times until {last:.1f} s; the worst, at {worst['t_s']:.1f} s: {worst['reason']}"
        first = min(event["t_s"] for event in alike)
        grouped.append(worst | {"t_s": first, "end_s": first, "reason": reason})
    return grouped


def sentence(health: Numbers) -> str:
    """Sum the timeline up in one sentence."""
    notable = [event for event in health["events"] if event["severity"] != "info"]
    if not notable:
        return "Nothing notable happened in flight."
    kinds: dict[str, list[float]] = {}
    for event in notable:
        kinds.setdefault(event["id"].replace("-", " "), []).append(event["t_s"])
    parts = [
        f"{kind} at {times[0]:.1f} s" if len(times) == 1 else f"{kind} ({len(times)}, first at {times[0]:.1f} s)"
        for kind, times in kinds.items()
    ]
    return "Happened in flight: " + ", ".join(parts) + "."


def _row(event: Numbers) -> dict[str, Any]:
    duration = event["end_s"] - event["t_s"]
    return {
        "t": f"{event['t_s']:.1f}",
        "duration": f"{number(duration, 2)} s" if duration > 0.05 else "",
        "severity": event["severity"],
        "word": _WORDS.get(event["severity"], event["severity"]),
        "name": event["id"].replace("-", " "),
        "reason": event["reason"],
        "advice": event["advice"],
        "source": event["source"],
    }
