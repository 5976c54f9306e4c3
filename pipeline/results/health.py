"""What happened in a flight, and which part of it can serve models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from logparse import FlightEvent
    from pipeline.results.flight import Span


@dataclass(frozen=True, slots=True, eq=False)
class Signal:
    """One line over time, thinned such that no peak is lost.

    Attributes
    ----------
    name : str
        For the legend, such as ``"asked"``, ``"flown"``.
    t, y : ndarray, shape (n,)
        s on the log's boot clock, and the value in the unit of its panel.
    """

    name: str
    t: NDArray[np.float64]
    y: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """Signals of one quantity, drawn over each other.

    Attributes
    ----------
    title, unit : str
        Of the axis; SI, angles in radians.
    signals : tuple of Signal
    limits : mapping of str to float
        Published limits by name, same unit.
    """

    title: str
    unit: str
    signals: tuple[Signal, ...]
    limits: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum:
    """Amplitude of vibration by frequency.

    Attributes
    ----------
    source : str
        What was transformed, such as ``"gyro, 400 Hz"``.
    unit : str
        Of the amplitude of a line.
    hz : ndarray, shape (n,)
    amplitudes : mapping of str to ndarray, shape (n,)
        By axis.
    filters : mapping of str to float
        Frequencies of the autopilot's filters and notches, Hz, by what they are.
    """

    source: str
    unit: str
    hz: NDArray[np.float64]
    amplitudes: Mapping[str, NDArray[np.float64]]
    filters: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HealthSignals:
    """What the health of a flight is judged by, as lines: each group is one plot, empty where it was not logged."""

    attitude: tuple[Panel, ...] = ()
    rates: tuple[Panel, ...] = ()
    vibration: tuple[Panel, ...] = ()
    battery: tuple[Panel, ...] = ()
    estimator: tuple[Panel, ...] = ()
    gps: tuple[Panel, ...] = ()
    compass: tuple[Panel, ...] = ()
    spectrum: Spectrum | None = None
    motor_limits: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightHealth:
    """Timeline of a flight, with the part of it that trains and judges models.

    Attributes
    ----------
    events : tuple of FlightEvent
        In the order of time, those on the ground before and after the flight included.
    sound : Span or None
        The part of the analysed flight before a motor failed or control was lost for good; the whole flight where
        nothing of the kind happened, None without a flight.
    cause : FlightEvent or None
        Why the rest is left out; None where nothing is.
    motors_missing : str
        Why failing motors could not be looked for; empty where they were.
    signals : HealthSignals or None
        Lines of the analysed flight for plots; None without a flight.
    """

    events: tuple[FlightEvent, ...]
    sound: Span | None
    cause: FlightEvent | None = None
    motors_missing: str = ""
    signals: HealthSignals | None = None

    @property
    def notable(self) -> tuple[FlightEvent, ...]:
        """Events that a healthy flight does not have."""
        return tuple(event for event in self.events if event.notable)
