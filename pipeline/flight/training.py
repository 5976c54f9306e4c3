"""Which flights are used for training, and which part of them.

A flight is used if its position is accurate and it moves enough. Only the part before a motor failed or the craft was
lost is used, and of a very long flight the half hour in which attitude targets moved most.
"""

from __future__ import annotations

import math

import numpy as np

from logparse import Finding, FlightLog, Severity
from logparse.canonical.series import wrap
from pipeline.results.account import Account
from pipeline.results.fleet import FlightEntry
from pipeline.results.span import Span

#: Horizontal 1-sigma beyond which a flight is excluded, m: good models err by this much over whole flights.
POOR_POSITION = 5.0

#: Ratio of acceleration to that from the estimate's own noise, below which there is too little excitation.
LEAST_EXCITATION = 2.0


def excitation(flight: FlightEntry) -> float | None:
    """Return the RMS of a flight's changes of velocity over a second, m/s^2; None if not measured."""
    return None if flight.coverage is None else _measured(flight.coverage.excitation.acceleration_rms)


def position_sigma(flight: FlightEntry) -> float | None:
    """Return the largest horizontal 1-sigma of a flight's position, m; None if not measured."""
    return None if flight.coverage is None else _measured(flight.coverage.health.position_sigma.max)


def position_good(flight: FlightEntry) -> bool:
    """Return whether a flight's position is accurate enough for training."""
    sigma = position_sigma(flight)
    return sigma is not None and sigma <= POOR_POSITION


def _measured(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else float(value)


def excitation_noise(flight: FlightEntry) -> float | None:
    """Return the part of `excitation` that comes from the estimate's own noise, m/s^2; None if not measured."""
    return None if flight.coverage is None else _measured(flight.coverage.excitation.acceleration_noise)


def hardly_moves(flight: FlightEntry) -> bool:
    """Return whether a flight's excitation is no more than the noise of the estimate."""
    acceleration, noise = excitation(flight), excitation_noise(flight)
    return acceleration is not None and noise is not None and acceleration < LEAST_EXCITATION * noise


def exclusion_of(flight: FlightEntry) -> str:
    """Return why a flight is excluded from training, as a clause; empty if it is not."""
    sigma, acceleration, noise = position_sigma(flight), excitation(flight), excitation_noise(flight)
    if sigma is None:
        why = flight.missing.get("coverage", "")
        return "how accurate its position is was not determined" + (f" ({why})" if why else "")
    if sigma > POOR_POSITION:
        return f"its position is poor: the horizontal 1-sigma grows to {sigma:.1f} m"
    if acceleration is None or noise is None:
        return "how much it moves was not determined"
    if hardly_moves(flight):
        return (
            f"it hardly moves: its acceleration of {acceleration:.2g} m/s² (RMS) is less than "
            f"{LEAST_EXCITATION:g} times what the estimate's noise makes, {noise:.2g} m/s²"
        )
    return ""


#: Longest part of a flight [s] used for models: more of it adds little, because battery, wind and trim are those of the
#: flight, and models take time and memory in proportion.
LONGEST = 1800.0

#: Step between candidate parts, relative to their length.
_SHIFT = 0.1


def busiest(log: FlightLog, sound: Span) -> Span:
    """Return the `LONGEST` seconds of the `sound` part in which attitude targets moved most, or all of it if shorter.

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
    changes = np.abs(wrap(np.diff(table.to_numpy(np.float64), axis=0)))
    travel = np.concatenate([[0.0], np.cumsum(np.nansum(changes, axis=1))])
    t = table.index.to_numpy(np.float64)
    begin = float(begins[np.argmax(np.interp(begins + LONGEST, t, travel) - np.interp(begins, t, travel))])
    return Span(begin, begin + LONGEST)


def loss_findings(account: Account) -> tuple[Finding, ...]:
    """Report from when on a flight is not used because a motor failed or the craft was lost; empty if neither."""
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
    """Report which part of a long flight models are made of, see `busiest`; empty if all of it."""
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
