"""Drift of a craft's parameters from flight to flight, weakening motors, and the review of a craft."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime

from core.quantity import uncertain
from logparse import Finding, Severity
from pipeline.results.fleet import ResponseCurve
from sysid.autopilot.values import AutopilotValues


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """Mean of a parameter over the flights on one side of a comparison, with its standard error."""

    value: float
    sigma: float
    flights: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A parameter on both sides of a comparison, and whether the difference is significant."""

    parameter: str
    method: str
    unit: str
    a: Mean
    b: Mean
    between_flights: float | None  #: Standard deviation between flights; None with one flight on each side.
    difference: float
    difference_sigma: float
    #: In percent of the value before, with its 95 % interval; None where that may be zero.
    difference_percent: float | None
    interval_percent: tuple[float, float] | None
    detectable_percent: float | None  #: Change that would be detected with a power of 80 %.
    p: float
    p_adjusted: float = 1.0
    significant: bool = False

    @property
    def written(self) -> str:
        """The difference in percent where that means something, else in the parameter's unit."""
        if self.difference_percent is None:
            return uncertain(self.difference, self.difference_sigma)
        scale = self.difference_percent / self.difference if self.difference else 0.0
        sign = "+" if self.difference_percent > 0.0 else ""
        return sign + uncertain(self.difference_percent, abs(scale) * self.difference_sigma, "%")


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPoint:
    """A flight's own value of a parameter with its standard error; `number` counts the craft's flights from 1."""

    flight: str
    number: int
    start_utc: str | None
    value: float
    sigma: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Trend:
    """Linear trend: slope per flight, with its standard error and p-value."""

    per_flight: float
    per_flight_sigma: float
    p: float
    p_adjusted: float = 1.0
    significant: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """Step change between two flights (`number` is that of the later), with standard error and p-value."""

    before: str
    after: str
    number: int
    change: float
    sigma: float
    p: float
    p_adjusted: float = 1.0
    significant: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Heterogeneity:
    """Cochran's Q, its p-value, and I^2: the part of the scatter beyond the flights' own errors."""

    q: float
    p: float
    i2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """One parameter over the flights of a craft."""

    parameter: str
    unit: str
    method: str
    flights: tuple[FlightPoint, ...]  #: In order.
    #: Over flights, with its standard error.
    mean: float
    mean_sigma: float
    between: float  #: Standard deviation between flights beyond their own standard errors.
    heterogeneity: Heterogeneity
    trend: Trend | None = None
    step: Step | None = None
    others: Mapping[str, tuple[FlightPoint, ...]] = field(default_factory=dict)  #: Of other methods, by method.
    sentence: str = ""

    @property
    def change(self) -> Trend | Step | None:
        """The significant change, that with the smaller p where trend and step both are; None without one."""
        significant = [change for change in (self.trend, self.step) if change is not None and change.significant]
        return min(significant, key=lambda change: change.p, default=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorWork:
    """How hard each motor worked in one flight, by motor, mean of all motors 1; empty where that is not known."""

    flight: str
    start_utc: str | None
    work: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorDrift:
    """Mean commands of the motors over flights."""

    points: tuple[MotorWork, ...]
    weakening: str | None = None  #: The motor that alone explains a change of the trims by losing thrust.
    #: Part of its thrust that it lost: per flight, or in one step.
    loss: float | None = None
    sentence: str
    p: float | None = None  #: p-value of one motor's loss explaining the trims by chance.
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """All that is tracked over the flights of one craft."""

    order: str  #: ``"date"``, or ``"name"`` where the date of a log is not known.
    flights: tuple[str, ...]  #: In that order.
    parameters: tuple[History, ...]
    motors: MotorDrift | None  #: None where no flight has mean commands.
    findings: tuple[Finding, ...]
    responses: tuple[ResponseCurve, ...] = ()  #: Of the newest flights, response of each axis to its command.


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftNote:
    """What was done to a craft, as its owner wrote it down."""

    at: datetime  #: UTC.
    text: str
    boundary: bool = False  #: Flights before it are not pooled with those after it.


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """A quantity outside its usual range; alerts with equal `about` are the same."""

    about: str
    id: str  #: As a finding has it.
    severity: Severity
    text: str
    flight: str  #: After which flight it was seen.


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftReview:
    """Results over the flights of one craft without a joint fit, combined from those of each flight."""

    flights: tuple[str, ...]  #: In order.
    #: Those since the last boundary that have the same configuration as the newest.
    pooled: tuple[str, ...]
    boundary: CraftNote | None  #: The last before the newest flight.
    drift: Drift | None  #: Of the pooled flights.
    whole: Drift | None  #: Of all flights, where not all are pooled.
    since: tuple[ParameterChange, ...]  #: What changed with the boundary.
    alerts: tuple[Alert, ...]
    autopilot: AutopilotValues | None = None  #: What the pooled flights propose to the autopilot; None of nothing.
    #: Of the pooled flights those that joint models can use; empty where they are fewer than two.
    joint: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()  #: What is unusual about the series of flights, and how it was handled.
