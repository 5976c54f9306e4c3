"""Covariance of a solution's parameters under coloured residuals, what their errors cost, and regularisation.

How strongly numerators are held back is chosen by flight time that the trial fits have not seen.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from sysid.records.experiment import Floats
from sysid.statistics.covariance import coloured_information, residual_colour
from sysid.transfer_functions.problem import FitProblem
from sysid.transfer_functions.reduction import basis_at, eliminate, own_eliminated, sum_of
from sysid.transfer_functions.response import INITIAL_SECONDS
from sysid.transfer_functions.separable import Point, descend, reduced_information, sensitivities, with_ridge


def parameter_covariance(problem: FitProblem, point: Point) -> Floats:
    """Covariance of normalised numerators, poles' parameters and delays, for coloured residuals, at the solution.

    The sandwich ``H^-1 M H^-1`` with the information H in the data and M the covariance of the regressors' products
    with a residual of the colour found (Ljung 1999, section 9.5). Regularisation is no information: what it alone
    decides has a large covariance. What is not estimated has none.
    """
    inverse, filling, size, _ = _sandwich(problem, point)
    return np.asarray((inverse @ filling @ inverse) * size * size[:, None])


def effective_parameters(problem: FitProblem, point: Point) -> float:
    """Count the parameters in what their errors cost: ``trace(H^-1 M)`` over the residual's variance.

    On new data the squared error of the fit exceeds the least possible one by this many residual variances (Takeuchi
    1976); with white residuals it is the number of parameters.
    """
    inverse, filling, _, variance = _sandwich(problem, point)
    return float(np.sum(inverse * filling)) / max(variance, 1e-300)


def _sandwich(problem: FitProblem, point: Point) -> tuple[Floats, Floats, Floats, float]:
    """Inverse of H and M, both scaled to a unit diagonal of H; the scale, and the residual's variance."""
    jacobians = sensitivities(problem, point)
    information = reduced_information(problem, point, jacobians)
    colour = residual_colour(point.residuals)
    estimated = np.diag(information) > 0.0
    freedom = max(problem.samples - int(estimated.sum()), 1)
    colour = colour * (problem.samples / freedom)
    size = np.where(estimated, 1.0 / np.sqrt(np.where(estimated, np.diag(information), 1.0)), 0.0)
    # A trace of white prior keeps directions without information finite, and their covariance huge.
    trace = 1e-11 * np.eye(len(size))
    bread = information * size * size[:, None] + trace + np.diag((~estimated).astype(np.float64))
    reduced = [own_eliminated(part, columns) for part, columns in zip(point.parts, jacobians, strict=True)]
    filling = coloured_information(reduced, colour)
    filling = filling * size * size[:, None] + colour[0] * trace
    return np.asarray(np.linalg.inv(bread)), np.asarray(filling), size, float(colour[0])


#: Candidates, weakest first. The strongest leaves next to nothing of the inputs' effect: what a black box should say
#: of an output that the inputs do not explain.
RIDGES = (1e-6, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)


@dataclass(frozen=True, slots=True)
class Division:
    """A problem without the flight time held back, and that flight time."""

    seen: FitProblem
    #: Inputs about their mean over each part held back, and outputs; None where there is too little to hold any back.
    held_back: FitProblem | None


@dataclass(frozen=True, slots=True)
class Choice:
    """A ridge, and the poles and delays that went with it."""

    ridge: float
    theta: Floats  #: shape (groups, lags)
    delays: Floats  #: shape (m,): s.
    steps: int  #: Taken on the way.


def divide(problem: FitProblem) -> Division:
    """Hold back every third record, or the last part of each when there are fewer than three."""
    count = len(problem.outputs)
    seen: list[tuple[int, slice]] = [(r, slice(None)) for r in range(count) if r % 3 != 2]
    held_out: list[tuple[int, slice]] = [(r, slice(None)) for r in range(2, count, 3)]
    if count < 3:
        cuts = [round(0.7 * len(y)) for y in problem.outputs]
        if min(len(y) - at for y, at in zip(problem.outputs, cuts, strict=True)) * problem.dt < 4.0 * INITIAL_SECONDS:
            return Division(problem, None)
        seen = [(r, slice(0, at)) for r, at in enumerate(cuts)]
        held_out = [(r, slice(at, None)) for r, at in enumerate(cuts)]
    parts = [(problem.inputs[r][rows], problem.outputs[r][rows]) for r, rows in held_out]
    return Division(
        replace(
            problem,
            inputs=tuple(problem.inputs[r][rows] for r, rows in seen),
            outputs=tuple(problem.outputs[r][rows] for r, rows in seen),
        ),
        replace(problem, inputs=tuple(u - u.mean(axis=0) for u, _ in parts), outputs=tuple(y for _, y in parts)),
    )


def choose_ridge(division: Division, theta: Floats, delays: Floats, deadline: float) -> Choice:
    """Keep the candidate whose free run is best on the part held back.

    There, offset and initial state are the likeliest ones, and an initial state has its price, so that numerators and
    poles are judged and not how well three seconds tell the initial state. At given poles all candidates share one sum
    of normal equations over what was seen, and one over what was not. Poles follow one candidate after the other,
    weakest first, until none stronger would be better there.
    """
    if division.held_back is None:
        # Too little data to hold any back.
        return Choice(1e-2, theta, delays, 0)
    best, least = Choice(RIDGES[0], theta, delays, 0), np.inf
    place, steps = 0, 0
    descent = descend(replace(division.seen, ridge=RIDGES[0]), theta, 6, deadline, delays)
    while True:
        point, steps = descent.point, steps + descent.iterations
        errors = _errors(division, point)
        # Ties go to the weaker candidate: regularisation that does not improve must not bias.
        if errors[place] < (1.0 - 1e-3) * least:
            best, least = Choice(RIDGES[place], point.theta, point.delays, steps), errors[place]
        foreseen = int(np.argmin(errors))
        if foreseen <= place or time.monotonic() > deadline:
            return replace(best, steps=steps)
        # One after the other, for poles move with the candidate; but not through many that are far from any good.
        place = foreseen if foreseen > place + 3 else place + 1
        problem = replace(division.seen, ridge=RIDGES[place])
        descent = descend(problem, with_ridge(problem, point), 4, deadline)


def _errors(division: Division, point: Point) -> list[float]:
    """Return for each candidate at a point squared residual plus price of the unseen division's initial states."""
    assert division.held_back is not None
    seen = division.seen
    held = replace(division.held_back, initial=seen.initial, group=seen.group, orders=seen.orders)
    basis = basis_at(held, point.theta, point.delays)
    judged = sum_of([eliminate(held, basis, u, y).information for u, y in zip(held.inputs, held.outputs, strict=True)])
    errors, shared = [], replace(point, parts=())  # what records have of their own is not asked for
    for ridge in RIDGES:
        error = np.append(with_ridge(replace(seen, ridge=ridge), shared).numerators.ravel(), -1.0)
        errors.append(float(error @ judged @ error))
    return errors
