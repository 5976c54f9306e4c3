"""One parameter over the flights of a craft: its mean, its scatter between flights, a slope and a step, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.fleet.meta_analysis import ALPHA, MetaRegression, meta_regression
from pipeline.results.drift import FlightPoint, Heterogeneity, History, Step, Trend
from sysid.rigid_body.consensus import TRUSTED
from sysid.rotors.thrust_regression import AIR_SIGMA

Floats = NDArray[np.float64]

#: Fewest flights for a slope or a step, and on either side of a step: with fewer, one strange flight makes either.
FEWEST, FEWEST_ASIDE = 4, 2


def history(parameter: str, unit: str, methods: Mapping[str, Sequence[FlightPoint]]) -> History:
    """Follow one parameter by the method that most flights have it by, of those the one that is trusted first.

    The smallest standard error would choose the method that is most often too sure.
    """
    rank = {name: place for place, name in enumerate(TRUSTED)}
    method = min(methods, key=lambda name: (-len(methods[name]), rank.get(name, len(rank))))
    points = tuple(methods[method])
    values, sigmas = np.array([p.value for p in points]), np.array([p.sigma for p in points])
    together = meta_regression(values, sigmas)
    mean, mean_sigma, _ = together.test([1.0])
    return History(
        parameter=parameter,
        unit=unit,
        method=method,
        flights=points,
        mean=mean,
        mean_sigma=mean_sigma,
        between=together.tau,
        heterogeneity=Heterogeneity(q=together.q, p=together.q_p, i2=together.i2),
        trend=_trend(points),
        step=_step(points, values, together),
        others={name: tuple(others) for name, others in methods.items() if name != method},
    )


def fit_change(points: Sequence[FlightPoint], step: int | None) -> MetaRegression:
    """Fit a slope per flight, or a step before the flight of this number; it is the second coefficient."""
    numbers = np.array([float(point.number) for point in points])
    x = numbers - numbers.mean() if step is None else (numbers >= step).astype(np.float64)
    values, sigmas = ([getattr(point, name) for point in points] for name in ("value", "sigma"))
    return meta_regression(values, sigmas, np.column_stack([np.ones(len(points)), x]))


def _trend(points: Sequence[FlightPoint]) -> Trend | None:
    if len(points) < FEWEST:
        return None
    per_flight, sigma, p = fit_change(points, None).test([0.0, 1.0])
    return Trend(per_flight=per_flight, per_flight_sigma=sigma, p=p)


def _step(points: Sequence[FlightPoint], values: Floats, together: MetaRegression) -> Step | None:
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
    change, sigma, p = fit_change(points, points[at].number).test([0.0, 1.0])
    return Step(
        before=points[at - 1].flight,
        after=points[at].flight,
        number=points[at].number,
        change=change,
        sigma=sigma,
        p=min(1.0, p * len(places)),
    )


def sentence_of(history: History, questions: int) -> str:
    """Report of one parameter what it is, how it scatters, and whether it changed."""
    unit = history.unit.split(",")[0]
    n = len(history.flights)
    text = f"{history.parameter}: {history.mean:.4g} ± {history.mean_sigma:.1g} {unit}".rstrip() + f" over {n} flights"
    typical = float(np.median([point.sigma for point in history.flights]))
    if history.heterogeneity.p < ALPHA and history.between > 0.0:
        text += (
            f"; flights differ by {_of(history.between, history)} beyond their own errors of {_of(typical, history)}"
        )
        if history.parameter == "thrust over mass" and history.between < AIR_SIGMA * abs(history.mean):
            text += f" (the temperature of the air, which no log tells, makes up to {100.0 * AIR_SIGMA:.1f} %)"
    else:
        text += f"; flights differ by no more than their own errors of {_of(typical, history)}"
    change = history.change
    if isinstance(change, Trend):
        way = "rises" if change.per_flight > 0.0 else "falls"
        span = history.flights[-1].number - history.flights[0].number
        text += (
            f"; it {way} by {_of(abs(change.per_flight), history)} ± {_of(change.per_flight_sigma, history)} per flight"
            f", {_of(abs(change.per_flight) * span, history)} in all (p = {change.p_adjusted:.1g} after correction for "
            f"{questions} questions)"
        )
    elif isinstance(change, Step):
        way = "rose" if change.change > 0.0 else "fell"
        text += (
            f"; between {change.before} and {change.after} it {way} by {_of(abs(change.change), history)} ± "
            f"{_of(change.sigma, history)} (p = {change.p_adjusted:.1g} after correction for {questions} questions)"
        )
    elif history.trend is not None:
        text += f"; no change over flights is seen (slope {_signed(history.trend.per_flight, history)} ± "
        text += f"{_of(history.trend.per_flight_sigma, history)} per flight)"
    else:
        text += f"; {FEWEST} flights are needed to tell a change"
    return text


def _of(size: float, history: History) -> str:
    """Write a size as a part of the mean, or in the unit where the mean is no measure (near zero, or trims)."""
    if abs(history.mean) > 5.0 * max(history.between, history.mean_sigma):
        return f"{100.0 * size / abs(history.mean):.2g} %"
    return f"{size:.2g} {history.unit.split(',')[0]}".strip()


def _signed(value: float, history: History) -> str:
    return f"{'+' if value >= 0.0 else '-'}{_of(abs(value), history)}"
