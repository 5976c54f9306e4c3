"""Covariance of a solution's parameters under coloured residuals, and what their errors cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.records.experiment import Floats
from sysid.records.filtering import lfilter
from sysid.statistics.covariance import coloured_information
from sysid.transfer_functions.problem import Problem
from sysid.transfer_functions.reduction import autoproducts, own_eliminated, sum_of
from sysid.transfer_functions.separable import Point, reduced_information, sensitivities


def parameter_covariance(problem: Problem, point: Point) -> Floats:
    """Covariance of normalised numerators, poles' parameters and delays, for coloured residuals, at the solution.

    The sandwich ``H^-1 M H^-1`` with the information H in the data and M the covariance of the regressors' products
    with a residual of the colour found (Ljung 1999, section 9.5). Regularisation is no information: what it alone
    decides has a large covariance. What is not estimated has none.
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


def residual_colour(residuals: Sequence[Floats]) -> Floats:
    """Estimate the autocovariance of residuals by an autoregressive model whose order Akaike's criterion chooses.

    A fit takes out of its residuals just what resembles its regressors. A sample autocovariance over many lags shows
    that hole in the spectrum and promises errors that are too small, worst for models that integrate; a model of the
    few orders that white or wind-blown residuals need passes over it (den Haan and Levin 1997).
    """
    lengths = tuple(map(len, residuals))
    samples, longest = sum(lengths), max(lengths)
    highest = int(min(round(10.0 * np.log10(samples)), min(lengths) // 4))
    products = sum_of([autoproducts(residual, highest) for residual in residuals])
    gamma = products / samples
    if gamma[0] <= 0.0:
        return gamma[:1]
    # Levinson's recursion gives the models of all orders.
    a, variance = np.zeros(0), float(gamma[0])
    best = (samples * np.log(variance), a)
    for order in range(1, highest + 1):
        reflection = -(gamma[order] + a @ gamma[order - 1 : 0 : -1]) / variance
        a = np.concatenate([a + reflection * a[::-1], [reflection]])
        variance *= 1.0 - reflection**2
        if variance <= 1e-12 * gamma[0]:
            break
        best = min(best, (samples * np.log(variance) + 2.0 * order, a), key=lambda one: one[0])
    a = best[1]
    order = len(a)
    if order == 0:
        return gamma[:1]
    # Beyond its order the model's autocovariance follows its own difference equation.
    past = [-sum(a[i] * gamma[order + j - i] for i in range(j, order)) for j in range(order)]
    following = lfilter([1.0], np.concatenate([[1.0], a]), np.zeros(longest), np.array(past))
    whole = np.concatenate([gamma[: order + 1], following])[:longest]
    lasting = np.flatnonzero(np.abs(whole) > 1e-4 * gamma[0])
    return np.asarray(whole[: lasting[-1] + 1])


def _sandwich(problem: Problem, point: Point) -> tuple[Floats, Floats, Floats, float]:
    """Inverse of H and M, both scaled to a unit diagonal of H; the scale, and the residual's variance."""
    jacobians = sensitivities(problem, point)
    information, _ = reduced_information(problem, point, jacobians)
    colour = residual_colour(point.residuals)
    estimated = np.diag(information) > 0.0
    freedom = max(problem.samples - int(estimated.sum()), 1)
    colour = colour * (problem.samples / freedom)
    size = np.where(estimated, 1.0 / np.sqrt(np.where(estimated, np.diag(information), 1.0)), 0.0)
    # A trace of white prior keeps directions without information finite, and their covariance huge.
    trace = 1e-11 * np.eye(len(size))
    bread = information * size * size[:, None] + trace + np.diag((~estimated).astype(np.float64))
    reduced = [own_eliminated(point.basis, part, columns) for part, columns in zip(point.parts, jacobians, strict=True)]
    filling = coloured_information(reduced, colour)
    filling = filling * size * size[:, None] + colour[0] * trace
    return np.asarray(np.linalg.inv(bread)), np.asarray(filling), size, float(colour[0])
