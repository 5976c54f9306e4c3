"""Output error over windows: paths restarted from free initial states are matched to measured positions.

A free run over a whole flight sums up every gust; windows of some seconds, each with an initial state of its own
(multiple shooting; Bock 1983), do not, and remain sensitive to every parameter. Gauss-Newton steps with exact
sensitivities; the initial states are projected out of each window's equations, so that the system to be solved has the
size of the parameters alone. Gusts and what the inputs' sampling hides colour the residuals: standard errors come from
the scatter of the windows' scores (the sandwich with windows as clusters; White 1982, Liang and Zeger 1986), and the
weight of prior knowledge against data is balanced by the information that the coloured residuals really carry.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.records.experiment import ExperimentError, Floats
from sysid.rigid_body.motion._rigid_kernels import path_sensitivities
from sysid.rigid_body.motion.body_motion import LAG, OWN, SHARED, Motion
from sysid.transfer_functions.reduction import backward, factorise, forward

#: Length of a window, s: long against the sampling of the motor outputs, short against a flight.
WINDOW_SECONDS = 10.0

#: Time between residuals, s: positions between them carry nothing new.
RESIDUAL_SECONDS = 0.1

#: Smallest standard deviation that a residual is weighted with, m: positions are not known better.
SMALLEST_SIGMA = 1e-4

#: Residuals beyond this many robust standard deviations pull with constant force (Huber).
HUBER = 3.0

#: Gauss-Newton steps after which a fit that has not settled is given up.
MOST_STEPS = 30

#: How often the residuals' spread is found anew.
_REWEIGHTINGS = 4

#: Largest part of a direction's information in one window that its score is corrected for.
_LARGEST_SHARE = 0.9

#: Scores of windows up to this many apart may go together: gusts last longer than a window.
_NEIGHBOURS = 2


#: Damping of normal equations with a diagonal of one, below which it changes no step.
_FELT = 1e-3

#: A step that gains less than this in log-likelihood is the last.
_CONVERGED = 5e-3


@dataclass(frozen=True, slots=True)
class Prior:
    """What is known beforehand: independent normal distributions, and the range in which values make sense."""

    #: shape (n,): Of all parameters in the order of `pack`; sigma may be infinite, or 0 for what is held.
    mean: Floats
    sigma: Floats
    low: Floats
    high: Floats


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputErrorFit:
    """Estimates by output error."""

    #: shape (n,): Shared parameters (`body_motion.THETA`), then wind exponent, thrust scale and wind coefficients of
    #: each flight.
    values: Floats
    covariance: Floats  #: shape (n, n): For coloured residuals, prior knowledge included; zero for what is held.
    information: Floats  #: shape (n, n): What the data alone say, scaled to the residuals' real information.
    rmse: float  #: Of position over all windows and axes, m.
    #: shape (windows,): Half the sum of squared residuals over their spread (Huber's beyond three of it), of each
    #: window.
    costs: Floats
    #: shape (flights, 3): Standard deviation of the residuals by which they were weighted, north, east, down, m.
    spread: Floats
    iterations: int
    converged: bool

    @property
    def cost(self) -> float:
        """Sum of the windows' costs."""
        return float(self.costs.sum())


@dataclass(slots=True)
class _Window:
    flight: int
    start: int
    stop: int
    stride: int
    initial: Floats
    #: Those shapes of the wind that are not zero in the window, on its samples; where its parameters stand among all,
    #: which of them are estimated, and where these stand among the estimated ones.
    shapes: Floats
    places: NDArray[np.int64]
    moves: NDArray[np.int64]
    free: NDArray[np.int64]


@dataclass(slots=True)
class _Paths:
    """Residuals of all windows, and derivatives of their positions by parameters and initial state."""

    residuals: list[Floats]
    jacobians: list[Floats]


@dataclass(slots=True)
class _Linearised:
    """Normal equations with initial states projected out, each window's part, and how its state follows.

    Scores, parts and last of `back` of a window are of the parameters that its `free` tells.
    """

    costs: Floats
    hessian: Floats
    gradient: Floats
    scores: list[Floats]
    parts: list[Floats]
    back: list[tuple[Floats, Floats]]
    residuals: list[Floats]
    spread: Floats
    windows: Sequence[_Window]

    @property
    def cost(self) -> float:
        return float(self.costs.sum())


def flight_slice(flight: int, shapes: int) -> slice:
    """Return where exponent, scale and wind coefficients of a flight stand among the parameters."""
    width = len(OWN) + 2 * shapes
    return slice(SHARED + flight * width, SHARED + (flight + 1) * width)


def fit_output_error(
    motions: Sequence[Motion],
    shapes: Sequence[Floats],
    start: Floats,
    prior: Prior,
    *,
    law: int,
    window_seconds: float | None = WINDOW_SECONDS,
    deadline: float = np.inf,
) -> OutputErrorFit:
    """Match the paths of one craft in several flights.

    Parameters
    ----------
    shapes : sequence of ndarray, shape (N, w)
        How the wind of each flight may vary with time; w alike for all.
    start : ndarray, shape (n,)
        Shared parameters, then wind exponent, thrust scale and wind of each flight.
    """
    free = np.flatnonzero(prior.sigma > 0.0)
    windows = _windows(motions, shapes, window_seconds, free)
    weight = np.where(np.isfinite(prior.sigma[free]), 1.0 / np.maximum(prior.sigma[free], 1e-300) ** 2, 0.0)
    values = np.clip(start, prior.low, prior.high)
    sigma = np.full((len(motions), 3), np.nan)
    converged, iteration = False, 0
    estimate_states = window_seconds is not None
    paths = _run_windows(motions, windows, values, law)
    now = _weigh(paths, windows, sigma, len(free), estimate_states)
    if not np.isfinite(now.cost):
        raise ExperimentError("the craft runs away from its measured path at the first values; check PWM and attitude")
    balance, damping, reweighted, settled = 1.0, 1e-6, 0, False
    while iteration < MOST_STEPS and time.monotonic() < deadline:
        iteration += 1
        if not settled:
            # The residuals' spread belongs to the estimates: weights follow it until it has settled.
            sigma, reweighted = np.maximum(now.spread, SMALLEST_SIGMA), reweighted + 1
            settled = reweighted >= _REWEIGHTINGS
            now = _weigh(paths, windows, sigma, len(free), estimate_states)
            balance = _balance(now)
        pull = balance * weight * (values[free] - prior.mean[free])
        total = now.cost + 0.5 * float(balance * weight @ (values[free] - prior.mean[free]) ** 2)
        uphill = now.gradient - pull
        hessian = now.hessian + np.diag(balance * weight)
        accepted = False
        while not accepted and damping < 1e6:
            trial = values.copy()
            trial[free] = step_within(hessian, uphill, damping, values[free], prior.low[free], prior.high[free])
            moved = trial[free] - values[free]
            states = [window.initial for window in windows]
            for window, (direct, by_theta) in zip(windows, now.back, strict=True):
                if estimate_states:
                    window.initial = window.initial + direct - by_theta @ moved[window.free]
            following = _run_windows(motions, windows, trial, law)
            then = _weigh(following, windows, sigma, len(free), estimate_states)
            cost = then.cost + 0.5 * float(balance * weight @ (trial[free] - prior.mean[free]) ** 2)
            if np.isfinite(cost) and cost <= total * (1.0 + 1e-9) + 1e-12:
                accepted, damping = True, max(damping * 0.1, 1e-9)
            else:
                damping = max(10.0 * damping, _FELT)
                for window, initial in zip(windows, states, strict=True):
                    window.initial = initial
        if not accepted:
            break
        gain = total - cost
        values, now, paths = trial, then, following
        if settled and gain < _CONVERGED * balance:
            converged = True
            break
    return _result(now, values, free, balance, weight, sigma, iteration, converged)


def step_within(hessian: Floats, uphill: Floats, damping: float, values: Floats, low: Floats, high: Floats) -> Floats:
    """Where a damped Gauss-Newton step leads within limits.

    What stands at its limit and is pulled outward stays; what would step over its limit stops there, and the others
    step anew as is best for them with that, lest they follow a step that is not taken.

    Parameters
    ----------
    hessian : ndarray, shape (n, n)
        Of the cost, by Gauss and Newton.
    uphill : ndarray, shape (n,)
        Direction of descent, the negative gradient of the cost.
    values, low, high : ndarray, shape (n,)
        Parameters and their limits.

    Returns
    -------
    ndarray, shape (n,)
        New parameters.
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


def _windows(
    motions: Sequence[Motion],
    shapes: Sequence[Floats],
    seconds: float | None,
    free: NDArray[np.int64],
) -> list[_Window]:
    """Cut each flight into windows."""
    windows = []
    for flight, motion in enumerate(motions):
        stride = max(round(RESIDUAL_SECONDS / motion.dt), 1)
        count = 1 if seconds is None else max(round(len(motion.t) * motion.dt / seconds), 1)
        for start, stop in pairwise(np.linspace(0, len(motion.t), count + 1).round().astype(int)):
            initial = np.concatenate([motion.position[start], motion.velocity[start]])
            active = np.flatnonzero(np.any(shapes[flight][start:stop] != 0.0, axis=0))
            first = flight_slice(flight, shapes[flight].shape[1]).start
            winds = (first + len(OWN) + 2 * active[:, None] + np.arange(2)).ravel()
            places = np.concatenate([np.arange(SHARED), np.arange(first, first + len(OWN)), winds])
            own = np.ascontiguousarray(shapes[flight][start:stop, active])
            # What is held need not be carried along.
            moves = np.flatnonzero(np.isin(places, free))
            among = np.searchsorted(free, places[moves])
            windows.append(_Window(flight, int(start), int(stop), stride, initial, own, places, moves, among))
    return windows


def _run_windows(motions: Sequence[Motion], windows: Sequence[_Window], values: Floats, law: int) -> _Paths:
    """Run all windows; a step too far may run away, which the infinite cost of its residuals tells."""
    signals = [motion.signals(values[LAG]) for motion in motions]
    paths = _Paths([], [])
    for window in windows:
        motion, theta = motions[window.flight], values[window.places]
        count = 1 + (window.stop - window.start - 1) // window.stride
        out, jacobian = np.empty((count, 3)), np.empty((count, 3, len(window.moves) + 6))
        path_sensitivities(
            theta,
            *signals[window.flight],
            window.shapes,
            motion.dt,
            motion.ground,
            law,
            window.start,
            window.initial,
            window.stride,
            window.moves,
            out,
            jacobian,
        )
        paths.residuals.append(motion.position[window.start : window.stop : window.stride] - out)
        paths.jacobians.append(jacobian)
    return paths


def _weigh(paths: _Paths, windows: Sequence[_Window], sigma: Floats, size: int, estimate_states: bool) -> _Linearised:
    """Form the normal equations of residuals over their spread, those beyond `HUBER` of it with less weight."""
    with np.errstate(over="ignore", invalid="ignore"):
        return _weighed(paths, windows, sigma, size, estimate_states)


def _weighed(paths: _Paths, windows: Sequence[_Window], sigma: Floats, size: int, estimate_states: bool) -> _Linearised:
    hessian, gradient = np.zeros((size, size)), np.zeros(size)
    now = _Linearised(
        np.zeros(len(windows)),
        hessian,
        gradient,
        [],
        [],
        [],
        paths.residuals,
        np.zeros((len(sigma), 3)),
        windows,
    )
    for k, (window, residual, jacobian) in enumerate(zip(windows, paths.residuals, paths.jacobians, strict=True)):
        noise = sigma[window.flight]
        noise = np.where(np.isfinite(noise), noise, 1.0)
        scaled = residual / noise
        size_of = np.abs(scaled)
        robust = np.where(size_of > HUBER, HUBER / np.maximum(size_of, 1e-300), 1.0)
        now.costs[k] = np.sum(np.where(size_of > HUBER, HUBER * (size_of - 0.5 * HUBER), 0.5 * size_of**2))
        root = np.sqrt(robust)
        flat = (jacobian * (root / noise)[:, :, None]).reshape(-1, jacobian.shape[2])
        places, own = window.free, len(window.free)
        gram, along = flat.T @ flat, flat.T @ (scaled * root).ravel()
        part, score, back = gram[:own, :own], along[:own], (np.zeros(6), np.zeros((6, own)))
        if not np.isfinite(gram).all():
            now.costs[k] = np.inf
        elif estimate_states:
            factor = factorise(gram[own:, own:])
            onto = forward(factor, np.column_stack([gram[own:, :own], along[own:]]))
            following = backward(factor, onto)
            back = following[:, -1], following[:, :-1]
            part, score = part - onto[:, :-1].T @ onto[:, :-1], score - onto[:, :-1].T @ onto[:, -1]
        now.back.append(back)
        hessian[np.ix_(places, places)] += part
        gradient[places] += score
        now.parts.append(part)
        now.scores.append(score)
    for flight in range(len(sigma)):
        together = np.concatenate([r for r, w in zip(paths.residuals, windows, strict=True) if w.flight == flight])
        # From the median, so that a few bad windows do not spoil the weight of the rest.
        now.spread[flight] = np.sqrt(np.median(together**2, axis=0) / 0.4549)
    return now


def _meat(now: _Linearised, total: Floats) -> Floats:
    """Covariance of the summed scores from the scatter of the windows.

    A fit follows the windows that tell a parameter, so that their scores scatter too little; they are enlarged by what
    the fit took (CR2; Bell and McCaffrey 2002). Near windows are taken together (Newey and West 1987).

    Parameters
    ----------
    total : ndarray, shape (n, n)
        Information of data and prior knowledge.
    """
    eigenvalues, vectors = np.linalg.eigh(total)
    kept = eigenvalues > 1e-14 * eigenvalues[-1]
    whiten = vectors[:, kept] / np.sqrt(eigenvalues[kept])
    added = np.zeros((len(now.scores), int(kept.sum())))
    plain = np.zeros((len(now.scores), len(total)))
    for k, (score, own, window) in enumerate(zip(now.scores, now.parts, now.windows, strict=True)):
        places = window.free
        # The share of a window is of the few dimensions that it tells of, and so are its axes.
        size, axes = np.linalg.eigh(own)
        root = (axes * np.sqrt(np.maximum(size, 0.0))).T @ whiten[places]
        share, inner = np.linalg.eigh(root @ root.T)
        share = np.maximum(share, 1e-12)
        along = inner.T @ (root @ (whiten[places].T @ score))
        growth = 1.0 / np.sqrt(1.0 - np.minimum(share, _LARGEST_SHARE)) - 1.0
        added[k] = root.T @ (inner @ (growth * along / share))
        plain[k, places] = score
    colour = vectors[:, kept] * np.sqrt(eigenvalues[kept])
    scores = (plain @ whiten + added) @ colour.T
    meat = scores.T @ scores
    flights = np.array([window.flight for window in now.windows])
    for lag in range(1, _NEIGHBOURS + 1):
        same = (flights[lag:] == flights[:-lag])[:, None]
        cross = (scores[lag:] * same).T @ scores[:-lag]
        meat = meat + (1.0 - lag / (_NEIGHBOURS + 1.0)) * (cross + cross.T)
    return np.asarray(meat)


def _balance(now: _Linearised) -> float:
    """Variance of the scores over that of white residuals: by how much coloured data overstate what they know."""
    scale = np.sqrt(np.maximum(np.diag(now.hessian), 1e-300))
    scaled = now.hessian / np.outer(scale, scale)
    inverse = np.linalg.pinv(scaled, rcond=1e-10, hermitian=True)
    rank = max(round(float(np.trace(inverse @ scaled))), 1)
    return max(float(np.trace(inverse @ (_meat(now, now.hessian) / np.outer(scale, scale)))) / rank, 1.0)


def _result(
    now: _Linearised,
    values: Floats,
    free: NDArray[np.int64],
    balance: float,
    weight: Floats,
    sigma: Floats,
    iterations: int,
    converged: bool,
) -> OutputErrorFit:

    total = now.hessian + np.diag(balance * weight)
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    bread = np.linalg.pinv(total / np.outer(scale, scale), rcond=1e-13) / np.outer(scale, scale)
    part = bread @ (_meat(now, total) + balance**2 * np.diag(weight)) @ bread
    covariance = np.zeros((len(values), len(values)))
    covariance[np.ix_(free, free)] = 0.5 * (part + part.T)
    information = np.zeros_like(covariance)
    information[np.ix_(free, free)] = now.hessian / balance
    everything = np.concatenate([r.ravel() for r in now.residuals])
    return OutputErrorFit(
        values=values,
        covariance=covariance,
        information=information,
        rmse=float(np.sqrt(np.mean(everything**2))),
        costs=now.costs,
        spread=sigma,
        iterations=iterations,
        converged=converged,
    )
