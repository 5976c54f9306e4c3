"""Drift: parameters of a craft from flight to flight, and whether a motor weakens."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from logparse import Finding


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A flight's own value of a parameter with its standard error; `number` counts the craft's flights from 1."""

    flight: str
    number: int
    start_utc: str | None
    value: float
    sigma: float

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """Steady change: slope per flight (and per day, where dates tell), with its standard error and probability."""

    per_flight: float
    per_flight_sigma: float
    per_day: float | None
    p: float
    p_adjusted: float = 1.0
    significant: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Change at once between two flights (`number` is that of the later), with standard error and probability."""

    before: str
    after: str
    number: int
    change: float
    sigma: float
    p: float
    p_adjusted: float = 1.0
    significant: bool = False

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """One parameter over the flights of a craft.

    Attributes
    ----------
    parameter, unit, method : str
    points : tuple of Point
        In the order of the flights.
    mean, mean_sigma : float
        Over flights, with its standard error.
    between : float
        Standard deviation between flights beyond their own standard errors.
    q, q_p, i2 : float
        Cochran's Q, its probability, and the part of the scatter that is not the flights' own errors.
    trend : Trend or None
    step : Step or None
    others : mapping of str to tuple of Point
        What other methods say, by method.
    sentence : str
    """

    parameter: str
    unit: str
    method: str
    points: tuple[Point, ...]
    mean: float
    mean_sigma: float
    between: float
    q: float
    q_p: float
    i2: float
    trend: Trend | None = None
    step: Step | None = None
    others: Mapping[str, tuple[Point, ...]] = field(default_factory=dict)
    sentence: str = ""

    @property
    def change(self) -> Trend | Step | None:
        """The significant change, the likelier where slope and step both are; None without one."""
        found = [each for each in (self.trend, self.step) if each is not None and each.significant]
        return min(found, key=lambda each: each.p, default=None)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "parameter": self.parameter,
            "unit": self.unit,
            "method": self.method,
            "flights": [point.to_dict() for point in self.points],
            "mean": self.mean,
            "mean_sigma": self.mean_sigma,
            "between": self.between,
            "heterogeneity": {"q": self.q, "p": self.q_p, "i2": self.i2},
            "trend": None if self.trend is None else self.trend.to_dict(),
            "step": None if self.step is None else self.step.to_dict(),
            "others": {method: [point.to_dict() for point in points] for method, points in self.others.items()},
            "sentence": self.sentence,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorDrift:
    """The motors' shares over flights.

    Attributes
    ----------
    points : tuple of mapping
        ``flight start_utc shares``, these by motor: value and standard error, mean of all motors 1.
    weakening : str or None
        The motor that alone explains a change of the trims by losing thrust.
    loss, loss_sigma : float or None
        Part of its thrust that it lost: per flight, or at once.
    sentence : str
    findings : tuple of Finding
    """

    points: tuple[Mapping[str, Any], ...]
    weakening: str | None
    loss: float | None
    loss_sigma: float | None
    sentence: str
    findings: tuple[Finding, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "points": [dict(point) for point in self.points],
            "weakening": self.weakening,
            "loss": self.loss,
            "loss_sigma": self.loss_sigma,
            "sentence": self.sentence,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Everything that was followed over the flights of one craft.

    Attributes
    ----------
    order : str
        ``"date"``, or ``"name"`` where a log does not tell its date.
    flights : tuple of str
        In that order.
    parameters : tuple of History
    motors : MotorDrift or None
        None where no flight tells the motors' shares.
    findings : tuple of Finding
    """

    order: str
    flights: tuple[str, ...]
    parameters: tuple[History, ...]
    motors: MotorDrift | None
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "order": self.order,
            "flights": list(self.flights),
            "parameters": [each.to_dict() for each in self.parameters],
            "motors": None if self.motors is None else self.motors.to_dict(),
            "findings": [finding.to_dict() for finding in self.findings],
        }
