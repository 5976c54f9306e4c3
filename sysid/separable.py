"""Separable least squares for one output: numerators, offsets and initial states linear, poles by Gauss-Newton.

For fixed denominators the model is linear in the numerators (shared by all records) and, in every record, in an offset
and the response to the initial state. Those are solved exactly for every set of poles, and the poles follow the
Levenberg-Marquardt step of the problem so reduced (variable projection, Golub and Pereyra 1973, in Kaufman's form: the
joint Gauss-Newton step with the linear parameters eliminated). Everything needed of the data are inner products, so
that the cost of a step grows with the number of samples only in the response kernel and in one product of matrices.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from sysid.experiment import Floats
from sysid.response import Discretised, discretise
from sysid.sections import Band, clip, denominators

#: Largest change of a logarithmic parameter in one step.
LONGEST_STEP = 1.0

#: A step is the last when it lowers the cost by less than this part.
ENOUGH = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One output of several records, in normalised units.

    Attributes
    ----------
    inputs : tuple of ndarray, shape (N_r, m)
        About their trim, each of unit variance over all records.
    outputs : tuple of ndarray, shape (N_r,)
        About their trim, of unit variance over all records.
    group : tuple of int, shape (m,)
        Which denominator each input passes.
    order : int
        Poles of each denominator.
    numerators : int
        Coefficients of each numerator, zeros + 1.
    dt : float
        s.
    hold : {"zoh", "foh"}
    band : Band
        Where poles may lie.
    ridge : float
        Weight of the numerators' impulse-response energy relative to the information in the data.
    initial : float
        Variance of the residual over the energy [s] that the response to an initial state is expected to have.
    """

    inputs: tuple[Floats, ...]
    outputs: tuple[Floats, ...]
    group: tuple[int, ...]
    order: int
    numerators: int
    dt: float
    hold: str
    band: Band
    ridge: float
    initial: float

    @property
    def groups(self) -> int:
        """Number of denominators."""
        return max(self.group) + 1

    @property
    def samples(self) -> int:
        """Samples of all records together."""
        return sum(len(y) for y in self.outputs)


@dataclass(frozen=True, slots=True)
class Point:
    """The problem solved for its linear parameters at one set of poles.

    Attributes
    ----------
    theta : ndarray, shape (groups, n)
    cost : float
        Sum of squared residuals plus the penalties.
    numerators : ndarray, shape (numerators, m)
        In normalised states, ascending.
    local : tuple of ndarray, shape (1 + n groups,)
        Per record the offset and the coefficients of the initial responses.
    residuals : tuple of ndarray, shape (N_r,)
    """

    theta: Floats
    cost: float
    numerators: Floats
    local: tuple[Floats, ...]
    residuals: tuple[Floats, ...]
    system: Discretised
    slope: Floats
    states: tuple[Floats, ...]
    free: Floats
    regressors: tuple[Floats, ...]
    penalty: Floats


def solve(problem: Problem, theta: Floats) -> Point:
    """Solve for the linear parameters at given poles."""
    a, slope = denominators(theta)
    system = discretise(a, problem.dt, problem.hold)
    n, m, shared = problem.order, len(problem.group), problem.numerators * len(problem.group)
    free = system.free(max(len(y) for y in problem.outputs))
    shapes = free[:, :n].reshape(len(free), -1)
    locals_ = 1 + shapes.shape[1]
    prior = initial_prior(problem, system)

    states, regressors, factors, couplings = [], [], [], []
    information = np.zeros((shared + 1, shared + 1))
    energy = np.zeros(shared)
    for u, y in zip(problem.inputs, problem.outputs, strict=True):
        forced = system.forced(u, problem.group)
        z = np.empty((len(y), locals_ + shared + 1))
        z[:, 0] = 1.0
        z[:, 1:locals_] = shapes[: len(y)]
        z[:, locals_:-1] = forced[:, : problem.numerators].reshape(len(y), shared)
        z[:, -1] = y
        gram = z.T @ z
        energy += np.diag(gram)[locals_:-1]
        factor = cholesky(gram[:locals_, :locals_] + prior, lower=True)
        coupling = solve_triangular(factor, gram[:locals_, locals_:], lower=True)
        information += gram[locals_:, locals_:] - coupling.T @ coupling
        states.append(forced)
        regressors.append(z)
        factors.append(factor)
        couplings.append(coupling)

    penalty = _impulse_energy(problem, system, energy)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information)[:shared], 1e-300))
    normal = (information[:shared, :shared] + penalty) * scale * scale[:, None]
    normal[np.diag_indices(shared)] += 1e-13
    rhs = information[:shared, shared] * scale
    c = scale * cho_solve(cho_factor(normal, lower=True), rhs)
    cost = float(information[shared, shared] - information[:shared, shared] @ c)

    own, residuals = [], []
    for z, factor, coupling in zip(regressors, factors, couplings, strict=True):
        local = solve_triangular(factor, coupling[:, -1] - coupling[:, :-1] @ c, lower=True, trans=1)
        own.append(local)
        residuals.append(z[:, -1] - z[:, :-1] @ np.concatenate([local, c]))
    return Point(
        theta=theta,
        cost=max(cost, 0.0),
        numerators=c.reshape(problem.numerators, m),
        local=tuple(own),
        residuals=tuple(residuals),
        system=system,
        slope=slope,
        states=tuple(states),
        free=free,
        regressors=tuple(regressors),
        penalty=penalty,
    )


def sensitivities(problem: Problem, point: Point) -> tuple[Floats, ...]:
    """Differentiate the model's output by the poles' parameters, linear parameters held.

    Returns
    -------
    tuple of ndarray, shape (N_r, groups n)
    """
    n, groups, m = problem.order, problem.groups, len(problem.group)
    derivative = point.slope / (point.system.unit[:, None] ** np.arange(n, 0, -1))[:, :, None]
    powers = [_powers_over_square(point.system.a[g]) for g in range(groups)]

    def weights(coefficients: Floats, g: int) -> Floats:
        k = np.zeros((2 * n, n))
        for power, value in enumerate(coefficients):
            k -= value * powers[g][power : power + n].T
        return np.asarray(k @ derivative[g])

    blocks = np.zeros((2 * n, m, groups, n))
    for j, g in enumerate(problem.group):
        blocks[:, j, g] = weights(point.numerators[:, j], g)
    forced = blocks.reshape(2 * n * m, groups * n)
    result = []
    for states, local in zip(point.states, point.local, strict=True):
        initial = local[1:].reshape(n, groups)
        free = np.zeros((2 * n, groups, groups, n))
        for g in range(groups):
            free[:, g, g] = weights(initial[:, g], g)
        samples = len(states)
        result.append(
            states.reshape(samples, -1) @ forced
            + point.free[:samples].reshape(samples, -1) @ free.reshape(2 * n * groups, groups * n)
        )
    return tuple(result)


def reduced_information(problem: Problem, point: Point, jacobians: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """Inner products of numerator and pole regressors with offsets and initial states eliminated.

    Returns
    -------
    information : ndarray, shape (q, q)
        Without penalties; q = numerators * m + groups * n.
    gradient : ndarray, shape (q,)
        Regressors times residual, of the data alone.
    """
    shared = point.numerators.size
    q = shared + jacobians[0].shape[1]
    information, gradient = np.zeros((q, q)), np.zeros(q)
    prior = initial_prior(problem, point.system)
    for z, jacobian, residual, local in zip(point.regressors, jacobians, point.residuals, point.local, strict=True):
        locals_ = z.shape[1] - 1 - shared
        w = np.hstack([z[:, :-1], jacobian])
        gram = w.T @ w
        factor = cholesky(gram[:locals_, :locals_] + prior, lower=True)
        coupling = solve_triangular(factor, gram[:locals_, locals_:], lower=True)
        information += gram[locals_:, locals_:] - coupling.T @ coupling
        gradient += w[:, locals_:].T @ residual
        # The local parameters are at their optimum: the prior balances their gradient, which the elimination passes on.
        balance = solve_triangular(factor, w[:, :locals_].T @ residual - prior @ local, lower=True)
        gradient -= coupling.T @ balance
    return information, gradient


@dataclass(frozen=True, slots=True)
class Descent:
    """Where a descent ended."""

    point: Point
    iterations: int
    converged: bool


def descend(problem: Problem, theta: Floats, iterations: int, deadline: float = np.inf) -> Descent:
    """Follow Levenberg-Marquardt steps in the poles until the cost settles.

    Parameters
    ----------
    problem : Problem
    theta : ndarray, shape (groups, n)
        Start.
    iterations : int
        Most steps to take.
    deadline : float
        On `time.monotonic`; reached, the best point so far is returned as not converged.
    """
    point = solve(problem, clip(theta, problem.band))
    damping, growth = 1e-1, 2.0
    for iteration in range(iterations):
        if time.monotonic() > deadline:
            return Descent(point, iteration, False)
        hessian, gradient = _pole_system(problem, point)
        while True:
            step = _bounded_step(problem, point.theta, hessian, gradient, damping)
            trial = solve(problem, clip(point.theta + step.reshape(point.theta.shape), problem.band))
            if trial.cost < point.cost:
                break
            damping, growth = damping * growth, growth * 2.0
            if damping > 1e8 or time.monotonic() > deadline:
                return Descent(point, iteration, damping > 1e8)
        gain = (point.cost - trial.cost) / max(point.cost, 1e-300)
        expected = float(step @ (2.0 * gradient - hessian @ step))
        quality = (point.cost - trial.cost) / expected if expected > 0.0 else 1.0
        damping, growth = damping * max(0.1, 1.0 - (2.0 * min(quality, 1.5) - 1.0) ** 3), 2.0
        damping = max(damping, 1e-9)
        point = trial
        if gain < ENOUGH:
            return Descent(point, iteration + 1, True)
    return Descent(point, iterations, False)


def _pole_system(problem: Problem, point: Point) -> tuple[Floats, Floats]:
    """Hessian and gradient of the reduced problem in the poles."""
    shared = point.numerators.size
    information, gradient = reduced_information(problem, point, sensitivities(problem, point))
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information)[:shared], 1e-300))
    normal = (information[:shared, :shared] + point.penalty) * scale * scale[:, None]
    normal[np.diag_indices(shared)] += 1e-13
    factor = cholesky(normal, lower=True)
    coupling = solve_triangular(factor, information[:shared, shared:] * scale[:, None], lower=True)
    # At the optimum of the numerators the penalty balances their gradient; what is left acts on the poles alone.
    balance = solve_triangular(
        factor, (gradient[:shared] - point.penalty @ point.numerators.ravel()) * scale, lower=True
    )
    return information[shared:, shared:] - coupling.T @ coupling, gradient[shared:] - coupling.T @ balance


def _bounded_step(problem: Problem, theta: Floats, hessian: Floats, gradient: Floats, damping: float) -> Floats:
    flat = theta.ravel()
    outward = clip((flat + 1e-9 * np.sign(gradient)).reshape(theta.shape), problem.band).ravel()
    free = np.flatnonzero((outward != flat) | (gradient == 0.0))
    step = np.zeros_like(flat)
    if len(free):
        block = hessian[np.ix_(free, free)]
        diagonal = np.diag(block)
        block = block + np.diag(damping * diagonal + 1e-9 * max(float(diagonal.max()), 1e-300))
        step[free] = np.linalg.solve(block, gradient[free])
    return np.clip(step, -LONGEST_STEP, LONGEST_STEP)


def initial_prior(problem: Problem, system: Discretised) -> Floats:
    """Precision of a record's offset, which is free, and of its initial responses, times the residual's variance."""
    precision = problem.initial * system.initial_precision()
    prior = np.zeros((1 + len(precision), 1 + len(precision)))
    prior[1:, 1:] = precision + np.diag(1e-9 * np.diag(precision) + 1e-12)
    return prior


def _impulse_energy(problem: Problem, system: Discretised, energy: Floats) -> Floats:
    """Penalty matrix of the numerators: energy of each impulse response, weighed by the information on its input."""
    m = len(problem.group)
    gramians = system.gramians[:, : problem.numerators, : problem.numerators]
    per_input = energy.reshape(problem.numerators, m)
    penalty = np.zeros((problem.numerators, m, problem.numerators, m))
    for j, g in enumerate(problem.group):
        block = gramians[g]
        penalty[:, j, :, j] = problem.ridge * block * (per_input[:, j].sum() / np.trace(block))
    return penalty.reshape(problem.numerators * m, problem.numerators * m)


def _powers_over_square(a: Floats) -> Floats:
    """Express ``p^q / A^2`` (q = 0 .. 2n-2) in the states ``p^k / A`` and ``p^k / A^2``; shape (2n-1, 2n)."""
    n = len(a)
    rows = np.zeros((2 * n - 1, 2 * n))
    rows[np.arange(n), n + np.arange(n)] = 1.0
    for q in range(n, 2 * n - 1):
        rows[q, q - n] = 1.0
        rows[q] -= a @ rows[q - n : q]
    return rows
