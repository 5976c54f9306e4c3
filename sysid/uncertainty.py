"""Covariance of a solution's parameters under coloured residuals, and what their errors cost."""

from __future__ import annotations

import numpy as np

from sysid.covariance import autocovariance, coloured_information
from sysid.experiment import Floats
from sysid.separable import Point, Problem, reduced_information, sensitivities

#: Lags of the residual's autocovariance, s.
COLOUR_SECONDS = 20.0


def parameter_covariance(problem: Problem, point: Point) -> Floats:
    """Covariance of normalised numerators, poles' parameters and delays, for coloured residuals, at the solution.

    The sandwich ``H^-1 M H^-1`` with the information H in the data and M the covariance of the regressors' products
    with a residual of the colour found (Ljung 1999, section 9.5). Regularisation is no information: what it alone
    decides has a large covariance. What is not estimated has none.

    Returns
    -------
    ndarray, shape (q, q)
        Numerators power-major, poles parameter-major, delays in samples; see `sysid.separable.sensitivities`.
    """
    inverse, filling, size, _ = _sandwich(problem, point)
    return np.asarray((inverse @ filling @ inverse) * size * size[:, None])


def effective_parameters(problem: Problem, point: Point) -> float:
    """Count the parameters in what their errors cost: ``trace(H^-1 M)`` over the residual's variance.

    On new data the squared error of the fit exceeds the least possible one by this many residual variances (Takeuchi
    1976); with white residuals it is the number of parameters.
    """
    inverse, filling, _, variance = _sandwich(problem, point)
    return float(np.sum(inverse * filling)) / max(variance, 1e-300)


def _sandwich(problem: Problem, point: Point) -> tuple[Floats, Floats, Floats, float]:
    """Inverse of H and M, both scaled to a unit diagonal of H; the scale, and the residual's variance."""
    jacobians = sensitivities(problem, point)
    information, _ = reduced_information(problem, point, jacobians)
    reduced = []
    for z, gram, jacobian, local in zip(point.regressors, point.grams, jacobians, point.local, strict=True):
        locals_ = len(local)
        rest = np.hstack([z[:, locals_:-1], jacobian])
        along = np.hstack([gram[:locals_, locals_:-1], z[:, :locals_].T @ jacobian])
        reduced.append(rest - z[:, :locals_] @ np.linalg.solve(gram[:locals_, :locals_] + point.prior, along))
    lags = max(round(COLOUR_SECONDS / problem.dt), 2)
    lags = min(lags, max(min(len(y) for y in problem.outputs) // 4, 2))
    estimated = np.diag(information) > 0.0
    freedom = max(problem.samples - int(estimated.sum()), 1)
    colour = autocovariance(point.residuals, lags) * problem.samples / freedom
    size = np.where(estimated, 1.0 / np.sqrt(np.where(estimated, np.diag(information), 1.0)), 0.0)
    # A trace of white prior keeps directions without information finite, and their covariance huge.
    trace = 1e-11 * np.eye(len(size))
    bread = information * size * size[:, None] + trace + np.diag((~estimated).astype(np.float64))
    filling = coloured_information(reduced, colour) * size * size[:, None] + colour[0] * trace
    return np.asarray(np.linalg.inv(bread)), np.asarray(filling), size, float(colour[0])
