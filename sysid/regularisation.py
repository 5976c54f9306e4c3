"""Choosing how strongly to hold numerators back, by flight time that the trial fits have not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid.experiment import Floats
from sysid.response import INITIAL_SECONDS, free_run
from sysid.separable import Point, Problem, descend

#: Candidates, strongest first: the fits continue from one to the next.
RIDGES = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6)

#: Used where there is too little data to hold any back.
CAUTIOUS = 1e-2

#: Steps of the trial fits.
TRIAL_STEPS = 6

#: Part of a single record that the trial fits see, as for the held-out part of a single log.
SEEN = 0.7


@dataclass(frozen=True, slots=True)
class Choice:
    """A ridge, the poles that went with it, and the errors that spoke for it.

    Attributes
    ----------
    ridge : float
    theta : ndarray, shape (groups, n)
    errors : tuple of (float, float)
        Ridge and root-mean-square free-run error on the held-out part, in standard deviations of the output.
    """

    ridge: float
    theta: Floats
    errors: tuple[tuple[float, float], ...]


def choose_ridge(problem: Problem, theta: Floats, deadline: float) -> Choice:
    """Fit with every candidate to a part of the data and keep the one whose free run is best on the rest.

    The strongest candidate within 2 % of the best wins: differences below that are chance.
    """
    seen, unseen = _divide(problem)
    if not unseen:
        return Choice(CAUTIOUS, theta, ())
    errors, thetas = [], []
    trial = replace(
        problem,
        inputs=tuple(problem.inputs[r][rows] for r, rows in seen),
        outputs=tuple(problem.outputs[r][rows] for r, rows in seen),
    )
    for ridge in RIDGES:
        descent = descend(replace(trial, ridge=ridge), theta, TRIAL_STEPS, deadline)
        theta = descent.point.theta
        squares = [
            _free_run_errors(problem, descent.point, problem.inputs[r][rows], problem.outputs[r][rows])
            for r, rows in unseen
        ]
        errors.append(float(np.sqrt(np.mean(np.concatenate(squares)))))
        thetas.append(theta)
    best = next(k for k, error in enumerate(errors) if error <= 1.02 * min(errors))
    return Choice(RIDGES[best], thetas[best], tuple(zip(RIDGES, errors, strict=True)))


def _divide(problem: Problem) -> tuple[list[tuple[int, slice]], list[tuple[int, slice]]]:
    """Hold back every third record, or the end of a single one when that leaves enough of it."""
    count = len(problem.outputs)
    if count >= 3:
        held = set(range(2, count, 3))
        return (
            [(r, slice(None)) for r in range(count) if r not in held],
            [(r, slice(None)) for r in held],
        )
    seen, unseen = [], []
    for r, y in enumerate(problem.outputs):
        at = round(SEEN * len(y))
        if (len(y) - at) * problem.dt < 4.0 * INITIAL_SECONDS:
            return [], []
        seen.append((r, slice(0, at)))
        unseen.append((r, slice(at, None)))
    return seen, unseen


def _free_run_errors(problem: Problem, point: Point, u: Floats, y: Floats) -> Floats:
    n, unit = problem.order, point.system.unit
    numerators, denominators = [], []
    for j, g in enumerate(problem.group):
        powers = unit[g] ** (n - np.arange(problem.numerators))
        numerators.append((point.numerators[:, j] * powers)[::-1])
        denominators.append(np.concatenate([[1.0], (point.system.a[g] * unit[g] ** np.arange(n, 0, -1))[::-1]]))
    sigma = max(float(np.sqrt(np.mean(np.concatenate(point.residuals) ** 2))), 1e-6)
    predicted = free_run(
        numerators,
        denominators,
        u - u.mean(axis=0),
        y,
        y[0],
        problem.dt,
        problem.hold,
        shared=problem.groups == 1,
        sigma=sigma,
        initial_sigma=sigma / np.sqrt(problem.initial),
    )
    return np.asarray((y - predicted)[round(INITIAL_SECONDS / problem.dt) :] ** 2)
