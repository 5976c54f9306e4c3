"""What a controller steadily asks of the motors of a craft in flight."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SteadyTrims:
    """Roll, pitch and yaw that the controller steadily asked for in one flight."""

    motors: tuple[str, ...]
    trims: tuple[float, ...]  #: As parts of the mean thrust along the mixer's orthonormal columns.
    variance: tuple[float, ...]  #: Of the three, by their scatter within the flight.
    rows: tuple[tuple[float, ...], ...]  #: Trims that each motor would take if it gave nothing.
