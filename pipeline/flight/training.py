"""Whether a flight is good enough to train models: how accurate its position is, and how much it moves."""

from __future__ import annotations

import math

from pipeline.results.entry import FlightEntry
from pipeline.results.fleet import Exclusion, TrainingExclusion

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


def exclusion_of(flight: FlightEntry) -> TrainingExclusion | None:
    """Return why a flight must not train; None when it may. What was not measured is no reason to trust it."""
    sigma, moved = position_sigma(flight), excitation(flight)
    if sigma is None:
        why = flight.missing.get("coverage", "")
        return TrainingExclusion(
            Exclusion.POSITION_UNKNOWN,
            "how accurate its position is was not determined" + (f" ({why})" if why else ""),
        )
    if sigma > POOR_POSITION:
        return TrainingExclusion(
            Exclusion.POSITION_POOR, f"its position is poor: the horizontal 1-sigma grows to {sigma:.1f} m"
        )
    noise = None if flight.coverage is None else _measured(flight.coverage.excitation.acceleration_noise)
    if moved is None or noise is None:
        return TrainingExclusion(Exclusion.EXCITATION_UNKNOWN, "how much it moves was not determined")
    if moved < LEAST_EXCITATION * noise:
        return TrainingExclusion(
            Exclusion.LITTLE_EXCITATION,
            f"it hardly moves: its acceleration of {moved:.2g} m/s² (RMS) is less than "
            f"{LEAST_EXCITATION:g} times what the estimate's noise makes, {noise:.2g} m/s²",
        )
    return None
