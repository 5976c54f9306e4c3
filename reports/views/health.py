"""The timeline of a flight as tables and sentences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from core.quantity import number
from logparse import FlightEvent
from pipeline.results.report import HealthReport

#: Most events that the table shows; the rest is counted.
_MOST = 40
#: Events of one kind that stand apart; more become one row.
_APART = 3
_WORDS = {"info": "note"}


@dataclass(frozen=True, slots=True)
class ShownEvent:
    """An event as people read it, times in seconds."""

    t: str
    duration: str
    severity: str
    word: str
    name: str
    reason: str
    advice: str
    source: str


@dataclass(frozen=True, slots=True)
class Timeline:
    """What happened: in a sentence, as a table (`more` are left out of it), and what was quiet for a folded one."""

    sentence: str
    rows: Sequence[ShownEvent]
    more: int
    quiet: Sequence[ShownEvent]
    quiet_count: int
    motors_missing: str


def timeline(health: HealthReport | None) -> Timeline | None:
    """Lay out the notable events, worst kinds kept when there are too many, and the quiet ones for a folded table."""
    if health is None:
        return None
    notable = [event for event in health.events if event.notable]
    grouped = _grouped(notable)
    shown = sorted(grouped, key=lambda event: (event.severity != "error", event.t))[:_MOST]
    shown.sort(key=lambda event: event.t)
    quiet = [event for event in health.events if not event.notable]
    return Timeline(
        sentence=sentence(health),
        rows=[_shown(event) for event in shown],
        more=len(grouped) - len(shown),
        quiet=[_shown(event) for event in quiet[: 5 * _MOST]],
        quiet_count=len(quiet),
        motors_missing=health.motors_missing,
    )


def _grouped(events: Sequence[FlightEvent]) -> list[FlightEvent]:
    """Make one of the events of a kind where there are many, in the words of its worst and longest."""
    kinds: dict[str, list[FlightEvent]] = {}
    for event in events:
        kinds.setdefault(event.id, []).append(event)
    grouped = []
    for alike in kinds.values():
        if len(alike) <= _APART:
            grouped += alike
            continue
        worst = max(alike, key=lambda event: (event.severity == "error", event.duration))
        first, last = min(event.t for event in alike), max(event.t for event in alike)
        reason = f"{len(alike)} times until {last:.1f} s; the worst, at {worst.t:.1f} s: {worst.reason}"
        grouped.append(replace(worst, t=first, end=first, reason=reason))
    return grouped


def sentence(health: HealthReport) -> str:
    """Sum the timeline up in one sentence."""
    kinds: dict[str, list[float]] = {}
    for event in health.events:
        if event.notable:
            kinds.setdefault(event.id.replace("-", " "), []).append(event.t)
    # What serves models is a part of the flight: without a flight there is none.
    flown = health.sound is not None
    if not kinds:
        return "Nothing notable happened in flight." if flown else "The log shows no flight; nothing notable happened."
    parts = [
        f"{kind} at {times[0]:.1f} s" if len(times) == 1 else f"{kind} ({len(times)}, first at {times[0]:.1f} s)"
        for kind, times in kinds.items()
    ]
    return f"Happened {'in flight' if flown else 'without a flight'}: " + ", ".join(parts) + "."


def _shown(event: FlightEvent) -> ShownEvent:
    return ShownEvent(
        t=f"{event.t:.1f}",
        duration=f"{number(event.duration, 2)} s" if event.duration > 0.05 else "",
        severity=event.severity,
        word=_WORDS.get(event.severity, event.severity),
        name=event.id.replace("-", " "),
        reason=event.reason,
        advice=event.advice,
        source=event.source,
    )
