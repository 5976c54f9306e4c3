"""What each record contributes to the normal equations, and their sum.

At given poles a record's output is linear in the numerators, which all records share, and in an offset and an initial
response of its own. Those of its own are eliminated within the record (a Schur complement), so that it contributes a
matrix of the size of what is shared, however long it is. A Gauss-Newton step takes two such sums: the numerators at
given poles (`eliminate`), then Hessian and gradient at those numerators (`linearise`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import lapack

from sysid.records.experiment import Floats
from sysid.transfer_functions.problem import FitProblem, denominators
from sysid.transfer_functions.response import Discretised, delayed, discretise, trends, whole_and_part


@dataclass(frozen=True)
class Basis:
    """What all records have in common at given poles and delays."""

    theta: Floats  #: shape (groups, lags)
    delays: Floats  #: shape (m,): s.
    system: Discretised
    #: shape (groups, lags, lags): Of the coefficients by the parameters; see
    #: `sysid.transfer_functions.problem.denominators`.
    slope: Floats
    free: Floats  #: shape (N, n, groups): Responses to initial states, as long as the longest record.
    #: shape (local, local): Precision of what each record has of its own, times the variance of the residual.
    prior: Floats

    @cached_property
    def free_squares(self) -> Floats:
        """The same through another ``1 / A``, which derivatives need."""
        return self.system.free(len(self.free), self.free)


@dataclass(slots=True)
class Part:
    """One record at given poles."""

    states: Floats  #: shape (N, n, m): Responses to the inputs.
    #: shape (N, 2 + integrators): Polynomials of time (`sysid.transfer_functions.response.trends`), and the output.
    trends: Floats
    free: Floats  #: shape (N, lags groups): Initial responses, a view of those of the basis.
    forced: Floats  #: shape (N, numerators m): Regressors of the numerators, power-major: a view of the states.
    used: Floats  #: shape (numerators m,): 1 for the numerators' coefficients that exist.
    gram: Floats  #: shape (local + numerators m + 1, local + numerators m + 1): Inner products of `regressors`.
    #: Of the elimination.
    factor: Floats
    coupling: Floats
    information: Floats  #: shape (numerators m + 1, numerators m + 1): What the record contributes.
    squares: Floats | None = None  #: shape (N, n, m): Responses through another ``1 / A``, once they are asked for.
    #: shape (1 + integrators + lags groups,): The polynomial in time (`sysid.transfer_functions.response.trends`) and
    #: the coefficients of the initial responses, once numerators are known.
    local: Floats = field(default_factory=lambda: np.zeros(0))
    residual: Floats = field(default_factory=lambda: np.zeros(0))  #: shape (N,): Likewise.

    @property
    def regressors(self) -> Floats:
        """Of what is the record's own, of the numerators, and the output; shape (N, local + numerators m + 1)."""
        return np.hstack([self.trends[:, :-1], self.free, self.forced * self.used, self.trends[:, -1:]])

    def finish(self, numerators: Floats) -> None:
        """Accept the numerators that all records together chose."""
        c, first = numerators.ravel(), self.trends.shape[1] - 1
        self.local = backward(self.factor, self.coupling[:, -1] - self.coupling[:, :-1] @ c)
        own = self.trends[:, :first] @ self.local[:first] + self.free @ self.local[first:]
        self.residual = self.trends[:, -1] - own - self.forced @ (c * self.used)

    def along(self, columns: Floats) -> Floats:
        """Inner products of the regressors of what is the record's own and of the numerators with other columns."""
        forced = self.forced.T @ columns
        forced *= self.used if columns.ndim == 1 else self.used[:, None]
        return np.concatenate([self.trends[:, :-1].T @ columns, self.free.T @ columns, forced])


def basis_at(problem: FitProblem, theta: Floats, delays: Floats) -> Basis:
    """Discretise the denominators, and respond to initial states as long as the longest record."""
    k = problem.integrators
    a, slope = denominators(theta, problem.lag_orders)
    a = np.hstack([np.zeros((len(a), k)), a]) if k else a
    system = discretise(a, problem.dt, problem.hold, problem.orders)
    return Basis(theta, delays, system, slope, system.free(max(problem.lengths)), initial_prior(problem, system))


def squares_of(problem: FitProblem, basis: Basis, u: Floats, part: Part) -> Floats:
    """Pass a record's responses through another ``1 / A``; shape (N, n, m)."""
    if part.squares is None:
        part.squares = basis.system.forced(u, problem.group, basis.delays, part.states)
    return part.squares


def eliminate(problem: FitProblem, basis: Basis, u: Floats, y: Floats) -> Part:
    """Form a record's normal equations and eliminate what is its own."""
    k, samples, lanes, groups = problem.integrators, len(y), len(problem.group), problem.groups
    states = basis.system.forced(u, problem.group, delays=basis.delays)
    # Views and small products: one array of all regressors would take as long to fill as to multiply.
    forced = states.reshape(samples, -1)[:, : problem.numerators * lanes]
    free = basis.free[:samples].reshape(samples, -1)[:, k * groups : problem.order * groups]
    used = problem.used.ravel()
    own = np.column_stack([trends(samples, k), y])
    first, locals_ = 1 + k, len(basis.prior)
    gram = np.empty((locals_ + len(used) + 1, locals_ + len(used) + 1))
    small, by_free, by_forced = own.T @ own, free.T @ own, (forced.T @ own) * used[:, None]
    gram[:first, :first], gram[:first, -1], gram[-1, -1] = small[:-1, :-1], small[:-1, -1], small[-1, -1]
    gram[first:locals_, :first], gram[first:locals_, -1] = by_free[:, :-1], by_free[:, -1]
    gram[locals_:-1, :first], gram[locals_:-1, -1] = by_forced[:, :-1], by_forced[:, -1]
    gram[first:locals_, first:locals_] = free.T @ free
    gram[locals_:-1, first:locals_] = (forced.T @ free) * used[:, None]
    gram[locals_:-1, locals_:-1] = (forced.T @ forced) * used * used[:, None]
    gram[:first, first:locals_] = gram[first:locals_, :first].T
    gram[:locals_, locals_:-1] = gram[locals_:-1, :locals_].T
    gram[-1, :-1] = gram[:-1, -1]
    factor = factorise(gram[:locals_, :locals_] + basis.prior)
    coupling = forward(factor, gram[:locals_, locals_:])
    information = gram[locals_:, locals_:] - coupling.T @ coupling
    return Part(states, own, free, forced, used, gram, factor, coupling, information)


def slopes_at(problem: FitProblem, basis: Basis, numerators: Floats) -> tuple[Floats, Floats]:
    """Express derivatives by the poles in the states: forced (2 n, lags, m), and initial (groups, n, 2 n, lags)."""
    weights = _derivative_weights(problem, basis)
    lanes = weights[list(problem.group), : problem.numerators]
    return np.einsum("pj,jpqi->qij", numerators, lanes, order="C"), weights


def jacobian(
    problem: FitProblem, basis: Basis, slopes: tuple[Floats, Floats], numerators: Floats, u: Floats, part: Part
) -> Floats:
    """Differentiate a record's predicted output; see `sysid.transfer_functions.separable.sensitivities`."""
    n, k, lags, groups = problem.order, problem.integrators, problem.lags, problem.groups
    forced, weights = slopes
    free = np.einsum("pg,gpqi->qig", part.local[1 + k :].reshape(lags, groups), weights[:, k:])
    samples, lanes = len(part.states), np.arange(len(problem.group))
    by_input, by_start = np.zeros((2 * n, len(lanes), lags, groups)), np.zeros((2 * n, groups, lags, groups))
    by_input[:, lanes, :, problem.group] = forced.transpose(2, 0, 1)
    by_start[:, np.arange(groups), :, np.arange(groups)] = free.transpose(2, 0, 1)
    result = np.empty((samples, lags * groups + problem.delay_parameters))
    # Most weights are zero; to multiply by them takes no longer than to leave them out.
    result[:, : lags * groups] = sum(
        states.reshape(samples, -1) @ weight.reshape(-1, lags * groups)
        for states, weight in (
            (part.states, by_input[:n]),
            (squares_of(problem, basis, u, part), by_input[n:]),
            (basis.free[:samples], by_start[:n]),
            (basis.free_squares[:samples], by_start[n:]),
        )
    )
    if problem.delay_parameters:
        result[:, lags * groups :] = _by_delay(problem, basis, numerators, u, part.states)
    return result


def linearise(problem: FitProblem, basis: Basis, part: Part, columns: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Return what a record contributes to a Gauss-Newton step in everything shared: numerators, then poles and delays.

    After information and gradient come the outer products of the initial responses' coefficients, (groups, lags, lags),
    and the sums of squared residuals and of products of successive ones, (2,).
    """
    locals_, shared = len(part.local), len(part.information) - 1
    q = shared + columns.shape[1]
    information, gradient = np.empty((q, q)), np.empty(q)
    across = part.along(columns)
    coupling = np.hstack([part.coupling[:, :-1], forward(part.factor, across[:locals_])])
    information[:shared, :shared] = part.gram[locals_:-1, locals_:-1]
    information[:shared, shared:] = across[locals_:]
    information[shared:, :shared] = across[locals_:].T
    information[shared:, shared:] = columns.T @ columns
    information -= coupling.T @ coupling
    residual = part.residual
    along = part.along(residual)
    gradient[:shared] = along[locals_:]
    gradient[shared:] = columns.T @ residual
    # The local parameters are at their optimum: the prior balances their gradient, which the elimination passes on.
    gradient -= coupling.T @ forward(part.factor, along[:locals_] - basis.prior @ part.local)
    initial = part.local[1 + problem.integrators :].reshape(problem.lags, problem.groups)
    outer = np.einsum("kg,lg->gkl", initial, initial)
    return information, gradient, outer, np.array([residual @ residual, residual[1:] @ residual[:-1]])


def initial_prior(problem: FitProblem, system: Discretised) -> Floats:
    """Precision of a record's polynomial, which is free, and of its initial responses, times residual variance."""
    precision = problem.initial * system.initial_precision()
    first = 1 + problem.integrators
    prior = np.zeros((first + len(precision), first + len(precision)))
    prior[first:, first:] = precision + np.diag(1e-9 * np.diag(precision) + 1e-12)
    return prior


def missing_powers(problem: FitProblem) -> Floats:
    """Powers of the unit of frequency in each coefficient of a denominator; shape (groups, lags)."""
    return np.maximum(np.array(problem.lag_orders)[:, None] - np.arange(problem.lags), 0).astype(np.float64)


def _derivative_weights(problem: FitProblem, basis: Basis) -> Floats:
    """Express the derivatives of ``p^q / A`` by the poles' parameters in the states; shape (groups, n, 2 n, lags)."""
    k, lags = problem.integrators, problem.lags
    table = powers_over_square(basis.system)
    slopes = basis.slope / basis.system.unit[:, None, None] ** missing_powers(problem)[:, :, None]
    weights = np.empty((problem.groups, problem.order, 2 * problem.order, lags))
    for power in range(problem.order):
        # The coefficients of A that move belong to the powers above those of the integrators.
        weights[:, power] = -(table[:, power + k : power + k + lags].transpose(0, 2, 1) @ slopes)
    return weights


def powers_over_square(system: Discretised) -> Floats:
    """Express ``p^q / A^2`` (q < 2n - 1) in the states ``p^k / A`` and ``p^k / A^2``; shape (groups, 2n-1, 2 size)."""
    size = system.order
    rows = np.zeros((len(system.orders), 2 * size - 1, 2 * size))
    for n in set(system.orders):
        of = np.flatnonzero(np.array(system.orders) == n)
        mine = rows[of]
        mine[:, np.arange(n), size + np.arange(n)] = 1.0
        for q in range(n, 2 * n - 1):
            mine[:, q] = -(system.a[of, None, :n] @ mine[:, q - n : q])[:, 0]
            mine[:, q, q - n] += 1.0
        rows[of] = mine
    return rows


def _by_delay(problem: FitProblem, basis: Basis, numerators: Floats, u: Floats, states: Floats) -> Floats:
    """Differentiate by the delays in samples; shape (N, m).

    That is minus the time derivative of each input's response, but for what starts at rest when the record begins.
    """
    system, m = basis.system, len(problem.group)
    newer, older = delayed(u, problem.dt, basis.delays), delayed(u, problem.dt, basis.delays, 1)
    _, part = whole_and_part(basis.delays, problem.dt)
    acting = np.where(part > 1e-9, older, newer) if problem.hold == "zoh" else older + (1.0 - part) * (newer - older)
    rates = np.zeros((problem.order, m))
    direct = np.zeros(m)
    for j, g in enumerate(problem.group):
        order = problem.orders[g]
        for power, value in enumerate(numerators[:, j]):
            if power + 1 < order:
                rates[power + 1, j] -= value * system.unit[g]
            elif power < order:
                rates[:order, j] += value * system.unit[g] * system.a[g, :order]
                direct[j] -= value * system.unit[g]
    result = np.einsum("tkm,km->tm", states[:, : problem.order], rates) + acting * direct
    for j, g in enumerate(problem.group):
        impulse = basis.free[: len(u), : problem.numerators, g] @ numerators[:, j]
        result[:, j] += u[0, j] * system.unit[g] * impulse
    return problem.dt * np.asarray(result)


def own_eliminated(part: Part, columns: Floats) -> Floats:
    """Return the regressors of shared parameters less what the record's own can explain of them; shape (N, q)."""
    locals_, first = len(part.local), part.trends.shape[1] - 1
    along = np.hstack([part.gram[:locals_, locals_:-1], part.along(columns)[:locals_]])
    taken = backward(part.factor, forward(part.factor, along))
    rest = np.hstack([part.forced * part.used, columns])
    return np.asarray(rest - part.trends[:, :first] @ taken[:first] - part.free @ taken[first:])


def sum_of(parts: Sequence[Floats]) -> Floats:
    """Add what the records contribute, in their order."""
    total = parts[0].copy()
    for part in parts[1:]:
        total += part
    return total


# LAPACK itself: the matrices are so small that checks and dispatch around it take as long as the work.
def factorise(matrix: Floats) -> Floats:
    """Lower Cholesky factor of a symmetric matrix; LinAlgError when it is not positive definite."""
    factor, info = lapack.dpotrf(matrix, lower=1)
    if info:
        raise np.linalg.LinAlgError("normal equations are not positive definite")
    return np.asarray(factor)


def forward(factor: Floats, rhs: Floats) -> Floats:
    """Solve ``L x = rhs``."""
    return np.asarray(lapack.dtrtrs(factor, rhs, lower=1)[0])


def backward(factor: Floats, rhs: Floats) -> Floats:
    """Solve ``L' x = rhs``."""
    return np.asarray(lapack.dtrtrs(factor, rhs, lower=1, trans=1)[0])
