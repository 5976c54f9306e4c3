"""Separable least squares for one output: numerators, offsets and initial states linear, the rest by Gauss-Newton.

For fixed denominators and delays the model is linear in the numerators (shared by all records) and, in every record, in
an offset and the response to the initial state. Those are solved exactly for every set of poles, and the poles follow
the Levenberg-Marquardt step of the problem so reduced (variable projection, Golub and Pereyra 1973, in Kaufman's form:
the joint Gauss-Newton step with the linear parameters eliminated). Everything needed of the data are inner products, so
that the cost of a step grows with the number of samples only in the response kernel and in a few products of matrices.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from sysid._kernels import combine
from sysid.experiment import Floats
from sysid.response import Discretised, delayed, discretise, gramians, trends, whole_and_part
from sysid.sections import Band, clip, denominators_of_orders

#: Largest change in one step of a logarithmic parameter, and of a delay in samples.
LONGEST_STEP = 1.0

#: What is left of the damping after a step that was as good as foreseen (Nielsen 1999). With a tenth, a third of the
#: steps was refused, and fits of eight denominators took a third more solutions.
MOST_RELIEF = 1.0 / 3.0

#: A step is the last when it lowers the cost by less than this part of one residual's variance: the noise in a single
#: parameter is worth a whole one.
ENOUGH = 0.02


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
        Poles of each denominator, integrators included; the most where `orders` differ.
    numerators : int
        Coefficients of each numerator, zeros + 1; the most where `counts` differ.
    dt : float
        s.
    hold : {"zoh", "foh"}
    band : Band
        Where poles may lie.
    ridge : float
        Weight of the numerators' impulse-response energy relative to the information in the data.
    initial : float
        Variance of the residual over the energy [s] that the response to an initial state is expected to have.
    integrators : int
        How many poles of every denominator are fixed at zero.
    orders : tuple of int, shape (groups,)
        Poles of each denominator; empty when all have `order`.
    counts : tuple of int, shape (m,)
        Coefficients of each numerator; empty when all have `numerators`.
    delays : tuple of float, shape (m,)
        Of each input, s; empty for none. Where a descent starts when they are estimated.
    longest_delay : float
        Delays are estimated from 0 to this, s; 0 takes them as given.
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
    integrators: int = 0
    orders: tuple[int, ...] = ()
    counts: tuple[int, ...] = ()
    delays: tuple[float, ...] = ()
    longest_delay: float = 0.0

    @property
    def groups(self) -> int:
        """Number of denominators."""
        return max(self.group) + 1

    @property
    def samples(self) -> int:
        """Samples of all records together."""
        return sum(len(y) for y in self.outputs)

    @property
    def lags(self) -> int:
        """Parameters of each denominator: poles that are not integrators."""
        return self.order - self.integrators

    @property
    def all_orders(self) -> tuple[int, ...]:
        """Poles of each denominator."""
        return self.orders or (self.order,) * self.groups

    @property
    def used(self) -> Floats:
        """1 for the coefficients that numerators have, 0 for those above their count; shape (numerators, m)."""
        counts = self.counts or (self.numerators,) * len(self.group)
        return (np.arange(self.numerators)[:, None] < np.array(counts)).astype(np.float64)

    @property
    def start_delays(self) -> Floats:
        """Delays of the inputs, s, shape (m,)."""
        return np.array(self.delays or (0.0,) * len(self.group))

    @property
    def delay_parameters(self) -> int:
        """How many delays are estimated: those of all inputs, or none."""
        return len(self.group) if self.longest_delay > 0.0 else 0


@dataclass(frozen=True, slots=True)
class Point:
    """The problem solved for its linear parameters at one set of poles.

    Attributes
    ----------
    theta : ndarray, shape (groups, lags)
    delays : ndarray, shape (m,)
        s.
    cost : float
        Sum of squared residuals plus the penalties.
    numerators : ndarray, shape (numerators, m)
        In normalised states, ascending.
    local : tuple of ndarray, shape (1 + integrators + lags groups,)
        Per record the polynomial in time (`sysid.response.trends`) and the coefficients of the initial responses.
    residuals : tuple of ndarray, shape (N_r,)
    regressors : tuple of ndarray, shape (N_r, local + numerators m + 1)
        Per record of the local parameters, of the numerators (power-major), and the output.
    grams : tuple of ndarray
        Their inner products.
    penalty : ndarray, shape (numerators m, numerators m)
    """

    theta: Floats
    delays: Floats
    cost: float
    numerators: Floats
    local: tuple[Floats, ...]
    residuals: tuple[Floats, ...]
    system: Discretised
    slope: Floats
    states: tuple[Floats, ...]
    free: Floats
    regressors: tuple[Floats, ...]
    grams: tuple[Floats, ...]
    penalty: Floats
    prior: Floats


def solve(problem: Problem, theta: Floats, delays: Floats | None = None) -> Point:
    """Solve for the linear parameters at given poles and delays, by default those of the problem."""
    delays = problem.start_delays if delays is None else delays
    k, m = problem.integrators, len(problem.group)
    a, slope = denominators_of_orders(theta, [order - k for order in problem.all_orders])
    a = np.hstack([np.zeros((len(a), k)), a])
    system = discretise(a, problem.dt, problem.hold, problem.all_orders)
    shared, used = problem.numerators * m, problem.used
    free = system.free(max(len(y) for y in problem.outputs))
    shapes = free[:, k : problem.order].reshape(len(free), -1)
    locals_ = 1 + k + shapes.shape[1]
    prior = initial_prior(problem, system)

    states, regressors, grams, factors, couplings = [], [], [], [], []
    information = np.zeros((shared + 1, shared + 1))
    late = delays if delays.any() else None
    for u, y in zip(problem.inputs, problem.outputs, strict=True):
        forced = system.forced(u, problem.group, delays=late)
        z = np.empty((len(y), locals_ + shared + 1))
        z[:, : 1 + k] = trends(len(y), k)
        z[:, 1 + k : locals_] = shapes[: len(y)]
        z[:, locals_:-1] = forced[:, : problem.numerators].reshape(len(y), shared)
        if problem.counts:
            z[:, locals_:-1] *= used.ravel()
        z[:, -1] = y
        gram = z.T @ z
        factor = _factor(gram[:locals_, :locals_] + prior)
        coupling = _forward(factor, gram[:locals_, locals_:])
        information += gram[locals_:, locals_:] - coupling.T @ coupling
        states.append(forced)
        regressors.append(z)
        grams.append(gram)
        factors.append(factor)
        couplings.append(coupling)

    penalty = _impulse_energy(problem, system, np.diag(information)[:-1], used)
    normal, scale = _normalised(information[:shared, :shared], penalty)
    c = scale * _backward(normal, _forward(normal, information[:shared, shared] * scale))
    cost = float(information[shared, shared] - information[:shared, shared] @ c)

    own, residuals = [], []
    for z, factor, coupling in zip(regressors, factors, couplings, strict=True):
        local = _backward(factor, coupling[:, -1] - coupling[:, :-1] @ c)
        own.append(local)
        residuals.append(z[:, -1] - z[:, :-1] @ np.concatenate([local, c]))
    return Point(
        theta=theta,
        delays=delays,
        cost=max(cost, 0.0),
        numerators=c.reshape(problem.numerators, m),
        local=tuple(own),
        residuals=tuple(residuals),
        system=system,
        slope=slope,
        states=tuple(states),
        free=free,
        regressors=tuple(regressors),
        grams=tuple(grams),
        penalty=penalty,
        prior=prior,
    )


def sensitivities(problem: Problem, point: Point) -> tuple[Floats, ...]:
    """Differentiate the model's output by the poles' parameters and the delays, linear parameters held.

    Returns
    -------
    tuple of ndarray, shape (N_r, lags groups + delay parameters)
        Of the poles parameter-major: all denominators' first parameters first. Delays in samples.
    """
    n, k, lags, groups = problem.order, problem.integrators, problem.lags, problem.groups
    weights = _derivative_weights(problem, point)
    lanes = weights[list(problem.group), : problem.numerators]
    forced = np.einsum("pj,jpqi->qij", point.numerators, lanes)
    result = []
    for r, (states, local) in enumerate(zip(point.states, point.local, strict=True)):
        initial = local[1 + k :].reshape(lags, groups)
        free = np.einsum("pg,gpqi->qig", initial, weights[:, k:])
        samples = len(states)
        jacobian = np.zeros((samples, lags * groups + problem.delay_parameters))
        poles = jacobian[:, : lags * groups]
        if groups == len(problem.group) and groups > 1:
            combine(states, forced, jacobian)
        else:
            spread = np.zeros((2 * n, len(problem.group), lags, groups))
            for j, g in enumerate(problem.group):
                spread[:, j, :, g] = forced[:, :, j]
            poles += states.reshape(samples, -1) @ spread.reshape(2 * n * len(problem.group), lags * groups)
        if groups > 1:
            combine(point.free[:samples], free, jacobian)
        else:
            poles += point.free[:samples, :, 0] @ free[:, :, 0]
        if problem.delay_parameters:
            jacobian[:, lags * groups :] = _by_delay(problem, point, problem.inputs[r], states)
        result.append(jacobian)
    return tuple(result)


def instruments(problem: Problem, point: Point) -> tuple[Floats, ...]:
    """Pass the model's response to the inputs through one more ``1 / A``: derivatives 0 to lags - 1, normalised.

    Returns
    -------
    tuple of ndarray, shape (N_r, lags)
        For a problem with one denominator.
    """
    k, lags, m = problem.integrators, problem.lags, len(problem.group)
    table = _powers_over_square(point.system)[0]
    weights = np.zeros((2 * problem.order, m, lags))
    for j in range(m):
        for power, value in enumerate(point.numerators[:, j]):
            weights[:, j] += value * table[power + k : power + k + lags].T
    flat = weights.reshape(-1, lags)
    return tuple(states.reshape(len(states), -1) @ flat for states in point.states)


def reduced_information(problem: Problem, point: Point, jacobians: tuple[Floats, ...]) -> tuple[Floats, Floats]:
    """Inner products of numerator and nonlinear regressors with offsets and initial states eliminated.

    Returns
    -------
    information : ndarray, shape (q, q)
        Without penalties; q = numerators * m + lags * groups + delay parameters.
    gradient : ndarray, shape (q,)
        Regressors times residual, of the data alone.
    """
    shared = point.numerators.size
    q = shared + jacobians[0].shape[1]
    information, gradient = np.zeros((q, q)), np.zeros(q)
    for z, gram, jacobian, residual, local in zip(
        point.regressors, point.grams, jacobians, point.residuals, point.local, strict=True
    ):
        locals_ = len(local)
        across = z.T @ jacobian
        factor = _factor(gram[:locals_, :locals_] + point.prior)
        coupling = _forward(factor, np.hstack([gram[:locals_, locals_:-1], across[:locals_]]))
        information -= coupling.T @ coupling
        information[:shared, :shared] += gram[locals_:-1, locals_:-1]
        information[:shared, shared:] += across[locals_:-1]
        information[shared:, :shared] += across[locals_:-1].T
        information[shared:, shared:] += jacobian.T @ jacobian
        along = z[:, :-1].T @ residual
        gradient[:shared] += along[locals_:]
        gradient[shared:] += jacobian.T @ residual
        # The local parameters are at their optimum: the prior balances their gradient, which the elimination passes on.
        gradient -= coupling.T @ _forward(factor, along[:locals_] - point.prior @ local)
    return information, gradient


@dataclass(frozen=True, slots=True)
class Descent:
    """Where a descent ended."""

    point: Point
    iterations: int
    converged: bool


def descend(
    problem: Problem,
    theta: Floats,
    iterations: int,
    deadline: float = np.inf,
    delays: Floats | None = None,
    settled: float = 0.0,
) -> Descent:
    """Follow Levenberg-Marquardt steps in poles and delays until the cost settles.

    Parameters
    ----------
    problem : Problem
    theta : ndarray, shape (groups, lags)
        Start.
    iterations : int
        Most steps to take.
    deadline : float
        On `time.monotonic`; reached, the best point so far is returned as not converged.
    delays : ndarray, shape (m,), optional
        Start; by default the problem's.
    settled : float
        Take a step that lowers the cost by no more than this part for the last.
    """
    point = solve(problem, clip(theta, problem.band, _lag_orders(problem)), delays)
    if problem.lags == 0 and not problem.delay_parameters:
        return Descent(point, 0, True)
    damping, growth = 1e-1, 2.0
    for iteration in range(iterations):
        if time.monotonic() > deadline:
            return Descent(point, iteration, False)
        hessian, gradient = nonlinear_system(problem, point)
        while True:
            step = _bounded_step(problem, point, hessian, gradient, damping)
            trial = solve(problem, *_moved(problem, point, step))
            if trial.cost < point.cost:
                break
            damping, growth = damping * growth, growth * 2.0
            if damping > 1e8 or time.monotonic() > deadline or not step.any():
                return Descent(point, iteration, damping > 1e8 or not step.any())
        gain = (point.cost - trial.cost) / max(point.cost, 1e-300)
        expected = float(step @ (2.0 * gradient - hessian @ step))
        quality = (point.cost - trial.cost) / expected if expected > 0.0 else 1.0
        damping, growth = damping * max(MOST_RELIEF, 1.0 - (2.0 * min(quality, 1.5) - 1.0) ** 3), 2.0
        damping = max(damping, 1e-9)
        point = trial
        if gain * problem.samples < ENOUGH or gain < settled:
            return Descent(point, iteration + 1, True)
    return Descent(point, iterations, False)


def nonlinear_system(problem: Problem, point: Point) -> tuple[Floats, Floats]:
    """Give Hessian and gradient of the reduced problem in poles and delays.

    Returns
    -------
    hessian : ndarray, shape (q, q)
        Gauss-Newton, in the order of `sensitivities`.
    gradient : ndarray, shape (q,)
        Minus half the derivative of the cost, but for what `_price_slopes` leaves out.
    """
    shared = point.numerators.size
    information, gradient = reduced_information(problem, point, sensitivities(problem, point))
    gradient[shared : shared + problem.lags * problem.groups] -= _price_slopes(problem, point)
    factor, scale = _normalised(information[:shared, :shared], point.penalty)
    coupling = _forward(factor, information[:shared, shared:] * scale[:, None])
    # At the optimum of the numerators the penalty balances their gradient; what is left acts on the poles alone.
    balance = _forward(factor, (gradient[:shared] - point.penalty @ point.numerators.ravel()) * scale)
    return information[shared:, shared:] - coupling.T @ coupling, gradient[shared:] - coupling.T @ balance


def _price_slopes(problem: Problem, point: Point) -> Floats:
    """Half the derivatives of both penalties by the poles' parameters, parameter-major, linear parameters held.

    Slow and lightly damped poles make impulse and initial responses of more energy. By central differences of the
    gramians, each denominator in the unit of frequency it has now; that the weight of an input's energy moves with its
    poles too is left out.
    """
    groups, lags, k, system = problem.groups, problem.lags, problem.integrators, point.system
    step = 1e-5
    moved = np.repeat(point.theta[None], 2 * lags, axis=0)
    moved[np.arange(lags), :, np.arange(lags)] += step
    moved[lags + np.arange(lags), :, np.arange(lags)] -= step
    orders = [order - k for order in problem.all_orders] * (2 * lags)
    seconds = denominators_of_orders(moved.reshape(-1, lags), orders)[0].reshape(2 * lags, groups, lags)
    a: Floats = (seconds / system.unit[:, None] ** _missing_powers(problem)).reshape(-1, lags)
    free = gramians(a, orders, 0).reshape(2, lags, groups, lags, lags)
    free = (free[0] - free[1]) / (2.0 * step)
    forced = free
    if k:
        a = np.hstack([np.zeros((len(a), k)), a])
        forced = gramians(a, problem.all_orders * (2 * lags), k).reshape(2, lags, groups, k + lags, k + lags)
        forced = (forced[0] - forced[1]) / (2.0 * step)
    lanes, used = list(problem.group), problem.used
    c, count = point.numerators, problem.numerators
    now = np.diagonal(system.gramians[lanes, :count, :count], axis1=1, axis2=2).T
    weight = (np.diag(point.penalty).reshape(used.shape) * used).sum(axis=0) / (now * used).sum(axis=0)
    each = weight * np.einsum("kj,ijkl,lj->ij", c, forced[:, lanes, :count, :count], c)
    slopes: Floats = each @ np.equal.outer(lanes, np.arange(groups)).astype(np.float64)
    for local in point.local:
        initial = local[1 + k :].reshape(lags, groups)
        price = np.einsum("kg,igkl,lg->ig", initial, free, initial)
        slopes += problem.initial * (np.array(problem.all_orders) - k) / system.unit * price
    return 0.5 * slopes.ravel()


def _moved(problem: Problem, point: Point, step: Floats) -> tuple[Floats, Floats]:
    """Poles and delays after a step in the order of the sensitivities, kept within their bounds."""
    groups, lags = problem.groups, problem.lags
    theta = point.theta + step[: lags * groups].reshape(lags, groups).T
    theta = clip(theta, problem.band, _lag_orders(problem))
    if not problem.delay_parameters:
        return theta, point.delays
    return theta, np.clip(point.delays + problem.dt * step[lags * groups :], 0.0, problem.longest_delay)


def _bounded_step(problem: Problem, point: Point, hessian: Floats, gradient: Floats, damping: float) -> Floats:
    step = np.zeros_like(gradient)
    theta, delays = _moved(problem, point, 1e-9 * np.sign(gradient))
    moves = (theta != point.theta).T.ravel()
    if problem.delay_parameters:
        moves = np.concatenate([moves, delays != point.delays])
    free = np.flatnonzero(moves)
    if len(free):
        block = hessian[np.ix_(free, free)]
        diagonal = np.diag(block)
        block = block + np.diag(damping * diagonal + 1e-9 * max(float(diagonal.max()), 1e-300))
        step[free] = np.linalg.solve(block, gradient[free])
    return np.clip(step, -LONGEST_STEP, LONGEST_STEP)


def _by_delay(problem: Problem, point: Point, u: Floats, states: Floats) -> Floats:
    """Differentiate by the delays in samples; shape (N, m).

    That is minus the time derivative of each input's response, but for what starts at rest when the record begins.
    """
    system, m = point.system, len(problem.group)
    newer, older = delayed(u, problem.dt, point.delays), delayed(u, problem.dt, point.delays, 1)
    _, part = whole_and_part(point.delays, problem.dt)
    acting = np.where(part > 1e-9, older, newer) if problem.hold == "zoh" else older + (1.0 - part) * (newer - older)
    rates = np.zeros((problem.order, m))
    direct = np.zeros(m)
    for j, g in enumerate(problem.group):
        order = problem.all_orders[g]
        for power, value in enumerate(point.numerators[:, j]):
            if power + 1 < order:
                rates[power + 1, j] -= value * system.unit[g]
            elif power < order:
                rates[:order, j] += value * system.unit[g] * system.a[g, :order]
                direct[j] -= value * system.unit[g]
    result = np.einsum("tkm,km->tm", states[:, : problem.order], rates) + acting * direct
    for j, g in enumerate(problem.group):
        impulse = point.free[: len(u), : problem.numerators, g] @ point.numerators[:, j]
        result[:, j] += u[0, j] * system.unit[g] * impulse
    return problem.dt * np.asarray(result)


def initial_prior(problem: Problem, system: Discretised) -> Floats:
    """Precision of a record's polynomial, which is free, and of its initial responses, times residual variance."""
    precision = problem.initial * system.initial_precision()
    first = 1 + problem.integrators
    prior = np.zeros((first + len(precision), first + len(precision)))
    prior[first:, first:] = precision + np.diag(1e-9 * np.diag(precision) + 1e-12)
    return prior


def _lag_orders(problem: Problem) -> tuple[int, ...]:
    return tuple(order - problem.integrators for order in problem.orders)


def _missing_powers(problem: Problem) -> Floats:
    """Powers of the unit of frequency in each coefficient of a denominator; shape (groups, lags)."""
    orders = np.array(problem.all_orders) - problem.integrators
    return np.maximum(orders[:, None] - np.arange(problem.lags), 0).astype(np.float64)


def _impulse_energy(problem: Problem, system: Discretised, energy: Floats, used: Floats) -> Floats:
    """Penalty matrix of the numerators: energy of each impulse response, weighed by the information on its input."""
    lanes, count = np.arange(len(problem.group)), problem.numerators
    blocks = system.gramians[list(problem.group), :count, :count] * used.T[:, :, None] * used.T[:, None, :]
    per_input = problem.ridge * energy.reshape(used.shape).sum(axis=0)
    blocks *= (per_input / np.trace(blocks, axis1=1, axis2=2))[:, None, None]
    penalty = np.zeros((*used.shape, *used.shape))
    penalty[:, lanes, :, lanes] = blocks
    result = penalty.reshape(used.size, used.size)
    result[np.diag_indices(used.size)] += 1.0 - used.ravel()
    return result


def _derivative_weights(problem: Problem, point: Point) -> Floats:
    """Express the derivatives of ``p^q / A`` by the poles' parameters in the states; shape (groups, n, 2 n, lags)."""
    k, lags = problem.integrators, problem.lags
    table = _powers_over_square(point.system)
    slopes = point.slope / point.system.unit[:, None, None] ** _missing_powers(problem)[:, :, None]
    weights = np.empty((problem.groups, problem.order, 2 * problem.order, lags))
    for power in range(problem.order):
        # The coefficients of A that move belong to the powers above those of the integrators.
        weights[:, power] = -(table[:, power + k : power + k + lags].transpose(0, 2, 1) @ slopes)
    return weights


def _powers_over_square(system: Discretised) -> Floats:
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


def _normalised(information: Floats, penalty: Floats) -> tuple[Floats, Floats]:
    """Factor the penalised information of the numerators, scaled to a unit diagonal; the factor and the scale."""
    normal = information + penalty
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
    normal = normal * scale * scale[:, None]
    normal[np.diag_indices(len(scale))] += 1e-13
    return _factor(normal), scale


# LAPACK itself: the matrices are so small that checks and dispatch around it take as long as the work.
def _factor(matrix: Floats) -> Floats:
    factor, info = lapack.dpotrf(matrix, lower=1)
    if info:
        raise np.linalg.LinAlgError("normal equations are not positive definite")
    return np.asarray(factor)


def _forward(factor: Floats, rhs: Floats) -> Floats:
    return np.asarray(lapack.dtrtrs(factor, rhs, lower=1)[0])


def _backward(factor: Floats, rhs: Floats) -> Floats:
    return np.asarray(lapack.dtrtrs(factor, rhs, lower=1, trans=1)[0])
