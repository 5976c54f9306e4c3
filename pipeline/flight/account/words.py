"""Times and clauses as the account writes them."""

from __future__ import annotations

from core.quantity import duration
from pipeline.results.span import Span

#: A boot clock beyond this [s] is no clock that a reader can follow; times are then since take-off only.
_READABLE = 36_000.0


def clock(t: float, flight: Span | None) -> str:
    """Write a time since take-off, and on the log's clock: ``2 min 06 s into the flight (368.6 s)``."""
    on_log = f"{t:.1f} s"
    if flight is None or t < flight.start:
        return on_log
    since = f"{duration(t - flight.start)} into the flight"
    return since if t > _READABLE else f"{since} ({on_log})"


def short_clock(t: float, flight: Span | None) -> str:
    """Write a time for the second clause of a sentence: on the log's clock alone where that can be read."""
    return f"{t:.1f} s" if t <= _READABLE or flight is None else f"{duration(t - flight.start)} into the flight"


def clause(sentence: str) -> str:
    """Turn a sentence into a clause: a small first letter, unless a name or a number begins it, and no full stop.

    The evidence, which stands behind a colon, is left to the table below.
    """
    text = sentence.strip().partition(": ")[0].rstrip(".")
    first = text.split(" ", 1)[0]
    return text if first.isupper() and len(first) > 1 else text[:1].lower() + text[1:]
