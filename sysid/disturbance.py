"""What a deterministic model leaves unexplained, carried on from the measurements: an innovation form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.signal import lfilter

from sysid.experiment import Floats

#: Time over which an extrapolated slope fades, s; long against the horizons of interest, short against a flight.
FADE = 10.0

#: Tracking indices to choose among: the disturbance's drive over one step against the noise of one measurement.
TRACKING_INDICES = tuple(10.0**exponent for exponent in (-3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0))


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A level and a slope driven by white noise, tracked by a steady Kalman filter (alpha-beta filter, Kalata 1984).

    With the model's response taken off, this is the innovation form of an output-error model whose process noise
    enters an integrated random walk at the output.

    Attributes
    ----------
    alpha, beta : float
        Gains on level and on slope times step.
    """

    alpha: float
    beta: float

    def predict(self, residual: Floats, dt: float, steps: int) -> Floats:
        """Predict the residual at every sample from the samples up to `steps` before it.

        Parameters
        ----------
        residual : ndarray, shape (N,)
        dt : float
            s.
        steps : int
            At least 1.

        Returns
        -------
        ndarray, shape (N,)
            Zero for the first `steps` samples, before which nothing was measured.
        """
        level, slope = self.track(residual, dt)
        reach = FADE * (1.0 - np.exp(-steps * dt / FADE))
        result = np.zeros_like(residual)
        result[steps:] = (level + reach * slope)[:-steps]
        return result

    def track(self, residual: Floats, dt: float) -> tuple[Floats, Floats]:
        """Filter the residual into level and slope, starting from its first sample at rest.

        Returns
        -------
        level, slope : ndarray, shape (N,)
            In units of the residual and per second.
        """
        # Transfer functions of the alpha-beta filter from measurement to level and to slope; the start at the first
        # sample at rest makes the filter work on the difference to it.
        a = [1.0, self.alpha + self.beta - 2.0, 1.0 - self.alpha]
        start = residual[0]
        level = start + lfilter([self.alpha, self.beta - self.alpha, 0.0], a, residual - start)
        slope = lfilter([self.beta / dt, -self.beta / dt], a, residual - start)
        return np.asarray(level, dtype=np.float64), np.asarray(slope, dtype=np.float64)

    def to_dict(self) -> dict[str, Any]:
        """Give the gains for JSON."""
        return {"alpha": self.alpha, "beta": self.beta, "fade_seconds": FADE}


def steady_gains(index: float) -> Disturbance:
    """Give the steady Kalman gains of a constant-velocity track for a tracking index (Kalata 1984)."""
    r = (4.0 + index - np.sqrt(8.0 * index + index**2)) / 4.0
    alpha = 1.0 - r**2
    beta = 2.0 * (2.0 - alpha) - 4.0 * np.sqrt(1.0 - alpha)
    return Disturbance(float(alpha), float(beta))


def fit_disturbance(residuals: Sequence[Floats], dt: float, horizon: float = 1.0) -> Disturbance:
    """Choose the gains that predict the training residuals best `horizon` seconds ahead.

    Parameters
    ----------
    residuals : sequence of ndarray, shape (N,)
        One per record.
    dt, horizon : float
        s.
    """
    steps = max(round(horizon / dt), 1)

    def error(candidate: Disturbance) -> float:
        return sum(
            float(np.sum((r - candidate.predict(r, dt, steps))[steps:] ** 2)) for r in residuals if len(r) > steps
        )

    drifting = [steady_gains(index) for index in TRACKING_INDICES]
    # A level without a slope suits what wanders without direction.
    wandering = [Disturbance(candidate.alpha, 0.0) for candidate in drifting] + [Disturbance(1.0, 0.0)]
    return min((*drifting, *wandering), key=error)
