"""Wind and thrust scale of one flight, for a craft whose parameters are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from logparse import Finding, Severity
from sysid.records.experiment import Floats
from sysid.rigid_body.conditions.carried import (
    ANY_FLIGHT,
    ANY_SIGMA,
    FIXED,
    HIGHEST,
    LOWEST,
    WIND_SIGMA,
    Carried,
    carry_states,
)
from sysid.rigid_body.conditions.wind import LIGHT, TURBULENCE, FlightTrim
from sysid.rigid_body.methods.systematic import wind_error
from sysid.rigid_body.motion.body_motion import OWN, SHARED, Motion, velocity_increments
from sysid.rotors.thrust_regression import AIR_SIGMA

#: Departure of a thrust scale from 1, in standard deviations of what air temperature explains, that is a finding.
UNUSUAL = 2.5

#: Standard deviations that exponent and thrust scale of a flight have at best: where the ground is, how the wind grows
#: with height above it and how the air departs from the standard are not known better. So is the wind, in parts of its
#: speed, but for this, m/s: winds carried through 13 firmware flights err by up to 4 % of 0.8 m/s, by nothing in calm.
_EXPONENT_AT_BEST, _SCALE_AT_BEST, _WIND_AT_BEST, _CALM_AT_BEST = 0.02, 1e-3, 0.02, 0.002

#: Time between the points of a path that a free run is matched at, and how well positions are known at best, m.
PATH_SECONDS, SMALLEST_SIGMA = 1.0, 1e-4

#: Step of thrust scale and wind, m/s, that the slopes of a path are differences over.
_STEP = 1e-5

#: Place of the first wind coefficient among the parameters of a flight.
_WIND = len(OWN)


def trim_prior() -> tuple[Floats, Floats, Floats, Floats]:
    """Return mean, sigma and limits of a training flight's exponent, thrust scale and wind.

    Flights that are fitted together are of one load, so that air temperature is what their thrust may differ by.
    """
    return ANY_FLIGHT, np.array([ANY_SIGMA[0], AIR_SIGMA, WIND_SIGMA, WIND_SIGMA]), LOWEST, HIGHEST


def early_trim(flight: Motion, shared: Floats, law: int, source: str, doubt: Floats | None = None) -> FlightTrim:
    """Find wind and thrust scale from the beginning of a flight, for what comes after it.

    They are what a filter that knows gusts for gusts expects of the rest of the flight: matching one free run would
    take every gust for the mean, and paths that are tens of metres off for noise that prior knowledge outvotes.

    `doubt` is the covariance of the craft's parameters, which a trim makes up for; none if None.
    """
    told = carry_states(flight, shared, law)
    trim = trim_from(told.own[-1], _stated(flight, shared, law, told, told.own[-1], doubt), np.zeros(0), source)
    return with_attitude(replace(trim, looked_until=float(flight.t[-1])), flight, shared, law, _in_runs(told))


def whole_trim(
    flight: Motion, shared: Floats, law: int, source: str, spacing: float | None, doubt: Floats | None = None
) -> FlightTrim:
    """Match the free run over a whole flight from the measured initial state by wind and thrust scale alone.

    The start and the wind's exponent are those of the filter (`early_trim`), and so are standard errors, because one
    free run has no scatter to tell errors from; what lies between the two is added.
    """
    told = carry_states(flight, shared, law)
    own = match_path(flight, shared, told.own[-1], law, np.zeros(0))
    covariance = _stated(flight, shared, law, told, own, doubt)
    knots = wind_knots(flight.t, spacing)
    if len(knots) > 0:
        own = match_path(flight, shared, own, law, knots)
    return with_attitude(trim_from(own, covariance, knots, source), flight, shared, law, _in_runs(told))


def match_path(flight: Motion, shared: Floats, start: Floats, law: int, knots: Floats) -> Floats:
    """Find thrust scale and wind, (4 + 2 k,), by which the free run is nearest to the measured path.

    The wind's exponent stays; winds at the k `knots` depart from the mean as far as turbulence lets them.
    """
    shapes = wind_shapes(flight.t, knots)
    gust = TURBULENCE * max(float(np.hypot(*start[_WIND:])), LIGHT)
    every = max(round(PATH_SECONDS / flight.dt), 1)
    first = np.concatenate([start[1:], np.zeros(2 * len(knots))])

    def missed(own: Floats) -> Floats:
        run = flight.run(np.concatenate([shared, start[:1], own]), shapes, law)
        return np.asarray((run[::every, :3] - flight.position[::every]).ravel())

    spread = max(float(np.sqrt(np.mean(missed(first) ** 2))), SMALLEST_SIGMA) if len(knots) else 1.0

    def weighted(own: Floats) -> Floats:
        return np.concatenate([missed(own) / spread, own[3:] / gust])

    more = np.full(2 * len(knots), HIGHEST[-1])
    limits = np.concatenate([LOWEST[1:], -more]), np.concatenate([HIGHEST[1:], more])
    scales = np.concatenate([[0.01], np.ones(len(first) - 1)])
    # A path is nearly linear in the wind, so that its slopes at the start serve for all steps.
    slopes = scipy.optimize.approx_fprime(first, weighted, _STEP)

    def slope(_: Floats) -> Floats:
        return slopes

    found = scipy.optimize.least_squares(weighted, first, slope, bounds=limits, x_scale=scales, ftol=1e-3)
    return np.concatenate([start[:1], found.x])


def with_attitude(
    trim: FlightTrim, flight: Motion, shared: Floats, law: int, in_runs: tuple[float, float, float]
) -> FlightTrim:
    """Return a trim with the attitude's error in the standard error of its wind, and with those for runs."""
    wind = np.array([trim.wind_n, trim.wind_e])
    blocks = velocity_increments(flight, np.array([*shared, trim.wind_exponent, trim.thrust_scale, *wind]), law)
    by_wind = blocks.jacobian[:, :2, SHARED + _WIND :].mean(axis=0)
    error = wind_error(flight, wind, float(np.sqrt(abs(np.linalg.det(by_wind)))) / blocks.seconds)
    known = 1.0 / (trim.wind_sigma**2 + error**2) + 1.0 / WIND_SIGMA**2  # nothing is known worse than beforehand
    return replace(trim, wind_sigma=float(known**-0.5), in_runs=in_runs)


def known_at_best(wind: Floats) -> Floats:
    """Return the least standard deviations of exponent, thrust scale and wind, (4,), in a wind [m/s], (2,)."""
    best = float(np.hypot(_CALM_AT_BEST, _WIND_AT_BEST * np.hypot(*wind)))
    return np.array([_EXPONENT_AT_BEST, _SCALE_AT_BEST, best, best])


def _in_runs(told: Carried) -> tuple[float, float, float]:
    """Return standard errors of what a filter found of a flight with the craft's parameters held."""
    variance = np.diag(told.covariances[-1])[:FIXED] + known_at_best(told.own[-1, _WIND:]) ** 2
    exponent, scale, north, east = np.sqrt(variance).tolist()
    return exponent, scale, max(north, east)


def _stated(flight: Motion, shared: Floats, law: int, told: Carried, own: Floats, doubt: Floats | None) -> Floats:
    """Mean squares of errors of the exponent, thrust scale and wind that were found of a flight; shape (4, 4)."""
    if doubt is not None:
        told = carry_states(flight, shared, law, doubt=doubt)
    apart = own - told.own[-1]
    at_best = np.diag(known_at_best(own[_WIND:]) ** 2)
    return np.asarray(told.covariances[-1][:FIXED, :FIXED] + np.outer(apart, apart) + at_best)


def trim_from(values: Floats, covariance: Floats, knots: Floats, source: str) -> FlightTrim:
    """Name thrust scale and wind coefficients of one flight; the mean of the variation goes to the mean wind.

    `values` are exponent, scale, mean wind and the departures at k knots, (4 + 2 k,); `covariance` is of all, or of the
    first four.
    """
    exponent, scale = map(float, values[:_WIND])
    mean, parts = values[_WIND : _WIND + 2], values[_WIND + 2 :].reshape(-1, 2)
    # Each knot stands for the time about it.
    width = np.gradient(knots) if len(knots) > 1 else np.ones(len(knots))
    if len(knots) > 1:
        width[[0, -1]] *= 0.5
    share = width / width.sum() if len(knots) else width
    average = share @ parts if len(knots) else np.zeros(2)
    sigma = []
    for axis in range(2):
        weights = np.zeros(len(covariance))
        weights[_WIND + axis] = 1.0
        if len(weights) > _WIND + 2:
            weights[_WIND + 2 + axis :: 2] = share
        sigma.append(np.sqrt(max(float(weights @ covariance @ weights), 0.0)))
    north, east = mean + average
    exponent_sigma, scale_sigma = np.sqrt(np.maximum(np.diag(covariance)[:_WIND], 0.0))
    return FlightTrim(
        wind_n=float(north),
        wind_e=float(east),
        wind_sigma=float(max(sigma)),
        in_runs=(float(exponent_sigma), float(scale_sigma), float(max(sigma))),
        thrust_scale=scale,
        thrust_scale_sigma=float(scale_sigma),
        source=source,
        wind_exponent=exponent,
        wind_exponent_sigma=float(exponent_sigma),
        variation=tuple((float(t), float(n), float(e)) for t, (n, e) in zip(knots, parts - average, strict=True)),
    )


def unusual_thrust(flight: str, trim: FlightTrim) -> Finding | None:
    """Return a finding where the thrust scale of a flight is not what air temperature explains."""
    departure, sigma = trim.thrust_scale - 1.0, float(np.hypot(AIR_SIGMA, trim.thrust_scale_sigma))
    if abs(departure) <= UNUSUAL * sigma:
        return None
    heavier = "less" if departure < 0.0 else "more"
    return Finding(
        "thrust-differs",
        Severity.WARNING,
        f"at the same commands the thrust per mass of {flight} is {100.0 * abs(departure):.1f} % {heavier} than that "
        f"of the flights fitted, {abs(departure) / sigma:.1f} times what air temperature explains: another payload, "
        "battery or propellers, or another craft",
        "weigh the craft and check battery and propellers; fit flights of one load together",
        {"flight": flight, "thrust_scale": trim.thrust_scale, "sigma": trim.thrust_scale_sigma},
    )


def wind_knots(t: Floats, spacing: float | None) -> Floats:
    """Place the points in time of a varying wind; none for a constant one."""
    if spacing is None:
        return np.zeros(0)
    count = max(round((t[-1] - t[0]) / spacing), 1)
    return np.linspace(t[0], t[-1], count + 1)


def wind_shapes(t: Floats, knots: Floats) -> Floats:
    """Arrange how the wind varies: a constant, and a triangle of height 1 about each knot; shape (N, 1 + knots)."""
    shapes = np.ones((len(t), 1 + len(knots)))
    for column, row in enumerate(np.eye(len(knots)), start=1):
        shapes[:, column] = np.interp(t, knots, row)
    return shapes
