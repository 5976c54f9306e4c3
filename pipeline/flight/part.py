"""Which part of a very long flight trains and judges models: the one in which most was asked of the craft."""

from __future__ import annotations

import numpy as np

from logparse import Finding, FlightLog, Severity
from logparse.canonical.series import wrap
from pipeline.results.span import Span

#: Longest flying [s] that models are made of. What all of a flight has in common (battery, wind, trim) outweighs by
#: then what more of it would add, and time and memory that models take grow with it.
LONGEST = 1800.0

#: Part of it by which one choice is shifted against the next.
_SHIFT = 0.1


def busiest(log: FlightLog, sound: Span) -> Span:
    """Return the `LONGEST` seconds in which attitude targets moved most; all of a flight that is not longer.

    Chirps may lie anywhere: a flight with some counts as a whole.
    """
    if sound.stop - sound.start <= LONGEST or log.tables.systemid is not None:
        return sound
    begins = np.arange(sound.start, sound.stop - LONGEST, _SHIFT * LONGEST)
    angles = ("roll", "pitch", "yaw")
    table = log.tables.part("setpoints", angles)
    table = log.tables.part("attitude", angles) if table is None else table
    if table is None or len(table) < 2:
        return Span(sound.start, sound.start + LONGEST)
    turned = wrap(np.diff(table.to_numpy(np.float64), axis=0))
    moved = np.concatenate([[0.0], np.cumsum(np.nansum(np.abs(turned), axis=1))])
    t = table.index.to_numpy(np.float64)
    begin = float(begins[np.argmax(np.interp(begins + LONGEST, t, moved) - np.interp(begins, t, moved))])
    return Span(begin, begin + LONGEST)


def part_findings(sound: Span, part: Span) -> tuple[Finding, ...]:
    """Explain which part of a long flight, which is `busiest`, models are made of."""
    if part == sound:
        return ()
    return (
        Finding(
            "part-excluded",
            Severity.INFO,
            f"Models, frequency responses and margins are of {part.start:.0f} to {part.stop:.0f} s, where most was "
            f"asked of the craft; the flight lasts {(sound.stop - sound.start) / 60.0:.0f} min.",
            "",
            {"start": part.start, "stop": part.stop},
        ),
    )
