"""Choosing how strongly to hold numerators back, by flight time that the trial fits have not seen."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from sysid.experiment import Floats
from sysid.response import INITIAL_SECONDS, trends
from sysid.separable import Point, Problem, descend, initial_prior

#: Candidates, weakest first. The strongest leaves next to nothing of the inputs' effect: what a black box should say
#: of an output that the inputs do not explain.
RIDGES = (1e-6, 1e-4, 1e-3, 1e-2, 1e-1, 1.0, 10.0, 100.0)

#: The search ends when this many candidates in a row were worse than the best: stronger ones will be, too.
WORSE = 2

#: Candidates whose held-out squared errors differ by less than this part are equals, and the weakest is taken.
TIE = 1e-3

#: Used where there is too little data to hold any back.
CAUTIOUS = 1e-2

#: Steps of the first trial fit, and of each that follows, which starts where the one before it ended.
TRIAL_STEPS, FURTHER_STEPS = 6, 4

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


def choose_ridge(division: Division, theta: Floats, delays: Floats, deadline: float) -> tuple[float, Floats, Floats]:
    """Fit with every candidate and keep the one whose free run is best on the part held back.

    There, offset and initial state are the likeliest ones, and an initial state has its price, so that numerators and
    poles are judged and not how well three seconds tell the initial state.

    Parameters
    ----------
    division : Division
    theta : ndarray, shape (groups, lags)
        Poles to start from, found without the part held back.
    delays : ndarray, shape (m,)
        Likewise, s.
    deadline : float
        On `time.monotonic`.

    Returns
    -------
    ridge : float
    theta : ndarray, shape (groups, lags)
    delays : ndarray, shape (m,)
        Poles and delays that went with it.
    """
    if not division.held_back:
        return CAUTIOUS, theta, delays
    best: tuple[float, float, Point] | None = None
    worse, steps = 0, TRIAL_STEPS
    for ridge in RIDGES:
        trial = replace(division.seen, ridge=ridge)
        point = descend(trial, theta, steps, deadline, delays).point
        theta, delays, steps = point.theta, point.delays, FURTHER_STEPS
        error = sum(_held_back_cost(trial, point, u, y) for u, y in division.held_back)
        # Ties go to the weaker candidate: regularisation that does not improve must not bias.
        if best is None or error < (1.0 - TIE) * best[0]:
            best, worse = (error, ridge, point), 0
        else:
            worse += 1
        if worse == WORSE or time.monotonic() > deadline:
            break
    assert best is not None
    _, ridge, point = best
    return ridge, point.theta, point.delays


def _held_back_cost(problem: Problem, point: Point, u: Floats, y: Floats) -> float:
    """Squared residual plus the price of the initial state, at their least."""
    system = point.system
    forced = system.forced(u - u.mean(axis=0), problem.group, sensitivities=False, delays=point.delays)
    residual = y - np.einsum("tkm,km->t", forced[:, : problem.numerators], point.numerators)
    free = system.free(len(y), sensitivities=False)[:, problem.integrators :]
    shapes = np.hstack([trends(len(y), problem.integrators), free.reshape(len(y), -1)])
    factor = cho_factor(shapes.T @ shapes + initial_prior(problem, system), lower=True)
    projection = shapes.T @ residual
    return float(residual @ residual - projection @ cho_solve(factor, projection))
