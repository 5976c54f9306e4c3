"""Equation error: parameters straight from measured accelerations, as the start of output error.

At every instant the accelerometer, turned by the attitude, gives the acceleration, and the equations of motion at the
measured velocity give the model's. Means over short blocks are matched by robust least squares (Huber), so that
vibration averages out and hard knocks do not pull. It converges from anywhere that makes sense, but noise in velocity
biases it, so that it only starts (Klein and Morelli 2006, ch. 5).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Floats
from sysid.rigid_body.methods.output_error import HUBER, Prior, flight_slice
from sysid.rigid_body.motion._rigid_kernels import AXIS_DRAG, ROTOR_DRAG
from sysid.rigid_body.motion.body_motion import SHARED, Motion
from sysid.rigid_body.motion.increments import mean_accelerations

#: Means are taken over this time, s: longer than the motor outputs' sampling, shorter than a manoeuvre.
BLOCK_SECONDS = 0.5

#: Laws of drag in the order of preference.
LAWS = (ROTOR_DRAG, ROTOR_DRAG | AXIS_DRAG, 0, AXIS_DRAG)

_MOST_STEPS = 25


@dataclass(frozen=True, slots=True)
class EquationErrorFit:
    """Start values by equation error."""

    values: Floats  #: shape (n,): Parameters as in `output_error`, under the first of `laws`.
    laws: tuple[int, ...]  #: Laws of drag, best first; in gusts the order says little.
    rmse: float  #: Of block means of acceleration, m/s^2.


def fit_equation_error(
    motions: Sequence[Motion], shapes: Sequence[Floats], start: Floats, prior: Prior
) -> EquationErrorFit:
    """Match accelerations with each law of drag.

    Parameters
    ----------
    shapes : sequence of ndarray, shape (N, w)
    start : ndarray, shape (n,)
    """
    measured = [_means(_acceleration(motion), _block(motion)) for motion in motions]
    values, sigma = _fit(motions, shapes, start, prior, LAWS[0], measured, None)
    fits = {LAWS[0]: values}
    fits |= {law: _fit(motions, shapes, values, prior, law, measured, sigma)[0] for law in LAWS[1:]}
    costs = {law: _spent(measured, motions, shapes, values, law, sigma) for law, values in fits.items()}
    laws = sorted(costs, key=lambda law: costs[law])
    residuals = _residuals(measured, motions, shapes, fits[laws[0]], laws[0])
    return EquationErrorFit(
        values=fits[laws[0]],
        laws=tuple(laws),
        rmse=float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))),
    )


def _acceleration(motion: Motion) -> Floats:
    if motion.acceleration is not None:
        return motion.acceleration
    return np.asarray(np.gradient(motion.velocity, motion.dt, axis=0))


def _block(motion: Motion) -> int:
    """Return the samples from one edge of a block to the next."""
    return min(max(round(BLOCK_SECONDS / motion.dt), 1), len(motion.t) - 1)


def _means(values: Floats, size: int) -> Floats:
    """Means by trapezoids from every `size`-th sample to the next."""
    count = (len(values) - 1) // size
    between = 0.5 * (values[1:] + values[:-1])[: count * size]
    return np.asarray(between.reshape(count, size, -1).mean(axis=1))


def _model(motion: Motion, shapes: Floats, values: Floats, flight: int, law: int) -> tuple[Floats, Floats]:
    own = flight_slice(flight, shapes.shape[1])
    return mean_accelerations(motion, np.concatenate([values[:SHARED], values[own]]), shapes, law, _block(motion))


def _residuals(
    measured: Sequence[Floats], motions: Sequence[Motion], shapes: Sequence[Floats], values: Floats, law: int
) -> list[Floats]:
    return [
        y - _model(motion, shape, values, flight, law)[0]
        for flight, (y, motion, shape) in enumerate(zip(measured, motions, shapes, strict=True))
    ]


def _huber(scaled: Floats) -> Floats:
    size = np.abs(scaled)
    return np.where(size > HUBER, HUBER * (size - 0.5 * HUBER), 0.5 * size**2)


def _spent(
    measured: Sequence[Floats],
    motions: Sequence[Motion],
    shapes: Sequence[Floats],
    values: Floats,
    law: int,
    sigma: Sequence[Floats],
) -> float:
    residuals = _residuals(measured, motions, shapes, values, law)
    return sum(float(np.sum(_huber(r / s))) for r, s in zip(residuals, sigma, strict=True))


def _fit(
    motions: Sequence[Motion],
    shapes: Sequence[Floats],
    start: Floats,
    prior: Prior,
    law: int,
    measured: Sequence[Floats],
    held: Sequence[Floats] | None,
) -> tuple[Floats, list[Floats]]:
    """Reweighted Gauss-Newton steps; `held` are the residuals' standard deviations to weight with, else their own."""
    free = np.flatnonzero(prior.sigma > 0.0)
    weight = np.where(np.isfinite(prior.sigma[free]), prior.sigma[free], np.inf) ** -2.0
    values = start.copy()
    sigma: list[Floats] = []
    for _ in range(_MOST_STEPS):
        n = len(values)
        hessian, gradient = np.zeros((n, n)), np.zeros(n)
        sigma = []
        for flight, (y, motion, shape) in enumerate(zip(measured, motions, shapes, strict=True)):
            model, jacobian = _model(motion, shape, values, flight, law)
            residual = y - model
            spread = np.maximum(np.sqrt(np.median(residual**2, axis=0) / 0.4549), 1e-4)
            sigma.append(spread if held is None else held[flight])
            scaled = residual / sigma[-1]
            root = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.abs(scaled), 1e-300)))
            own = flight_slice(flight, shape.shape[1])
            places = np.r_[np.arange(SHARED), np.arange(own.start, own.stop)]
            rows = (jacobian / sigma[-1][None, :, None] * root[:, :, None]).reshape(-1, len(places))
            hessian[np.ix_(places, places)] += rows.T @ rows
            gradient[places] += rows.T @ (scaled * root).ravel()
        pull = weight * (values[free] - prior.mean[free])
        matrix = hessian[np.ix_(free, free)] + np.diag(weight)
        scale = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        step = np.linalg.lstsq(matrix / np.outer(scale, scale), (gradient[free] - pull) / scale, rcond=1e-12)[0] / scale
        moved = np.clip(values[free] + step, prior.low[free], prior.high[free]) - values[free]
        values[free] += moved
        if np.all(np.abs(moved) * scale < 1e-3):
            break
    return values, sigma
