"""One parameter over the flights of a craft: its mean, its scatter between flights, a slope and a step, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.fleet.meta_analysis import MetaRegression, meta_regression
from sysid.rotors.thrust_regression import AIR_SIGMA

Floats = NDArray[np.float64]

#: Chance of any false alarm among all questions about one craft.
ALPHA = 0.05

#: Fewest flights for a slope or a step, and on either side of a step: with fewer, one strange flight makes either.
FEWEST, FEWEST_ASIDE = 4, 2


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A flight's own value of a parameter with its standard error; `number` counts the craft's flights from 1."""

    flight: str
    number: int
    start_utc: str | None
    value: float
    sigma: float

    def to_dict(self) -> dict[str, Any]:
        """Give numbers for JSON."""
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
        """Give numbers for JSON."""
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
        """Give numbers for JSON."""
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
        """Give numbers and text for JSON."""
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


def history(parameter: str, unit: str, methods: Mapping[str, Sequence[Point]]) -> History:
    """Follow one parameter by the method that most flights have it by, the surest of those.

    Parameters
    ----------
    parameter, unit : str
    methods : mapping of str to sequence of Point
        What each method says of the flights, in their order; at least two points of one of them.
    """
    method = min(methods, key=lambda each: (-len(methods[each]), float(np.median([p.sigma for p in methods[each]]))))
    points = tuple(methods[method])
    values, sigmas = np.array([p.value for p in points]), np.array([p.sigma for p in points])
    together = meta_regression(values, sigmas)
    mean, mean_sigma, _ = together.test([1.0])
    return History(
        parameter=parameter,
        unit=unit,
        method=method,
        points=points,
        mean=mean,
        mean_sigma=mean_sigma,
        between=together.tau,
        q=together.q,
        q_p=together.q_p,
        i2=together.i2,
        trend=_trend(points, values, sigmas),
        step=_step(points, values, sigmas, together),
        others={name: tuple(others) for name, others in methods.items() if name != method},
    )


def design_of(points: Sequence[Point], change: Trend | Step) -> Floats:
    """Give the design in which a change of this kind, and at this place, is the second coefficient; (n, 2)."""
    numbers = np.array([float(point.number) for point in points])
    x = numbers - numbers.mean() if isinstance(change, Trend) else (numbers >= change.number).astype(np.float64)
    return np.column_stack([np.ones(len(points)), x])


def _trend(points: Sequence[Point], values: Floats, sigmas: Floats) -> Trend | None:
    if len(points) < FEWEST:
        return None

    def slope(x: Floats) -> tuple[float, float, float]:
        design = np.column_stack([np.ones(len(x)), x - x.mean()])
        return meta_regression(values, sigmas, design).test([0.0, 1.0])

    per_flight, sigma, p = slope(np.array([float(point.number) for point in points]))
    starts = [datetime.fromisoformat(point.start_utc) for point in points if point.start_utc is not None]
    per_day = None
    if len(starts) == len(points):
        days = np.array([(start - starts[0]).total_seconds() / 86400.0 for start in starts])
        per_day = slope(days)[0] if np.ptp(days) > 1.0 else None
    return Trend(per_flight=per_flight, per_flight_sigma=sigma, per_day=per_day, p=p)


def _step(points: Sequence[Point], values: Floats, sigmas: Floats, together: MetaRegression) -> Step | None:
    """Find the likeliest place of a step and judge it there."""
    places = range(FEWEST_ASIDE, len(points) - FEWEST_ASIDE + 1)
    if len(points) < FEWEST:
        return None
    weights = together.weights
    before, total = np.cumsum(weights), weights.sum()
    sums = np.cumsum(weights * values)
    gains = {
        k: (sums[k - 1] / before[k - 1] - (sums[-1] - sums[k - 1]) / (total - before[k - 1])) ** 2
        * before[k - 1]
        * (1.0 - before[k - 1] / total)
        for k in places
    }
    at = max(gains, key=lambda k: gains[k])
    design = np.column_stack([np.ones(len(points)), np.arange(len(points)) >= at])
    change, sigma, p = meta_regression(values, sigmas, design).test([0.0, 1.0])
    return Step(
        before=points[at - 1].flight,
        after=points[at].flight,
        number=points[at].number,
        change=change,
        sigma=sigma,
        p=min(1.0, p * len(places)),
    )


def sentence_of(each: History, questions: int) -> str:
    """Say of one parameter what it is, how it scatters, and whether it changed."""
    unit = each.unit.split(",")[0]
    n = len(each.points)
    text = f"{each.parameter}: {each.mean:.4g} ± {each.mean_sigma:.1g} {unit}".rstrip() + f" over {n} flights"
    typical = float(np.median([point.sigma for point in each.points]))
    if each.q_p < ALPHA and each.between > 0.0:
        text += f"; flights differ by {_of(each.between, each)} beyond their own errors of {_of(typical, each)}"
        if each.parameter == "thrust over mass" and each.between < AIR_SIGMA * abs(each.mean):
            text += f" (the temperature of the air, which no log tells, makes up to {100.0 * AIR_SIGMA:.1f} %)"
    else:
        text += f"; flights differ by no more than their own errors of {_of(typical, each)}"
    change = each.change
    if isinstance(change, Trend):
        way = "rises" if change.per_flight > 0.0 else "falls"
        span = each.points[-1].number - each.points[0].number
        text += (
            f"; it {way} by {_of(abs(change.per_flight), each)} ± {_of(change.per_flight_sigma, each)} per flight, "
            f"{_of(abs(change.per_flight) * span, each)} in all (p = {change.p_adjusted:.1g} after correction for "
            f"{questions} questions)"
        )
    elif isinstance(change, Step):
        way = "rose" if change.change > 0.0 else "fell"
        text += (
            f"; between {change.before} and {change.after} it {way} by {_of(abs(change.change), each)} ± "
            f"{_of(change.sigma, each)} (p = {change.p_adjusted:.1g} after correction for {questions} questions)"
        )
    elif each.trend is not None:
        text += f"; no change over flights is seen (slope {_signed(each.trend.per_flight, each)} ± "
        text += f"{_of(each.trend.per_flight_sigma, each)} per flight)"
    else:
        text += f"; {FEWEST} flights are needed to tell a change"
    return text


def _of(size: float, each: History) -> str:
    """Write a size as a part of the mean, or in the unit where the mean is no measure (near zero, or trims)."""
    if abs(each.mean) > 5.0 * max(each.between, each.mean_sigma):
        return f"{100.0 * size / abs(each.mean):.2g} %"
    return f"{size:.2g} {each.unit.split(',')[0]}".strip()


def _signed(value: float, each: History) -> str:
    return f"{'+' if value >= 0.0 else '-'}{_of(abs(value), each)}"
