"""Coverage of one flight: which speeds, heights and winds it flew, how it moved, and how well that was logged."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import atan2, pi
from typing import Any

import numpy as np


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisExcitation:
    """Movement in one axis.

    Attributes
    ----------
    rms : float
        About the mean: of the angular rate [rad/s], or for thrust of the specific force along body z [m/s^2] in
        one-second means.
    unit : str
    command_std : float or None
        Standard deviation of the mixer's command, in parts of a motor's full thrust.
    word : str
        ``"none"``, ``"weak"``, ``"fair"`` or ``"strong"``; weak ends where identification begins to believe an axis
        (`sysid.rigid_body.rotation.STILL`, `sysid.rotors.rotor.VARYING`).
    """

    rms: float
    unit: str
    command_std: float | None
    word: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """Movement of one flight.

    Attributes
    ----------
    acceleration_rms : float
        Of changes of velocity over one second, m/s^2: the motion that models are to explain.
    acceleration_noise : float or None
        The same that the estimate's own uncertainty would make, m/s^2; None where that is not known.
    speed_std : tuple of 2 float
        Standard deviation of the velocity over the ground along and across the nose, about the flight's mean velocity,
        m/s: what tells drag from wind.
    headings : int
        Sectors of 45 degrees in which the nose pointed for three seconds or more.
    axes : mapping of str to AxisExcitation
        ``roll pitch yaw thrust``.
    coherence : mapping or None
        By output: median multiple coherence with the inputs and the part of frequencies above chance.
    """

    acceleration_rms: float
    acceleration_noise: float | None
    speed_std: tuple[float, float]
    headings: int
    axes: Mapping[str, AxisExcitation]
    coherence: Mapping[str, Mapping[str, float]] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "acceleration_rms": self.acceleration_rms,
            "acceleration_noise": self.acceleration_noise,
            "speed_std": list(self.speed_std),
            "headings": self.headings,
            "axes": {name: axis.to_dict() for name, axis in self.axes.items()},
            "coherence": None if self.coherence is None else {name: dict(c) for name, c in self.coherence.items()},
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class LogHealth:
    """How well a flight was logged.

    Attributes
    ----------
    rates : mapping
        By table: ``rate`` [Hz], ``gaps`` and ``longest_gap`` [s] in flight.
    gps : mapping or None
        ``fix_part`` of the flight with a 3-D fix; medians of ``satellites``, ``hdop``, ``h_acc`` [m], ``s_acc`` [m/s],
        None where not reported.
    vibration : mapping or None
        ``p95`` of the worst axis [m/s^2], ``clips`` of the accelerometer.
    battery : mapping or None
        Voltage ``first``, ``last``, ``min`` [V], ``mean_current`` [A] or None.
    position_sigma : mapping
        ``median`` and ``max`` of the horizontal 1-sigma [m].
    settings : mapping of str to float
        Parameters of the autopilot that decide what is logged.
    format : str
        Of the log.
    """

    rates: Mapping[str, Mapping[str, float]]
    gps: Mapping[str, float | None] | None
    vibration: Mapping[str, float] | None
    battery: Mapping[str, float | None] | None
    position_sigma: Mapping[str, float]
    settings: Mapping[str, float]
    format: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "rates": {name: dict(rate) for name, rate in self.rates.items()},
            "gps": None if self.gps is None else dict(self.gps),
            "vibration": None if self.vibration is None else dict(self.vibration),
            "battery": None if self.battery is None else dict(self.battery),
            "position_sigma": dict(self.position_sigma),
            "settings": dict(self.settings),
            "format": self.format,
        }


@dataclass(frozen=True, slots=True)
class Quantity:
    """What is counted out: name for people, unit and width of its bins; bins begin at multiples of the width."""

    title: str
    unit: str
    step: float


#: In the order of reports.
QUANTITIES: Mapping[str, Quantity] = {
    "ground_speed": Quantity("ground speed", "m/s", 1.0),
    "airspeed": Quantity("horizontal airspeed", "m/s", 1.0),
    "climb_rate": Quantity("climb rate", "m/s", 0.5),
    "altitude": Quantity("altitude above the start", "m", 5.0),
    "density": Quantity("air density", "kg/m^3", 0.02),
    "thrust": Quantity("mean thrust command", "part of full thrust", 0.025),
    "tilt": Quantity("tilt", "rad", pi / 72),
    "yaw_rate": Quantity("yaw rate", "rad/s", pi / 36),
}


#: The two quantities of the map.
MAP = ("ground_speed", "altitude")


@dataclass(frozen=True, slots=True, kw_only=True)
class Distribution:
    """How much time a flight spent at which values of a quantity.

    Attributes
    ----------
    minimum, p05, median, p95, maximum, mean, std : float
        In the quantity's unit.
    first : int
        Number of the first bin: it begins at ``first * step`` of the quantity.
    seconds : tuple of float
        Time in each bin from there on.
    """

    minimum: float
    p05: float
    median: float
    p95: float
    maximum: float
    mean: float
    std: float
    first: int
    seconds: tuple[float, ...]

    def to_dict(self, quantity: Quantity) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "title": quantity.title,
            "unit": quantity.unit,
            "min": self.minimum,
            "p05": self.p05,
            "median": self.median,
            "p95": self.p95,
            "max": self.maximum,
            "mean": self.mean,
            "std": self.std,
            "step": quantity.step,
            "first": self.first,
            "seconds": list(self.seconds),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """Mean wind of a flight as the rigid body found it.

    Attributes
    ----------
    north, east : float
        Where the air goes, 10 m above the start, m/s.
    sigma : float
        Standard error of each, m/s.
    source : str
    """

    north: float
    east: float
    sigma: float
    source: str

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON; ``from`` is where the wind comes from, rad clockwise from north."""
        return {
            "speed": float(np.hypot(self.north, self.east)),
            "from": atan2(-self.east, -self.north) % (2.0 * pi),
            "north": self.north,
            "east": self.east,
            "sigma": self.sigma,
            "source": self.source,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Coverage:
    """What one flight covered.

    Attributes
    ----------
    seconds : float
        Of flight that were counted.
    quantities : mapping of str to Distribution
        Of those of `QUANTITIES` that are known.
    cells : tuple of (int, int, float)
        Bin of ground speed, bin of altitude, seconds; cells without time are left out.
    wind : Wind or None
    excitation : Excitation
    health : LogHealth
    missing : mapping of str to str
        Why a quantity, or the wind, is not known.
    """

    seconds: float
    quantities: Mapping[str, Distribution]
    cells: tuple[tuple[int, int, float], ...]
    wind: Wind | None
    excitation: Excitation
    health: LogHealth
    missing: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "seconds": self.seconds,
            "quantities": {name: each.to_dict(QUANTITIES[name]) for name, each in self.quantities.items()},
            "map": {
                "x": MAP[0],
                "y": MAP[1],
                "x_step": QUANTITIES[MAP[0]].step,
                "y_step": QUANTITIES[MAP[1]].step,
                "cells": [list(cell) for cell in self.cells],
            },
            "wind": None if self.wind is None else self.wind.to_dict(),
            "excitation": self.excitation.to_dict(),
            "health": self.health.to_dict(),
            "missing": dict(self.missing),
        }
