"""Wind and thrust scale of one flight, for a craft whose parameters are known."""

from __future__ import annotations

import numpy as np

from sysid.body_motion import SHARED, Motion
from sysid.experiment import Floats
from sysid.output_error import WINDOW_SECONDS, Prior, fit_output_error
from sysid.thrust_regression import AIR_SIGMA
from sysid.wind import LIGHT, TURBULENCE, FlightTrim, wind_knots, wind_shapes

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
    sigma = np.sqrt(np.diag(windowed.covariance))[SHARED:]
    scale, north, east = free.values[SHARED:]
    knots = wind_knots(flight.t, spacing)
    variation: tuple[tuple[float, float, float], ...] = ()
    if len(knots):
        shapes = wind_shapes(flight.t, knots)
        start = np.concatenate([free.values, np.zeros(2 * len(knots))])
        prior = _prior(shared, 1 + len(knots), float(np.hypot(north, east)))
        varying = fit_output_error([flight], [shapes], start, prior, law=law, window_seconds=None)
        scale, north, east = varying.values[SHARED : SHARED + 3]
        parts = varying.values[SHARED + 3 :].reshape(-1, 2)
        variation = tuple((float(t), float(n), float(e)) for t, (n, e) in zip(knots, parts, strict=True))
    return FlightTrim(
        wind_n=float(north),
        wind_e=float(east),
        wind_sigma=float(max(sigma[1:])),
        thrust_scale=float(scale),
        thrust_scale_sigma=float(sigma[0]),
        source=source,
        variation=variation,
    )


def _prior(shared: Floats, shapes: int, wind: float) -> Prior:
    mean, sigma, low, high = trim_prior(shapes, wind)
    return Prior(
        np.concatenate([shared, mean]),
        np.concatenate([np.zeros(SHARED), sigma]),
        np.concatenate([shared, low]),
        np.concatenate([shared, high]),
    )
