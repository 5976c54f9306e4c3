"""Separable least squares for one output: numerators, offsets and initial states linear, the rest by Gauss-Newton.

For fixed denominators and delays the model is linear in the numerators (shared by all records) and, in every record, in
an offset and the response to the initial state. Those are solved exactly for every set of poles, and the poles follow
the Levenberg-Marquardt step of the problem so reduced (variable projection, Golub and Pereyra 1973, in Kaufman's form:
the joint Gauss-Newton step with the linear parameters eliminated). Everything needed of the data are inner products, so
that the cost of a step grows with the number of samples only in the response kernel and in a few products of matrices.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sysid.records.experiment import Floats
from sysid.transfer_functions.problem import FitProblem, clip, denominators
from sysid.transfer_functions.reduction import (
    Basis,
    Part,
    backward,
    basis_at,
    eliminate,
    factorise,
    forward,
    jacobian,
    linearise,
    missing_powers,
    powers_over_square,
    slopes_at,
    squares_of,
    sum_of,
)
from sysid.transfer_functions.response import Discretised, gramians

#: Largest change in one step of a logarithmic parameter, and of a delay in samples.
LONGEST_STEP = 1.0

#: A step is the last when it lowers the cost by less than this part of one residual's variance: noise in a single
#: parameter changes the cost by a whole one. Autocorrelated residuals are worth fewer independent ones, so that noise
#: in a parameter changes the cost by more: then two such steps in a row are the last.
ENOUGH = 0.02


@dataclass(frozen=True, slots=True)
class Point:
    """The problem solved for its linear parameters at one set of poles."""

    basis: Basis  #: Poles, delays, and what follows from them for all records alike.
    cost: float  #: Sum of squared residuals plus the penalties.
    numerators: Floats  #: shape (numerators, m): In normalised states, ascending.
    #: shape (numerators m + 1, numerators m + 1): Inner products of the numerators' regressors and the output, what
    #: each record has of its own eliminated.
    information: Floats
    penalty: Floats  #: shape (numerators m, numerators m)
    parts: tuple[Part, ...]  #: What each record has of its own.

    @property
    def theta(self) -> Floats:
        """Parameters of the denominators, shape (groups, lags)."""
        return self.basis.theta

    @property
    def delays(self) -> Floats:
        """Of the inputs, s, shape (m,)."""
        return self.basis.delays

    @property
    def system(self) -> Discretised:
        """The denominators, discretised."""
        return self.basis.system

    @property
    def residuals(self) -> tuple[Floats, ...]:
        """Of each record, shape (N_r,)."""
        return tuple(part.residual for part in self.parts)


def solve(problem: FitProblem, theta: Floats, delays: Floats | None = None) -> Point:
    """Solve for the linear parameters at given poles and delays, by default those of the problem."""
    basis = basis_at(problem, theta, problem.start_delays if delays is None else delays)
    parts = tuple(eliminate(problem, basis, u, y) for u, y in zip(problem.inputs, problem.outputs, strict=True))
    return _solved(problem, basis, sum_of([part.information for part in parts]), parts)


def with_ridge(problem: FitProblem, point: Point) -> Point:
    """Solve a problem with another ridge at the poles of a point, whose responses stay."""
    return _solved(problem, point.basis, point.information, tuple(replace(part) for part in point.parts))


def _solved(problem: FitProblem, basis: Basis, information: Floats, parts: tuple[Part, ...]) -> Point:
    """Solve the reduced equations for the numerators, and finish the records' parts with them."""
    shared = len(information) - 1
    penalty = _impulse_energy(problem, basis.system, np.diag(information)[:-1], problem.used)
    normal, scale = _normalised(information[:shared, :shared], penalty)
    c = scale * backward(normal, forward(normal, information[:shared, shared] * scale))
    cost = float(information[shared, shared] - information[:shared, shared] @ c)
    numerators = c.reshape(problem.numerators, len(problem.group))
    for part in parts:
        part.finish(numerators)
    return Point(
        basis=basis,
        cost=max(cost, 0.0),
        numerators=numerators,
        information=information,
        penalty=penalty,
        parts=parts,
    )


def sensitivities(problem: FitProblem, point: Point) -> tuple[Floats, ...]:
    """Differentiate the model's output by the poles' parameters and the delays, linear parameters held."""
    slopes = slopes_at(problem, point.basis, point.numerators)
    return tuple(
        jacobian(problem, point.basis, slopes, point.numerators, u, part)
        for u, part in zip(problem.inputs, point.parts, strict=True)
    )


def instruments(problem: FitProblem, point: Point) -> tuple[Floats, ...]:
    """Pass the model's response to the inputs through one more ``1 / A``: derivatives 0 to lags - 1, normalised."""
    k, lags, m = problem.integrators, problem.lags, len(problem.group)
    table = powers_over_square(point.system)[0]
    weights = np.zeros((2 * problem.order, m, lags))
    for j in range(m):
        for power, value in enumerate(point.numerators[:, j]):
            weights[:, j] += value * table[power + k : power + k + lags].T
    once, twice = weights[: problem.order].reshape(-1, lags), weights[problem.order :].reshape(-1, lags)
    return tuple(
        part.states.reshape(len(part.states), -1) @ once
        + squares_of(problem, point.basis, u, part).reshape(len(part.states), -1) @ twice
        for u, part in zip(problem.inputs, point.parts, strict=True)
    )


def reduced_information(problem: FitProblem, point: Point, jacobians: tuple[Floats, ...] | None = None) -> Floats:
    """Return inner products of numerator and nonlinear regressors, with offsets and initial states eliminated."""
    return _linearised(problem, point, jacobians)[0]


def _linearised(problem: FitProblem, point: Point, jacobians: tuple[Floats, ...] | None = None) -> list[Floats]:
    """Sum what `sysid.transfer_functions.reduction.linearise` returns over the records."""
    jacobians = sensitivities(problem, point) if jacobians is None else jacobians
    by_record = [
        linearise(problem, point.basis, part, columns) for part, columns in zip(point.parts, jacobians, strict=True)
    ]
    return [sum_of(parts) for parts in zip(*by_record, strict=True)]


@dataclass(frozen=True, slots=True)
class Descent:
    """Where a descent ended."""

    point: Point
    iterations: int
    converged: bool


def descend(
    problem: FitProblem,
    start: Floats | Point,
    iterations: int,
    deadline: float = np.inf,
    delays: Floats | None = None,
    settled: float = 0.0,
    hopeless: float = np.inf,
) -> Descent:
    """Follow Levenberg-Marquardt steps in poles and delays from poles, or from a point solved, until the cost settles.

    A cost above `hopeless` after two steps ends it, and so does one that decreases by less than the part `settled`.
    """
    point = start if isinstance(start, Point) else solve(problem, clip(start, problem.band, problem.lag_orders), delays)
    if problem.lags == 0 and not problem.delay_parameters:
        return Descent(point, 0, True)
    damping, growth, small_steps = 1e-1, 2.0, 0
    for iteration in range(iterations):
        if time.monotonic() > deadline or (iteration == 2 and point.cost > hopeless):
            return Descent(point, iteration, False)
        hessian, gradient, independent = nonlinear_system(problem, point)
        free = _free(problem, point, gradient)
        while True:
            step = _bounded_step(free, hessian, gradient, damping)
            expected = float(step @ (2.0 * gradient - hessian @ step))
            # Even a step as good as expected would be the last. (Of one cut short nothing can be expected.)
            if expected * independent < ENOUGH * point.cost and np.abs(step).max() < LONGEST_STEP:
                return Descent(point, iteration, True)
            trial = solve(problem, *_moved(problem, point, step))
            if trial.cost < point.cost:
                break
            damping, growth = damping * growth, growth * 2.0
            if damping > 1e8 or time.monotonic() > deadline or not step.any():
                return Descent(point, iteration, damping > 1e8 or not step.any())
        decrease = (point.cost - trial.cost) / max(point.cost, 1e-300)
        gain_ratio = (point.cost - trial.cost) / expected if expected > 0.0 else 1.0
        # Nielsen 1999. With 0.1 in the place of 1/3, a third of the steps was refused, and fits of eight denominators
        # took a third more solutions.
        damping, growth = damping * max(1.0 / 3.0, 1.0 - (2.0 * min(gain_ratio, 1.5) - 1.0) ** 3), 2.0
        damping = max(damping, 1e-9)
        point = trial
        small_steps = small_steps + 1 if decrease * independent < ENOUGH else 0
        if small_steps == 2 or decrease * problem.samples < ENOUGH or decrease < settled:
            return Descent(point, iteration + 1, True)
    return Descent(point, iterations, False)


def nonlinear_system(problem: FitProblem, point: Point) -> tuple[Floats, Floats, float]:
    """Return Hessian and gradient of the reduced problem in poles and delays, and the effective number of residuals."""
    shared = point.numerators.size
    information, gradient, outer, residual_sums = _linearised(problem, point)
    gradient[shared : shared + problem.lags * problem.groups] -= _penalty_gradient(problem, point, outer)
    factor, scale = _normalised(information[:shared, :shared], point.penalty)
    coupling = forward(factor, information[:shared, shared:] * scale[:, None])
    # At the optimum of the numerators the penalty balances their gradient; the rest acts on the poles alone.
    balance = forward(factor, (gradient[:shared] - point.penalty @ point.numerators.ravel()) * scale)
    square, product = residual_sums
    # Effective number of samples of products of a first-order autoregressive residual.
    correlation = min(max(product / max(square, 1e-300), 0.0), 1.0) ** 2
    independent = max(problem.samples * (1.0 - correlation) / (1.0 + correlation), float(len(gradient)))
    return information[shared:, shared:] - coupling.T @ coupling, gradient[shared:] - coupling.T @ balance, independent


def _penalty_gradient(problem: FitProblem, point: Point, outer: Floats) -> Floats:
    """Return half the derivatives of both penalties by the poles' parameters, parameter-major, linear parameters held.

    Slow and lightly damped poles make impulse and initial responses of more energy. It comes from the derivatives of
    the gramians, with each denominator's present unit of frequency; how the weight of an input's energy depends on its
    poles is neglected. `outer` are outer products of the initial responses' coefficients, summed over the records.
    """
    system = point.system
    free, forced = _differences(problem, point)
    lanes, used = list(problem.group), problem.used
    c, count = point.numerators, problem.numerators
    now = np.diagonal(system.gramians[lanes, :count, :count], axis1=1, axis2=2).T
    weight = (np.diag(point.penalty).reshape(used.shape) * used).sum(axis=0) / (now * used).sum(axis=0)
    groups = problem.groups
    changes = weight * np.einsum("kj,ijkl,lj->ij", c, forced[:, lanes, :count, :count], c)
    slopes: Floats = changes @ np.equal.outer(lanes, np.arange(groups)).astype(np.float64)
    initial = np.einsum("gkl,igkl->ig", outer, free)
    slopes += problem.initial * np.array(problem.lag_orders) / system.unit * initial
    return 0.5 * slopes.ravel()


def _differences(problem: FitProblem, point: Point) -> tuple[Floats, Floats]:
    """Differentiate the gramians of initial responses and of those to inputs numerically, (lags, groups, n, n) each."""
    groups, lags, k, system = problem.groups, problem.lags, problem.integrators, point.system
    step = 1e-5
    moved = np.repeat(point.theta[None], 2 * lags, axis=0)
    moved[np.arange(lags), :, np.arange(lags)] += step
    moved[lags + np.arange(lags), :, np.arange(lags)] -= step
    orders = problem.lag_orders * (2 * lags)
    seconds = denominators(moved.reshape(-1, lags), orders)[0].reshape(2 * lags, groups, lags)
    a: Floats = (seconds / system.unit[:, None] ** missing_powers(problem)).reshape(-1, lags)
    free = gramians(a, orders, 0).reshape(2, lags, groups, lags, lags)
    free = (free[0] - free[1]) / (2.0 * step)
    if not k:
        return free, free
    a = np.hstack([np.zeros((len(a), k)), a])
    forced = gramians(a, problem.orders * (2 * lags), k).reshape(2, lags, groups, k + lags, k + lags)
    return free, (forced[0] - forced[1]) / (2.0 * step)


def _moved(problem: FitProblem, point: Point, step: Floats) -> tuple[Floats, Floats]:
    """Return poles and delays after a step in the order of the sensitivities, kept within their bounds."""
    groups, lags = problem.groups, problem.lags
    theta = point.theta + step[: lags * groups].reshape(lags, groups).T
    theta = clip(theta, problem.band, problem.lag_orders)
    if not problem.delay_parameters:
        return theta, point.delays
    return theta, np.clip(point.delays + problem.dt * step[lags * groups :], 0.0, problem.longest_delay)


def _free(problem: FitProblem, point: Point, gradient: Floats) -> NDArray[np.bool_]:
    """Mark the parameters that no bound keeps from following the gradient."""
    theta, delays = _moved(problem, point, 1e-9 * np.sign(gradient))
    moves = (theta != point.theta).T.ravel()
    return np.concatenate([moves, delays != point.delays]) if problem.delay_parameters else moves


def _bounded_step(free: NDArray[np.bool_], hessian: Floats, gradient: Floats, damping: float) -> Floats:
    diagonal = np.where(free, hessian.diagonal(), 0.0)
    # Parameters at their bounds keep equations of their own, whose solution is no step.
    block = hessian * (free & free[:, None])
    block[np.diag_indices(len(block))] += np.where(free, damping * diagonal + 1e-9 * max(diagonal.max(), 1e-300), 1.0)
    step = np.linalg.solve(block, np.where(free, gradient, 0.0))
    return np.asarray(np.minimum(np.maximum(step, -LONGEST_STEP), LONGEST_STEP))


def _impulse_energy(problem: FitProblem, system: Discretised, energy: Floats, used: Floats) -> Floats:
    """Return the numerators' penalty: the energy of each impulse response, weighted by the information on its input."""
    lanes, count = np.arange(len(problem.group)), problem.numerators
    blocks = system.gramians[list(problem.group), :count, :count] * used.T[:, :, None] * used.T[:, None, :]
    per_input = problem.ridge * energy.reshape(used.shape).sum(axis=0)
    blocks *= (per_input / np.trace(blocks, axis1=1, axis2=2))[:, None, None]
    penalty = np.zeros((*used.shape, *used.shape))
    penalty[:, lanes, :, lanes] = blocks
    result = penalty.reshape(used.size, used.size)
    result[np.diag_indices(used.size)] += 1.0 - used.ravel()
    return result


def _normalised(information: Floats, penalty: Floats) -> tuple[Floats, Floats]:
    """Factor the penalised information of the numerators, scaled to a unit diagonal; the factor and the scale."""
    normal = information + penalty
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    normal = normal * scale * scale[:, None]
    normal[np.diag_indices(len(scale))] += 1e-13
    return factorise(normal), scale
