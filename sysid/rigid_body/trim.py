"""Wind and thrust scale of one flight, for a craft whose parameters are known."""

from __future__ import annotations

import numpy as np

from sysid.records.experiment import Floats
from sysid.rigid_body.body_motion import SHARED, Motion
from sysid.rigid_body.output_error import WINDOW_SECONDS, Prior, fit_output_error
from sysid.rigid_body.wind import LIGHT, TURBULENCE, FlightTrim, wind_knots, wind_shapes
from sysid.rotors.thrust_regression import AIR_SIGMA

#: Winds in which multirotors fly: standard deviation of each component, m/s.
WIND_SIGMA = 6.0

#: Fewest windows from which the standard errors of a trim are told.
_WINDOWS = 6


def trim_prior(shapes: int, wind: float) -> tuple[Floats, Floats, Floats, Floats]:
    """Mean, sigma and limits of thrust scale and wind coefficients of a flight in a mean wind [m/s]."""
    gust = TURBULENCE * max(wind, LIGHT)
    mean = np.concatenate([[1.0], np.zeros(2 * shapes)])
    sigma = np.concatenate([[AIR_SIGMA, WIND_SIGMA, WIND_SIGMA], np.full(2 * (shapes - 1), gust)])
    reach = np.concatenate([[0.5], np.full(2 * shapes, 50.0)])
    return mean, sigma, mean - reach, mean + reach


def fit_trim(flight: Motion, shared: Floats, law: int, source: str, spacing: float | None) -> FlightTrim:
    """Match the free run from the measured initial state by wind and thrust scale alone.

    Standard errors are those of a fit over windows, because one free run has no scatter to tell them from.

    Parameters
    ----------
    flight : Motion
    shared : ndarray
        Parameters of the craft, in the order of `body_motion.THETA`.
    law : int
        Of drag.
    source : str
        For the result.
    spacing : float or None
        Time between the points of a varying wind, s; None for a constant one.
    """
    start = np.concatenate([shared, [1.0, 0.0, 0.0]])
    window = min(WINDOW_SECONDS, (flight.t[-1] - flight.t[0]) / _WINDOWS)
    shapes, prior = wind_shapes(flight.t, np.zeros(0)), _prior(shared, 1, 0.0)
    windowed = fit_output_error([flight], [shapes], start, prior, law=law, window_seconds=window)
    free = fit_output_error([flight], [shapes], windowed.values, prior, law=law, window_seconds=None)
    own = slice(SHARED, SHARED + 3)
    covariance = windowed.covariance[own, own]
    knots = wind_knots(flight.t, spacing)
    if len(knots) == 0:
        return trim_from(free.values[own], covariance, knots, source)
    shapes = wind_shapes(flight.t, knots)
    start = np.concatenate([free.values, np.zeros(2 * len(knots))])
    prior = _prior(shared, 1 + len(knots), float(np.hypot(*free.values[own][1:])))
    varying = fit_output_error([flight], [shapes], start, prior, law=law, window_seconds=None)
    return trim_from(varying.values[SHARED:], covariance, knots, source)


def trim_from(values: Floats, covariance: Floats, knots: Floats, source: str) -> FlightTrim:
    """Name thrust scale and wind coefficients of one flight; the mean of the variation goes to the mean wind.

    Parameters
    ----------
    values : ndarray, shape (3 + 2 k,)
        Thrust scale, mean wind north and east, then the departures at each of k knots.
    covariance : ndarray, shape (3 + 2 k, 3 + 2 k) or (3, 3)
        Of all values, or of the first three.
    knots : ndarray, shape (k,)
        s.
    source : str
    """
    scale, mean = float(values[0]), values[1:3]
    parts = values[3:].reshape(-1, 2)
    # Each knot stands for the time about it.
    width = np.gradient(knots) if len(knots) > 1 else np.ones(len(knots))
    if len(knots) > 1:
        width[[0, -1]] *= 0.5
    share = width / width.sum() if len(knots) else width
    average = share @ parts if len(knots) else np.zeros(2)
    sigma = []
    for axis in range(2):
        weights = np.zeros(len(covariance))
        weights[1 + axis] = 1.0
        if len(weights) > 3:
            weights[3 + axis :: 2] = share
        sigma.append(np.sqrt(max(float(weights @ covariance @ weights), 0.0)))
    north, east = mean + average
    return FlightTrim(
        wind_n=float(north),
        wind_e=float(east),
        wind_sigma=float(max(sigma)),
        thrust_scale=scale,
        thrust_scale_sigma=float(np.sqrt(max(covariance[0, 0], 0.0))),
        source=source,
        variation=tuple((float(t), float(n), float(e)) for t, (n, e) in zip(knots, parts - average, strict=True)),
    )


def _prior(shared: Floats, shapes: int, wind: float) -> Prior:
    mean, sigma, low, high = trim_prior(shapes, wind)
    return Prior(
        np.concatenate([shared, mean]),
        np.concatenate([np.zeros(SHARED), sigma]),
        np.concatenate([shared, low]),
        np.concatenate([shared, high]),
    )
