"""Filter error: parameters from flights in gusts, whose push is a process of its own and not drag.

Output error takes what moves the craft to be known. In gusts it is not: they last as long as manoeuvres do, and the
autopilot answers to them, so that the velocity goes with the gust and takes its push for drag. The filter-error method
(Maine and Iliff 1985, NASA RP 1168, ch. 5; Jategaonkar 2015, ch. 5) has process noise: a Kalman filter foresees each
measurement from those before, and the parameters are those that make the innovations likeliest.

Velocity is measured much better than gusts disturb it, so that the equations of motion are taken at the measured
velocity. What is left of the velocity is the integral of the acceleration by gusts, a Gauss-Markov process (Dryden's
spectrum along the wind), of a white part that stands for what slowly sampled inputs hide, and noise::

    v(t) - v(0) - int f(theta, v, R, u) dt = int a dt + e,    a' = -a / tau + white noise

Their sizes are the likeliest of each flight, horizontally and vertically. Gusts are accelerations here and not winds:
the likelihood of winds would gain by more drag, under which lesser winds do the same.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from sysid.records.experiment import Floats
from sysid.rigid_body._filter_kernels import whiten
from sysid.rigid_body._rigid_kernels import AXIS_DRAG, ROTOR_DRAG
from sysid.rigid_body.body_motion import OWN, SHARED, BodyMotion, mean_accelerations
from sysid.transfer_functions.search import Progress

#: Residuals beyond this many standard deviations pull with constant force (Huber).
HUBER = 3.0

#: Shortest and longest time between innovations, s, twice that of the motor outputs where the log has them so often. An
#: autopilot that answers to a gust within a step ties its inputs to what they are taken to be independent of; steps as
#: short as the outputs' sampling show what is hidden between samples.
SHORTEST_STEP, LONGEST_STEP = 0.1, 0.2

#: Most rounds of parameters and disturbances in turn, and the change of the log-likelihood that ends them; most steps
#: in a round, and a gain that is not worth one: the noise in a single parameter is worth a half.
_ROUNDS, _SETTLED = 7, 0.2
_STEPS, _CONVERGED = 10, 0.01

#: Limits of gust [m/s^2], its correlation time [s], white part [m/s^2 sqrt(s)] and noise of velocity [m/s]; where the
#: search starts, and its first steps, as logarithms.
_LOW, _HIGH = np.log([1e-4, 0.3, 1e-4, 1e-4]), np.log([10.0, 100.0, 3.0, 1.0])
_START, _STRIDE = np.log([0.1, 5.0, 0.05, 0.02]), 0.7

#: Correlation time of gusts beforehand: mean and standard deviation of its logarithm. Dryden's length is some 100 m at
#: 15 m height; a push that wandered without end would pass for the mean wind.
_TAU = (np.log(10.0), 1.0)

#: Laws of drag in the order of preference.
LAWS = (ROTOR_DRAG, ROTOR_DRAG | AXIS_DRAG, 0, AXIS_DRAG)


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known beforehand: independent normal distributions, and the range in which values make sense."""

    #: shape (n,): Of all parameters as in `FilterErrorFit`; sigma may be infinite.
    mean: Floats
    sigma: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What moves a craft beside its inputs."""

    gust: float  #: Standard deviation of the acceleration by gusts, m/s^2.
    tau: float  #: Its correlation time, s.
    jolt: float  #: Spectral density of the white part of the acceleration, m/s^2 sqrt(s).
    noise: float  #: Standard deviation of measured velocity, m/s.


#: Disturbances of a flight, horizontal and vertical.
Disturbances = tuple[Disturbance, Disturbance]

#: Of a flight: unexplained velocity (n, 3), derivatives of the explained (n, 3, q) by its parameters, and step [s].
_Velocities = tuple[Floats, Floats, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class FilterErrorFit:
    """Estimates by filter error."""

    #: shape (n,): Shared parameters (`body_motion.THETA`), then wind exponent, thrust scale and wind of each flight.
    values: Floats
    covariance: Floats  #: shape (n, n): Prior knowledge included.
    information: Floats  #: shape (n, n): What the data alone say.
    disturbances: tuple[Disturbances, ...]  #: Of each flight.
    #: shape (clusters,): Negative log-likelihood of the innovations (Huber's beyond three standard deviations).
    costs: Floats
    converged: bool
    #: shape (SHARED,): Variances that another flight adds to those of `covariance` (`systematic.with_shared_errors`).
    transfer: Floats = field(default_factory=lambda: np.zeros(SHARED))
    #: shape (SHARED,): Half of what lies between these values and those with the autopilot's setting of the curvature,
    #: where the two contradict each other; else zero.
    halfway: Floats = field(default_factory=lambda: np.zeros(SHARED))

    @property
    def cost(self) -> float:
        """Sum of the clusters' costs."""
        return float(self.costs.sum())


@dataclass(slots=True)
class _Linearised:
    """Normal equations, and each cluster's cost and score."""

    costs: Floats
    hessian: Floats
    gradient: Floats
    scores: Floats
    flights: NDArray[np.int64]

    @property
    def cost(self) -> float:
        return float(self.costs.sum())


def fit_best_law(
    motions: Sequence[BodyMotion], prior: Prior, start: Floats, deadline: float, report: Progress
) -> tuple[FilterErrorFit, int]:
    """Fit by filter error under every law of drag; return the likeliest.

    All are compared under the disturbances of the first. Laws that can hardly be told from the best may each be the
    true one: the covariance is that of their mixture, the mean of theirs and of what they find otherwise.
    """
    report("gusts", 0.0)
    first = fit_filter_error(motions, start, prior, LAWS[0], deadline=deadline)
    fits = {LAWS[0]: first}
    for number, other in enumerate(LAWS[1:], start=1):
        report("gusts, another law of drag", 0.6 * number / len(LAWS))
        if time.monotonic() > deadline:
            return replace(first, converged=False), LAWS[0]
        rival = min(fit.cost for fit in fits.values())
        fits[other] = fit_filter_error(
            motions, first.values, prior, other, disturbances=first.disturbances, rival=rival, deadline=deadline
        )
    law = min(fits, key=lambda candidate: fits[candidate].cost)
    best = fits[law]
    chances = {other: _chance(best, fit) for other, fit in fits.items()}
    weights = {other: chance / sum(chances.values()) for other, chance in chances.items()}
    mixed = np.zeros_like(best.covariance)
    for other, fit in fits.items():
        off = (fit.values - best.values)[:SHARED]
        mixed[:SHARED, :SHARED] += weights[other] * np.outer(off, off)
        mixed += 0.0 if other == law else weights[other] * fit.covariance
    if law != LAWS[0]:
        report("gusts", 0.6)
        best = fit_filter_error(motions, best.values, prior, law, deadline=deadline)
    return replace(best, covariance=weights[law] * best.covariance + mixed), law


def _chance(best: FilterErrorFit, other: FilterErrorFit) -> float:
    """Weigh a law against the best by how far their clusters' costs differ, in standard deviations (Vuong 1989)."""
    differences = other.costs - best.costs
    scatter = float(np.sqrt(len(differences)) * differences.std())
    return float(np.exp(-0.5 * (differences.sum() / scatter) ** 2)) if scatter > 0.0 else 1.0


def flight_slice(flight: int) -> slice:
    """Return where exponent, scale and wind of a flight stand among the parameters."""
    width = len(OWN) + 2
    return slice(SHARED + flight * width, SHARED + (flight + 1) * width)


def fit_filter_error(
    motions: Sequence[BodyMotion],
    start: Floats,
    prior: Prior,
    law: int,
    *,
    disturbances: Sequence[Disturbances] | None = None,
    rival: float = np.inf,
    deadline: float = np.inf,
) -> FilterErrorFit:
    """Estimate the parameters of one craft from several flights in gusts.

    `start`, (n,), has shared parameters, then wind exponent, thrust scale and wind of each flight.
    """
    weight = 1.0 / prior.sigma**2
    values, converged, last = np.clip(start, prior.low, prior.high), False, np.inf
    # What is left over at first values is of the parameters: usual disturbances lead to better ones.
    usual = Disturbance(*map(float, np.exp(_START)))
    likeliest = list(disturbances or [(usual, usual)] * len(motions))

    def spent(now: _Linearised, at: Floats) -> float:
        return now.cost + 0.5 * float(weight @ (at - prior.mean) ** 2)

    parts = _explained(motions, values, law)
    for number in range(_ROUNDS if disturbances is None else 1):
        if number > 0:
            likeliest = [_likeliest(left, dt, both) for (left, _, dt), both in zip(parts, likeliest, strict=True)]
        now, damping = _linearise(parts, len(values), likeliest), 1e-9
        total = spent(now, values)
        for _ in range(_STEPS):
            hessian = now.hessian + np.diag(weight)
            uphill = now.gradient - weight * (values - prior.mean)
            accepted = False
            while not accepted and damping < 1e6:
                trial = step_within(hessian, uphill, damping, values, prior.low, prior.high)
                step = trial - values
                if step @ (uphill - 0.5 * hessian @ step) < _CONVERGED:
                    break
                then_parts = _explained(motions, trial, law)
                then = _linearise(then_parts, len(trial), likeliest)
                cost = spent(then, trial)
                if np.isfinite(cost) and cost <= total + 1e-9 * abs(total):
                    accepted, damping = True, max(0.1 * damping, 1e-9)
                else:
                    damping = max(10.0 * damping, 1e-3)
            if not accepted or time.monotonic() > deadline:
                break
            gain, values, now, total, parts = total - cost, trial, then, cost, then_parts
            # Farther from a rival than so many times the last gain it will not reach it.
            if gain < max(_CONVERGED, (total - rival) / 100.0):
                break
        if time.monotonic() > deadline:
            break
        if disturbances is not None or (number > 1 and abs(last - total) < _SETTLED):
            converged = True
            break
        last = total
    return _result(now, values, weight, tuple(likeliest), converged)


def step_within(hessian: Floats, uphill: Floats, damping: float, values: Floats, low: Floats, high: Floats) -> Floats:
    """Where a damped Gauss-Newton step leads within limits.

    What stands at its limit and is pulled outward stays; what would step over its limit stops there, and the others
    step anew as is best for them with that, lest they follow a step that is not taken.
    """
    stopped = ((values <= low) & (uphill < 0.0)) | ((values >= high) & (uphill > 0.0))
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    normal = hessian / np.outer(scale, scale) + damping * np.eye(len(values))
    reached = values.copy()
    while not stopped.all():
        moves = np.flatnonzero(~stopped)
        known = uphill[moves] / scale[moves] - normal[np.ix_(moves, stopped)] @ (scale * (reached - values))[stopped]
        step = np.linalg.lstsq(normal[np.ix_(moves, moves)], known, rcond=1e-13)[0]
        reached[moves] = values[moves] + step / scale[moves]
        over = (reached < low) | (reached > high)
        reached = np.clip(reached, low, high)
        if not over.any():
            break
        stopped |= over
    return reached


def _velocities(motion: BodyMotion, values: Floats, flight: int, law: int) -> _Velocities:
    """Compare the velocity of a flight with the integral of its modelled accelerations."""
    theta = np.concatenate([values[:SHARED], values[flight_slice(flight)]])
    step = min(max(2.0 * motion.input_interval, SHORTEST_STEP), LONGEST_STEP)
    stride = max(round(step / motion.dt), 1)
    push, slopes = mean_accelerations(motion, theta, np.ones((len(motion.t), 1)), law, stride)
    seconds = stride * motion.dt

    def integrated(rates: Floats) -> Floats:
        return np.concatenate([np.zeros((1, *rates.shape[1:])), np.cumsum(seconds * rates, axis=0)])

    return motion.velocity[::stride] - integrated(push), integrated(slopes), seconds


def _likeliest(left: Floats, dt: float, before: Disturbances) -> Disturbances:
    """Find the likeliest disturbances, horizontal and vertical, of unexplained velocities (n, 3)."""

    def search(columns: Floats, start: Floats) -> Disturbance:
        out = np.empty_like(columns)

        def cost(x: Floats) -> float:
            gust, tau, jolt, noise = np.exp(np.clip(x, _LOW, _HIGH))
            logs = whiten(columns, dt, gust, tau, jolt, noise, out)
            return float(_huber(out).sum() + columns.shape[1] * logs + 0.5 * ((x[1] - _TAU[0]) / _TAU[1]) ** 2)

        simplex = start + np.vstack([np.zeros(len(start)), _STRIDE * np.eye(len(start))])
        solved = scipy.optimize.minimize(
            cost,
            start,
            method="Nelder-Mead",
            options={"maxfev": 250, "xatol": 0.02, "fatol": 0.05, "initial_simplex": simplex},
        )
        return Disturbance(*(float(value) for value in np.exp(np.clip(solved.x, _LOW, _HIGH))))

    starts = [
        np.log([disturbance.gust, disturbance.tau, disturbance.jolt, disturbance.noise]) for disturbance in before
    ]
    horizontal, vertical = np.ascontiguousarray(left[:, :2]), np.ascontiguousarray(left[:, 2:])
    return search(horizontal, starts[0]), search(vertical, starts[1])


def _huber(z: Floats) -> Floats:
    size = np.abs(z)
    return np.where(size > HUBER, HUBER * (size - 0.5 * HUBER), 0.5 * size**2)


@np.errstate(over="ignore", invalid="ignore")
def _explained(motions: Sequence[BodyMotion], values: Floats, law: int) -> list[_Velocities]:
    """As `_velocities`, of all flights."""
    return [_velocities(motion, values, flight, law) for flight, motion in enumerate(motions)]


@np.errstate(over="ignore", invalid="ignore")
def _linearise(parts: Sequence[_Velocities], n: int, disturbances: Sequence[Disturbances]) -> _Linearised:
    """Form the normal equations of the innovations by n parameters, large ones with less weight."""
    hessian, gradient = np.zeros((n, n)), np.zeros(n)
    costs, scores, flights = [], [], []
    for flight, ((left, jacobian, dt), both) in enumerate(zip(parts, disturbances, strict=True)):
        places = np.r_[np.arange(SHARED), np.arange(n)[flight_slice(flight)]]
        starts = np.arange(0, max(len(left) - 1, 1), max(round(10.0 / dt), 1))
        spent, own = np.zeros(len(starts)), np.zeros((len(starts), n))
        for axis, noise in enumerate((both[0], both[0], both[1])):
            columns = np.column_stack([left[:, axis], jacobian[:, axis]])
            out = np.empty_like(columns)
            logs = whiten(columns, dt, noise.gust, noise.tau, noise.jolt, noise.noise, out)
            z = out[:, 0]
            spent += np.add.reduceat(_huber(z), starts) + logs / len(starts)
            root = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.abs(z), 1e-300)))
            rows, target = out[:, 1:] * root[:, None], z * root
            hessian[np.ix_(places, places)] += rows.T @ rows
            gradient[places] += rows.T @ target
            own[:, places] += np.add.reduceat(rows * target[:, None], starts, axis=0)
        costs.append(spent)
        scores.append(own)
        flights.append(np.full(len(starts), flight))
    return _Linearised(np.concatenate(costs), hessian, gradient, np.vstack(scores), np.concatenate(flights))


def inverted(information: Floats) -> Floats:
    """Invert an information matrix, of parameters of any units; what it says nothing of has no variance."""
    scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
    return np.asarray(np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-13) / np.outer(scale, scale))


def _result(
    now: _Linearised,
    values: Floats,
    weight: Floats,
    disturbances: tuple[Disturbances, ...],
    converged: bool,
) -> FilterErrorFit:
    """Invert the information; enlarge standard errors where scores scatter more than the disturbances explain."""
    inverse, scores = inverted(now.hessian + np.diag(weight)), now.scores
    # Neighbours are taken together: a disturbance that is not as it is modelled does not end with a cluster.
    same = (now.flights[1:] == now.flights[:-1])[:, None]
    cross = (scores[1:] * same).T @ scores[:-1]
    sandwich = inverse @ (scores.T @ scores + 0.5 * (cross + cross.T) + np.diag(weight)) @ inverse
    growth = np.sqrt(np.maximum(np.diag(sandwich) / np.maximum(np.diag(inverse), 1e-300), 1.0))
    return FilterErrorFit(
        values=values,
        covariance=inverse * np.outer(growth, growth),
        information=now.hessian,
        disturbances=disturbances,
        costs=now.costs,
        converged=converged,
    )
