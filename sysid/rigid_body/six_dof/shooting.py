"""Multiple shooting: errors of runs from measured states to several horizons, and the parameters that make them least.

A run starts at a measured state and is compared at several horizons, so that what a disturbance did to a sample, and
what the controller did about it, weighs little against what the inputs did over the whole run. Errors of each state at
each horizon are divided by their own spread, and runs that err more than usual count less (iteratively reweighted
least squares, so that the mean of error norms, not of their squares, becomes small).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Floats

#: Smallest part of the usual error by which a run is divided.
_FLOOR = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class ShootingFit:
    """Result of the search."""

    values: Floats  #: shape (P,)
    #: shape (P, P): Of fits without one block of neighbouring runs, so that it holds for coloured errors.
    covariance: Floats
    information: Floats  #: shape (P, P): Of the errors, without priors.


def state_errors(predicted: Floats, measured: Floats) -> Floats:
    """Errors of states: position, velocity, rotation vector in the body, rates.

    Shapes: `predicted`, `measured` (..., 18).
    """
    out = np.empty((*predicted.shape[:-1], 12))
    out[..., :6] = predicted[..., :6] - measured[..., :6]
    out[..., 9:] = predicted[..., 15:] - measured[..., 15:]
    a = measured[..., 6:15].reshape(*measured.shape[:-1], 3, 3)
    b = predicted[..., 6:15].reshape(*measured.shape[:-1], 3, 3)
    out[..., 6:9] = rotation_vectors(np.swapaxes(a, -1, -2) @ b)
    return out


def rotation_vectors(rotation: Floats) -> Floats:
    """Rotation vectors of rotation matrices (..., 3, 3), rad."""
    axis = 0.5 * np.stack(
        [
            rotation[..., 2, 1] - rotation[..., 1, 2],
            rotation[..., 0, 2] - rotation[..., 2, 0],
            rotation[..., 1, 0] - rotation[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.linalg.norm(axis, axis=-1)
    cosine = 0.5 * (np.trace(rotation, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    factor = np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)
    return np.asarray(axis * factor[..., None])


def spreads(errors: Sequence[Floats]) -> Floats:
    """Typical norm of the errors of each of the four states at each horizon, (M, 4)."""
    norms = np.concatenate([_norms(error) for error in errors])
    return np.asarray(np.maximum(np.median(norms, axis=0), 1e-9))


def _norms(errors: Floats) -> Floats:
    return np.asarray(np.linalg.norm(errors.reshape(*errors.shape[:-1], 4, 3), axis=-1))


def minimise(
    start: Floats,
    errors_of: Callable[[Floats], list[Floats]],
    prior_mean: Floats,
    prior_sigma: Floats,
    limits: tuple[Floats, Floats],
    steps: Floats,
    block: int,
    iterations: int = 12,
) -> ShootingFit:
    """Gauss-Newton with reweighting.

    Shapes: `start` (P,); `prior_mean`, `prior_sigma` (P,); `limits` (P,); `steps` (P,).
    """
    values = np.clip(start, *limits)
    errors = errors_of(values)
    damping = 0.0
    for _ in range(iterations):
        scales = spreads(errors)
        weights = [_weights(error, scales) for error in errors]
        gradient, information = _normal(_slopes(values, errors, errors_of, steps, limits), errors, weights)
        precision = 1.0 / prior_sigma**2
        cost = _cost(errors, weights) + float(np.sum(precision * (values - prior_mean) ** 2))
        improved = False
        for _ in range(6):
            lhs = information + np.diag(precision + damping * np.diag(information) + 1e-12)
            step = np.linalg.solve(lhs, -(gradient + precision * (values - prior_mean)))
            trial = np.clip(values + step, *limits)
            trial_errors = errors_of(trial)
            trial_cost = _cost(trial_errors, weights) + float(np.sum(precision * (trial - prior_mean) ** 2))
            if np.isfinite(trial_cost) and trial_cost < cost:
                improved = True
                break
            damping = max(10.0 * damping, 1e-3)
        if not improved:
            break
        values, errors, damping = trial, trial_errors, 0.1 * damping
        if cost - trial_cost < 1e-4 * cost:
            break
    scales = spreads(errors)
    weights = [_weights(error, scales) for error in errors]
    slopes = _slopes(values, errors, errors_of, steps, limits)
    _, information = _normal(slopes, errors, weights)
    return ShootingFit(
        values=values,
        covariance=_jackknife(slopes, errors, weights, scales, block, prior_sigma),
        information=information,
    )


def _weights(errors: Floats, scales: Floats) -> Floats:
    """Weight of every number of the errors."""
    relative = _norms(errors) / scales
    weight = 1.0 / (scales**2 * np.maximum(relative, _FLOOR))
    return np.asarray(np.repeat(weight, 3, axis=-1))


def _cost(errors: Sequence[Floats], weights: Sequence[Floats]) -> float:
    return float(sum(np.sum(w * e * e) for w, e in zip(weights, errors, strict=True)))


def _slopes(
    values: Floats,
    errors: Sequence[Floats],
    errors_of: Callable[[Floats], list[Floats]],
    steps: Floats,
    limits: tuple[Floats, Floats],
) -> list[Floats]:
    """Slope of the errors by each parameter, (P, errors) for each record."""
    slopes: list[list[Floats]] = [[] for _ in errors]
    for k, value in enumerate(values):
        step = steps[k] if value + steps[k] <= limits[1][k] else -steps[k]
        moved = values.copy()
        moved[k] += step
        for at, error in enumerate(errors_of(moved)):
            slopes[at].append(((error - errors[at]) / step).astype(np.float32))
    return [np.stack(slope).reshape(len(values), -1).astype(np.float64) for slope in slopes]


def _normal(slopes: Sequence[Floats], errors: Sequence[Floats], weights: Sequence[Floats]) -> tuple[Floats, Floats]:
    """Gradient and information."""
    count = len(slopes[0])
    gradient, information = np.zeros(count), np.zeros((count, count))
    for slope, error, weight in zip(slopes, errors, weights, strict=True):
        weighted = slope * weight.ravel()
        information += weighted @ slope.T
        gradient += weighted @ error.ravel()
    return gradient, information


def _jackknife(
    slopes: Sequence[Floats],
    errors: Sequence[Floats],
    weights: Sequence[Floats],
    scales: Floats,
    block: int,
    prior_sigma: Floats,
) -> Floats:
    """Covariance by what the values would be without one block of runs, each in turn (Bell and McCaffrey 2002).

    The curvature is less than the information: the weight of a run falls with its error, so that an error along itself
    hardly changes the gradient (of ``e / |e|`` the slope is ``(1 - e e^T / |e|^2) / |e|``). Standard errors with the
    information in its place would be a third too small.
    """
    gradients, curvatures = [], []
    for slope, error, weight in zip(slopes, errors, weights, strict=True):
        norms = _norms(error)
        falling = (norms > _FLOOR * scales).astype(np.float64)[..., None]
        along = error.reshape(*norms.shape, 3) / np.maximum(norms, 1e-12)[..., None] * falling
        for first in range(0, len(error), block):
            runs = slice(first, first + block)
            part = slope.reshape(len(slope), *error.shape)[:, runs].reshape(len(slope), -1)
            weighted, direction = part * weight[runs].ravel(), along[runs].ravel()
            cross = (weighted * direction).reshape(len(slope), -1, 3).sum(axis=2)
            gradients.append(weighted @ error[runs].ravel())
            curvatures.append(weighted @ part.T - cross @ (part * direction).reshape(len(slope), -1, 3).sum(axis=2).T)
    without = sum(curvatures) - np.array(curvatures) + np.diag(1.0 / prior_sigma**2 + 1e-12)
    changes = np.linalg.solve(without, np.array(gradients)[..., None])[..., 0]
    return np.asarray((len(changes) - 1) / len(changes) * changes.T @ changes)
