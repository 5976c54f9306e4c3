"""Poles without a start: the simplified refined instrumental variable method for continuous time (SRIVC).

Young and Jakeman 1980; Garnier, Mensler and Richard 2003. The equation ``A(s) y = B(s) u + A(s) e`` is linear in the
coefficients of A and B once inputs and output have been passed through ``1 / A``. Least squares on it is biased by the
noise in the derivatives of y; instruments made of the noise-free output of the last model are not, and with white
output noise the fixed point of the iteration is the output-error estimate itself. The first filter is ``(s + b)^-n``.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import lstsq

from sysid.records.experiment import Floats
from sysid.transfer_functions.problem import Problem, clip, denominators, from_poles
from sysid.transfer_functions.response import Discretised, discretise
from sysid.transfer_functions.separable import Point, instruments, solve

#: Iterations without a new lowest cost after which there will be none.
VAIN = 6

#: Iterations at most, and the change of the logarithmic parameters at which Gauss-Newton steps do better.
MOST_ITERATIONS, NEAR = 30, 0.03


@dataclass(frozen=True, slots=True)
class Start:
    """Poles found by SRIVC."""

    theta: Floats  #: shape (1, lags): Parameters of the one denominator; see `sysid.transfer_functions.problem`.
    cost: float  #: Of the problem there.
    iterations: int
    #: False when the iteration wandered or drifted to the bounds: the start is then no better than another.
    settled: bool


def srivc(problem: Problem, bandwidth: float, deadline: float = np.inf) -> Start:
    """Find the common denominator of all inputs."""
    lags = problem.lags
    theta = np.zeros((1, lags))
    theta[0, : lags - lags % 2 : 2] = np.log(bandwidth)
    theta[0, lags - lags % 2 :] = np.log(bandwidth)
    theta = clip(theta, problem.band)
    best: tuple[float, Floats] = (np.inf, theta)
    change, vain = np.inf, 0
    for iteration in range(MOST_ITERATIONS):
        point = solve(problem, theta)
        vain += 1
        if point.cost < best[0]:
            best, vain = (point.cost, theta), 0
        if change < NEAR or vain == VAIN or time.monotonic() > deadline:
            return Start(best[1], best[0], iteration, change < NEAR)
        refined = refine(problem, point, noisy=iteration == 0)
        if refined is None:
            return Start(best[1], best[0], iteration, False)
        following = clip(refined[None], problem.band)
        change = float(np.max(np.abs(following - theta)))
        theta = following
    return Start(best[1], best[0], MOST_ITERATIONS, False)


def refine(problem: Problem, point: Point, *, noisy: bool) -> Floats | None:
    """Iterate once: the coefficients of A by instrumental variables, shape (lags,)."""
    lags, shared = problem.lags, point.numerators.size
    system = _without_integrators(problem, point)
    size = shared + 2 * lags + 1
    total = np.zeros((size, size))
    made = (None,) * len(point.parts) if noisy else instruments(problem, point)
    for part, instrument in zip(point.parts, made, strict=True):
        z, gram, locals_ = part.regressors, part.gram, len(part.local)
        derivatives = _derivatives(system, z[:, -1])
        clean = derivatives[:, :-1] if instrument is None else instrument
        more = np.hstack([clean, derivatives])
        across = z[:, :-1].T @ more
        product = np.block([[gram[:-1, :-1], across], [across.T, more.T @ more]])
        product[:locals_, :locals_] += point.basis.prior
        coupling = np.linalg.solve(product[:locals_, :locals_], product[:locals_, locals_:])
        total += product[locals_:, locals_:] - product[locals_:, :locals_] @ coupling
    numerators = total[:shared, :shared] + point.penalty
    if not (np.isfinite(total).all() and np.isfinite(numerators).all() and (np.diag(numerators) > 0.0).all()):
        return None
    scale = 1.0 / np.sqrt(np.diag(numerators))
    inverse = lstsq(numerators * scale * scale[:, None], total[:shared, shared:] * scale[:, None])[0]
    rest = total[shared:, shared:] - (total[shared:, :shared] * scale) @ inverse
    matrix, rhs = rest[:lags, lags:-1], rest[:lags, -1]
    rows = 1.0 / np.maximum(np.abs(matrix).max(axis=1), 1e-300)
    normalised = -lstsq(matrix * rows[:, None], rhs * rows)[0]
    unit = float(system.unit[0])
    return from_poles(unit * np.roots(np.concatenate([[1.0], normalised[::-1]])).astype(np.complex128))


def _without_integrators(problem: Problem, point: Point) -> Discretised:
    """Discretise the denominator for signals that are straight between samples."""
    if problem.integrators == 0:
        return replace(point.system, hold="foh")
    return discretise(denominators(point.theta)[0], problem.dt, "foh")


def _derivatives(system: Discretised, y: Floats) -> Floats:
    """Pass the output through 1 / A: derivatives 0 to n in normalised time; shape (N, n + 1)."""
    states = system.forced(y[:, None], [0])[:, :, 0]
    return np.column_stack([states, y - states @ system.a[0]])
