"""Drift: parameters of a craft from flight to flight, and whether a motor weakens; with the review of a craft."""

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
    """A parameter over the flights of a side, with its standard error."""

    value: float
    sigma: float
    flights: int


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterChange:
    """A parameter on both sides, and whether it differs by more than chance."""

    parameter: str
    method: str
    unit: str
    a: Mean
    b: Mean
    between_flights: float | None  #: Standard deviation between flights; None where one on each side cannot tell.
    difference: float
    difference_sigma: float
    #: In percent of the value before, with its 95 % interval; None where that may be zero.
    difference_percent: float | None
    interval_percent: tuple[float, float] | None
    detectable_percent: float | None  #: Change that would have been found four times out of five.
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
    """Steady change: slope per flight, with its standard error and probability."""

    per_flight: float
    per_flight_sigma: float
    p: float
    p_adjusted: float = 1.0
    significant: bool = False


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


@dataclass(frozen=True, slots=True, kw_only=True)
class Heterogeneity:
    """Cochran's Q, its probability, and the part of the scatter that is not the flights' own errors."""

    q: float
    p: float
    i2: float


@dataclass(frozen=True, slots=True, kw_only=True)
class History:
    """One parameter over the flights of a craft."""

    parameter: str
    unit: str
    method: str
    flights: tuple[FlightPoint, ...]  #: What each says, in their order.
    #: Over flights, with its standard error.
    mean: float
    mean_sigma: float
    between: float  #: Standard deviation between flights beyond their own standard errors.
    heterogeneity: Heterogeneity
    trend: Trend | None = None
    step: Step | None = None
    others: Mapping[str, tuple[FlightPoint, ...]] = field(default_factory=dict)  #: What other methods say, by method.
    sentence: str = ""

    @property
    def change(self) -> Trend | Step | None:
        """The significant change, the likelier where slope and step both are; None without one."""
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
    """What is steadily asked of the motors, over flights."""

    points: tuple[MotorWork, ...]
    weakening: str | None = None  #: The motor that alone explains a change of the trims by losing thrust.
    #: Part of its thrust that it lost: per flight, or at once.
    loss: float | None = None
    sentence: str
    p: float | None = None  #: Chance that trims together look so much like one motor's loss where nothing changes.
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """Everything that was followed over the flights of one craft."""

    order: str  #: ``"date"``, or ``"name"`` where a log does not tell its date.
    flights: tuple[str, ...]  #: In that order.
    parameters: tuple[History, ...]
    motors: MotorDrift | None  #: None where no flight tells what is steadily asked.
    findings: tuple[Finding, ...]
    responses: tuple[ResponseCurve, ...] = ()  #: Of the newest flights, how each axis answers its command.


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftNote:
    """What was done to a craft, as its owner wrote it down."""

    at: datetime  #: UTC.
    text: str
    boundary: bool = False  #: Flights before it are not pooled with those after it.


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """Something that left its band; equal `about` is the same alert, however often it is found."""

    about: str
    id: str  #: As a finding has it.
    severity: Severity
    text: str
    flight: str  #: After which flight it was seen.


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftReview:
    """What the flights of one craft say together without a joint fit: sums over what each says by itself."""

    flights: tuple[str, ...]  #: In order.
    #: Of them those since the last boundary, and among those again the ones built as the newest is.
    pooled: tuple[str, ...]
    boundary: CraftNote | None  #: The last before the newest flight.
    drift: Drift | None  #: Of the pooled flights.
    whole: Drift | None  #: Of all flights, where not all are pooled.
    since: tuple[ParameterChange, ...]  #: What changed with the boundary.
    alerts: tuple[Alert, ...]
    autopilot: AutopilotValues | None = None  #: What the pooled flights propose to the autopilot; None of nothing.
    #: Of the pooled flights those that joint models can use; empty where they are fewer than two.
    joint: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()  #: What about the flights as a series is strange, and what was done about it.
