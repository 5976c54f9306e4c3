"""Which flights train models, and which part of them.

A flight trains if its position is accurate and it moves enough. Of it serves the part before a motor failed or the
craft was lost, and of a very long flight the half hour in which most was asked of the craft.
"""

from __future__ import annotations

import math

import numpy as np

from logparse import Finding, FlightLog, Severity
from logparse.canonical.series import wrap
from pipeline.results.account import Account
from pipeline.results.fleet import FlightEntry
from pipeline.results.span import Span

#: Horizontal 1-sigma beyond which a flight does not train, m: good models err by this much over whole flights.
POOR_POSITION = 5.0

#: Acceleration over what the estimate's own noise makes of it, below which there is too little excitation.
LEAST_EXCITATION = 2.0


def excitation(flight: FlightEntry) -> float | None:
    """Return the RMS of a flight's changes of velocity over a second, m/s^2; None where that was not measured."""
    return None if flight.coverage is None else _measured(flight.coverage.excitation.acceleration_rms)


def position_sigma(flight: FlightEntry) -> float | None:
    """Return the largest horizontal 1-sigma of a flight's position, m; None where that was not measured."""
    return None if flight.coverage is None else _measured(flight.coverage.health.position_sigma.max)


def position_good(flight: FlightEntry) -> bool:
    """Return whether a flight's position is known to be good enough to train."""
    sigma = position_sigma(flight)
    return sigma is not None and sigma <= POOR_POSITION


def _measured(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def excitation_noise(flight: FlightEntry) -> float | None:
    """Return what the estimate's own noise makes of `excitation`, m/s^2; None where that was not measured."""
    return None if flight.coverage is None else _measured(flight.coverage.excitation.acceleration_noise)


def hardly_moves(flight: FlightEntry) -> bool:
    """Return whether all that a flight shows is the noise of the estimate."""
    moved, noise = excitation(flight), excitation_noise(flight)
    return moved is not None and noise is not None and moved < LEAST_EXCITATION * noise


def exclusion_of(flight: FlightEntry) -> str:
    """Return why a flight must not train, as a clause; empty when it may. What was not measured is not trusted."""
    sigma, moved, noise = position_sigma(flight), excitation(flight), excitation_noise(flight)
    if sigma is None:
        why = flight.missing.get("coverage", "")
        return "how accurate its position is was not determined" + (f" ({why})" if why else "")
    if sigma > POOR_POSITION:
        return f"its position is poor: the horizontal 1-sigma grows to {sigma:.1f} m"
    if moved is None or noise is None:
        return "how much it moves was not determined"
    if hardly_moves(flight):
        return (
            f"it hardly moves: its acceleration of {moved:.2g} m/s² (RMS) is less than "
            f"{LEAST_EXCITATION:g} times what the estimate's noise makes, {noise:.2g} m/s²"
        )
    return ""


#: Longest flying [s] that models are made of. What all of a flight has in common (battery, wind, trim) outweighs by
#: then what more of it would add, and time and memory that models take grow with it.
LONGEST = 1800.0

#: Part of it by which one choice is shifted against the next.
_SHIFT = 0.1


def busiest(log: FlightLog, sound: Span) -> Span:
    """Return the `LONGEST` seconds in which attitude targets moved most; all of a flight that is not longer.

    A flight with chirps, which may be anywhere, is used as a whole.
    """
    if sound.stop - sound.start <= LONGEST or log.tables.has("systemid"):
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


def loss_findings(account: Account) -> tuple[Finding, ...]:
    """Explain from when on a flight serves no models because a motor failed or the craft was lost; empty if neither."""
    cause, sound = account.cause, account.sound
    if account.flight is None or cause is None or sound is None or sound.stop >= account.flight.stop:
        return ()
    return (
        Finding(
            "part-excluded",
            Severity.WARNING,
            f"From {sound.stop:.1f} s on nothing trains or judges models: {cause.reason}",
            evidence={"from_s": sound.stop, "event": cause.id, "event_s": cause.t},
        ),
    )


def part_findings(sound: Span, part: Span) -> tuple[Finding, ...]:
    """Explain of which part of a long flight, as `busiest` chose it, models are made; empty if of all of it."""
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
