"""Lines over a flight for its plots, and the spectrum of its vibration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class SignalLine:
    """One line over time, thinned such that no peak is lost."""

    name: str  #: For the legend, such as ``"asked"``, ``"flown"``.
    #: shape (n,): s on the log's boot clock, and the value in the unit of its panel.
    t: NDArray[np.float64]
    y: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """Signals of one quantity, drawn over each other."""

    #: Of the axis; SI, angles in radians.
    title: str
    unit: str
    signals: tuple[SignalLine, ...]
    limits: Mapping[str, float] = field(default_factory=dict)  #: Published limits by name, same unit.


@dataclass(frozen=True, slots=True)
class Notch:
    """Band of a notch filter over the flight, Hz."""

    name: str
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """A line that stands out of a spectrum."""

    hz: float
    amplitude: float  #: In the unit of the spectrum.
    axis: str
    rotor_multiple: int  #: Which multiple of the rotors' speed it is; 0 where it is none, or that is not known.
    notch: str  #: The notch that covers it; empty where none does.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum:
    """Amplitude of vibration by frequency."""

    source: str  #: What was transformed, such as ``"gyro, 400 Hz"``.
    unit: str  #: Of the amplitude of a line.
    hz: NDArray[np.float64]  #: shape (n,)
    amplitudes: Mapping[str, NDArray[np.float64]]  #: mapping of str to ndarray, shape (n,): By axis.
    #: Cut-off of the gyro's low pass, Hz, by the parameter's name.
    filters: Mapping[str, float] = field(default_factory=dict)
    #: Speeds between which the rotors turned nine tenths of the time, Hz; None where no ESC reported them.
    rotors_hz: tuple[float, float] | None = None
    notches: tuple[Notch, ...] = ()
    peaks: tuple[Peak, ...] = ()  #: The strongest first.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightSignals:
    """What a flight is judged by, as lines: each group is one plot, empty where it was not logged."""

    height: tuple[Panel, ...] = ()  #: Above the ground that the flight left, by every sensor; the credible first.
    attitude: tuple[Panel, ...] = ()
    rates: tuple[Panel, ...] = ()
    vibration: tuple[Panel, ...] = ()
    battery: tuple[Panel, ...] = ()
    estimator: tuple[Panel, ...] = ()
    gps: tuple[Panel, ...] = ()
    compass: tuple[Panel, ...] = ()
    spectrum: Spectrum | None = None
    motor_limits: Mapping[str, float] = field(default_factory=dict)
