"""`SteadyTrims`: what the controller of a craft steadily asks of its motors; services read it without numpy."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SteadyTrims:
    """Roll, pitch and yaw that the controller steadily asked for in one flight."""

    motors: tuple[str, ...]
    trims: tuple[float, ...]  #: As parts of the mean thrust along the mixer's columns, each of length 1.
    variance: tuple[float, ...]  #: Of the three, by their scatter within the flight.
    rows: tuple[tuple[float, ...], ...]  #: Trims that each motor would take if it gave nothing.
