"""The story of a flight: of all that happened the gravest, with what led to it and what followed."""

from __future__ import annotations

from collections.abc import Sequence

from core.findings import WORST_FIRST, Happening, Severity
from core.quantity import duration, number
from pipeline.results.account import GRAVITY, Reading, gravity
from pipeline.results.span import Span

#: Consequences, of which a cause is looked for.
_CONSEQUENCES = frozenset(("crash", "hard-landing", "throttle-runaway", "control-lost", "lift-lost"))
#: What may cause them.
_CAUSES = frozenset(GRAVITY) - {"crash", "hard-landing", "gps-lost", "gps-glitch", "autopilot-error"}
#: What is no story by itself unless it is an error: it had no consequence, or was so from the start.
_REMARKS = frozenset(("height-estimate-wrong", "vibration", "gps-glitch", "autopilot-error"))
#: A boot clock beyond this [s] is hard to read; times are then since take-off only.
_READABLE = 36_000.0
#: Longest time [s] between the end of a cause and the beginning of what it led to.
_LED_TO = 3.0


def gravest_first(happenings: Sequence[Happening]) -> tuple[Happening, ...]:
    """Order what happened by severity, then by gravity of its kind, then by time."""
    return tuple(
        sorted(happenings, key=lambda finding: (WORST_FIRST.index(finding.severity), gravity(finding), finding.t))
    )


def tell_story(ordered: Sequence[Happening]) -> tuple[Happening, ...]:
    """Return the gravest happening with what led to it, causes first; empty where nothing notable happened."""
    gravest = next((finding for finding in ordered if not _is_remark(finding)), None)
    if gravest is None or not gravest.notable:
        return ()
    chain = [gravest]
    while chain[0].id in _CONSEQUENCES:
        before = [
            finding
            for finding in ordered
            if finding.id in _CAUSES and finding.notable and not _is_remark(finding) and _leads(finding, chain[0])
        ]
        if not before:
            break
        # The first of the most severe, since it began what followed; of two at once the graver.
        chain.insert(
            0, min(before, key=lambda finding: (WORST_FIRST.index(finding.severity), finding.t, gravity(finding)))
        )
    return tuple(chain)


def _is_remark(happening: Happening) -> bool:
    return happening.id in _REMARKS and happening.severity is not Severity.ERROR


def _leads(cause: Happening, effect: Happening) -> bool:
    return cause.t < effect.t <= cause.end + _LED_TO


def _clock(t: float, flight: Span | None) -> str:
    """Write a time since take-off, and on the log's clock: ``2:06 of flight (368.6 s)``."""
    if flight is None or t < flight.start:
        return f"{t:.1f} s"
    since = _since_takeoff(t, flight)
    return since if t > _READABLE else f"{since} ({t:.1f} s)"


def _short_clock(t: float, flight: Span | None) -> str:
    """Write a time for the second clause of a sentence: on the log's clock alone where that is readable."""
    return f"{t:.1f} s" if t <= _READABLE or flight is None else _since_takeoff(t, flight)


def _since_takeoff(t: float, flight: Span) -> str:
    minutes, seconds = divmod(round(t - flight.start), 60)
    return f"{minutes}:{seconds:02d} of flight"


def _clause(sentence: str) -> str:
    """Turn a sentence into a clause: a small first letter unless it begins with a name or number, and no full stop.

    The evidence after a colon is left to the table below.
    """
    text = sentence.strip().partition(": ")[0].rstrip(".")
    first = text.split(" ", 1)[0]
    return text if first.isupper() and len(first) > 1 else text[:1].lower() + text[1:]


def headline(story: Sequence[Happening], flight: Span | None) -> str:
    """Write the story in one sentence: the cause with its time, then its consequences."""
    if not story:
        return ""
    first, *rest = story
    parts = [f"At {_clock(first.t, flight)} {_clause(first.reason)}"]
    parts += [f"{_clause(finding.reason)} at {_short_clock(finding.t, flight)}" for finding in rest]
    return "; ".join(parts) + "."


def uneventful(
    flight: Span, height: Reading | None, distance: Reading | None, ground_speed: Reading | None, *, seen: bool
) -> str:
    """Write that nothing happened: how long, how high, how far, how fast; `seen` tells whether a crash would show."""
    parts = [
        f"{'Nothing happened in' if seen else 'What happened is not logged:'} {duration(flight.duration)} of flight"
    ]
    if height is not None:
        parts.append(f"up to {number(height.value, 2)} m high")
    if distance is not None:
        parts.append(f"{number(distance.value, 2)} m away")
    if ground_speed is not None:
        parts.append(f"{number(ground_speed.value, 2)} m/s")
    return ", ".join(parts) + "."
