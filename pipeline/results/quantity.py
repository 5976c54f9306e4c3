"""Numbers for programs and assistants: with unit, error and where they come from, or why they are not determined."""

from __future__ import annotations

from dataclasses import dataclass

from core.quantity import uncertain


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a number comes from."""

    log: str  #: The file; empty for a number over several flights.
    flights: tuple[str, ...]
    #: Stretch of time on the log's boot clock, s; None where several flights or no flight were looked at.
    start_s: float | None
    stop_s: float | None
    method: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A number; `value` is None where `reason` says why it is not determined."""

    name: str
    value: float | None
    sigma: float | None  #: One standard deviation; None where none is known.
    unit: str
    provenance: Provenance
    reason: str = ""  #: "not determined: ..." where there is no value.


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthEvent:
    """What happened in a flight, when, and what to do about it."""

    id: str
    severity: str
    t_s: float | None  #: On the log's boot clock.
    end_s: float | None
    reason: str
    advice: str
    provenance: Provenance


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
