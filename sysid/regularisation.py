"""Choosing how strongly to hold numerators back, by flight time that the trial fits have not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sysid.experiment import Floats
from sysid.response import INITIAL_SECONDS, free_run
from sysid.separable import Point, Problem, descend

#: Candidates, strongest first. The strongest leaves next to nothing of the inputs' effect: what a black box should say
#: of an output that the inputs do not explain.
RIDGES = (100.0, 10.0, 1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-6)

#: Used where there is too little data to hold any back.
CAUTIOUS = 1e-2

#: Steps of the trial fits.
TRIAL_STEPS = 6

#: Part of a single record that the trial fits see, as for the held-out part of a single log.
SEEN = 0.7


@dataclass(frozen=True, slots=True)
class Division:
    """A problem without the flight time held back, and that flight time.

    Attributes
    ----------
    seen : Problem
    held_back : tuple of (ndarray, ndarray)
        Inputs and output of each part held back; empty where there is too little to hold any back.
    """

    seen: Problem
    held_back: tuple[tuple[Floats, Floats], ...]


def divide(problem: Problem) -> Division:
    """Hold back every third record, or the last part of each when there are fewer than three."""
    count = len(problem.outputs)
    seen: list[tuple[int, slice]] = [(r, slice(None)) for r in range(count) if r % 3 != 2]
    unseen: list[tuple[int, slice]] = [(r, slice(None)) for r in range(2, count, 3)]
    if count < 3:
        cuts = [round(SEEN * len(y)) for y in problem.outputs]
        if min(len(y) - at for y, at in zip(problem.outputs, cuts, strict=True)) * problem.dt < 4.0 * INITIAL_SECONDS:
            return Division(problem, ())
        seen = [(r, slice(0, at)) for r, at in enumerate(cuts)]
        unseen = [(r, slice(at, None)) for r, at in enumerate(cuts)]
    return Division(
        replace(
            problem,
            inputs=tuple(problem.inputs[r][rows] for r, rows in seen),
            outputs=tuple(problem.outputs[r][rows] for r, rows in seen),
        ),
        tuple((problem.inputs[r][rows], problem.outputs[r][rows]) for r, rows in unseen),
    )


def choose_ridge(division: Division, theta: Floats, deadline: float) -> tuple[float, Floats]:
    """Fit with every candidate and keep the one whose free run is best on the part held back.

    The strongest candidate within 2 % of the best wins: smaller differences are chance.

    Parameters
    ----------
    division : Division
    theta : ndarray, shape (groups, n)
        Poles to start from, found without the part held back.
    deadline : float
        On `time.monotonic`.

    Returns
    -------
    ridge : float
    theta : ndarray, shape (groups, n)
        Poles that went with it.
    """
    if not division.held_back:
        return CAUTIOUS, theta
    errors, thetas = [], []
    for ridge in RIDGES:
        point = descend(replace(division.seen, ridge=ridge), theta, TRIAL_STEPS, deadline).point
        squares = [_free_run_errors(division.seen, point, u, y) for u, y in division.held_back]
        errors.append(float(np.sqrt(np.mean(np.concatenate(squares)))))
        thetas.append(point.theta)
    best = next(k for k, error in enumerate(errors) if error <= 1.02 * min(errors))
    return RIDGES[best], thetas[best]


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
