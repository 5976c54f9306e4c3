"""What a deterministic model leaves unexplained, carried on from the measurements: an innovation form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sysid.records.experiment import Floats
from sysid.records.filtering import lfilter
from sysid.transfer_functions.model_record import Disturbance

#: Tracking indices to choose among: the disturbance's drive over one step against the noise of one measurement.
TRACKING_INDICES = tuple(10.0**exponent for exponent in (-3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0))


def carried_on(disturbance: Disturbance, residual: Floats, dt: float, steps: int) -> Floats:
    """Predict the residual at every sample from the samples up to `steps` before it, shape (N,)."""
    alpha, beta, fade = disturbance.alpha, disturbance.beta, disturbance.fade_seconds
    # Level and slope are filtered by one denominator, and so is their sum.
    slopes = fade * (1.0 - np.exp(-steps * dt / fade)) * beta / dt
    start = residual[0]
    denominator = [1.0, alpha + beta - 2.0, 1.0 - alpha]
    ahead = lfilter([alpha + slopes, beta - alpha - slopes], denominator, residual - start)
    result = np.zeros_like(residual)
    kept = 1.0 if disturbance.memory_seconds is None else float(np.exp(-steps * dt / disturbance.memory_seconds))
    result[steps:] = kept * (start + ahead)[:-steps]
    return result


def steady_gains(index: float) -> Disturbance:
    """Return the steady Kalman gains of a constant-velocity track for a tracking index (Kalata 1984)."""
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    return Disturbance(float(alpha), float(beta))


def fit_disturbance(residuals: Sequence[Floats], dt: float) -> Disturbance:
    """Choose the gains and the memory that predict the training residuals best a second ahead."""
    steps = max(round(1.0 / dt), 1)
    long = [residual for residual in residuals if len(residual) > steps]
    drifting = [steady_gains(index) for index in TRACKING_INDICES]
    # A level without a slope suits what wanders without direction.
    wandering = [Disturbance(candidate.alpha, 0.0) for candidate in drifting] + [Disturbance(1.0, 0.0)]
    best, least = drifting[0], np.inf
    for candidate in (*drifting, *wandering):
        predicted = [carried_on(candidate, residual, dt, steps)[steps:] for residual in long]
        size = sum(float(p @ p) for p in predicted)
        along = sum(float(p @ r[steps:]) for p, r in zip(predicted, long, strict=True))
        # What is left of the level after the horizon, by least squares, gives the memory.
        kept = min(max(along / size, 1e-9), 1.0) if size > 0.0 else 1.0
        kept = 1.0 if kept > 0.98 else kept
        error = sum(float(r[steps:] @ r[steps:]) for r in long) - 2.0 * kept * along + kept**2 * size
        if error < (1.0 - 1e-3) * least:
            least = error
            best = replace(candidate, memory_seconds=None if kept == 1.0 else float(-steps * dt / np.log(kept)))
    return best
