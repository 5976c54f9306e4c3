"""What a deterministic model leaves unexplained, carried on from the measurements: an innovation form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.records.experiment import Floats
from sysid.records.filtering import lfilter
from sysid.transfer_functions.model_record import DisturbanceRecord

#: Time over which an extrapolated slope fades, s; long against the horizons of interest, short against a flight.
FADE = 10.0

#: Tracking indices to choose among: the disturbance's drive over one step against the noise of one measurement.
TRACKING_INDICES = tuple(10.0**exponent for exponent in (-3.0, -2.5, -2.0, -1.5, -1.0, -0.5, 0.0, 0.5, 1.0))


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A level and a slope driven by white noise, tracked by a steady Kalman filter (alpha-beta filter, Kalata 1984).

    With the model's response taken off, this is the innovation form of an output-error model whose process noise
    enters at the output: an integrated random walk, a random walk, white noise, or, with a finite memory, a first-order
    process that returns to the model.
    """

    #: Gains on level and on slope times step.
    alpha: float
    beta: float
    #: Time constant with which predictions return to the model, s; infinite for what wanders off.
    memory: float = np.inf

    def predict(self, residual: Floats, dt: float, steps: int) -> Floats:
        """Predict the residual at every sample from the samples up to `steps` before it, shape (N,)."""
        # Level and slope are filtered by one denominator, and so is their sum.
        slopes = FADE * (1.0 - np.exp(-steps * dt / FADE)) * self.beta / dt
        start = residual[0]
        ahead = lfilter([self.alpha + slopes, self.beta - self.alpha - slopes], self._denominator, residual - start)
        result = np.zeros_like(residual)
        result[steps:] = float(np.exp(-steps * dt / self.memory)) * (start + ahead)[:-steps]
        return result

    @property
    def _denominator(self) -> list[float]:
        return [1.0, self.alpha + self.beta - 2.0, 1.0 - self.alpha]

    def track(self, residual: Floats, dt: float) -> tuple[Floats, Floats]:
        """Filter the residual into level and slope, starting from its first sample at rest, shape (N,)."""
        # Transfer functions of the alpha-beta filter from measurement to level and to slope; the start at the first
        # sample at rest makes the filter work on the difference to it.
        a, start = self._denominator, residual[0]
        level = start + lfilter([self.alpha, self.beta - self.alpha, 0.0], a, residual - start)
        slope = lfilter([self.beta / dt, -self.beta / dt], a, residual - start)
        return np.asarray(level, dtype=np.float64), np.asarray(slope, dtype=np.float64)

    def record(self) -> DisturbanceRecord:
        """Return what files hold of it."""
        return DisturbanceRecord(alpha=self.alpha, beta=self.beta, fade_seconds=FADE, memory_seconds=self.memory)

    @classmethod
    def from_record(cls, record: DisturbanceRecord) -> Disturbance:
        """Make it again from its record."""
        return cls(record.alpha, record.beta, np.inf if record.memory_seconds is None else record.memory_seconds)


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
        predicted = [candidate.predict(residual, dt, steps)[steps:] for residual in long]
        size = sum(float(p @ p) for p in predicted)
        along = sum(float(p @ r[steps:]) for p, r in zip(predicted, long, strict=True))
        # What is left of the level after the horizon, by least squares, gives the memory.
        kept = min(max(along / size, 1e-9), 1.0) if size > 0.0 else 1.0
        kept = 1.0 if kept > 0.98 else kept
        error = sum(float(r[steps:] @ r[steps:]) for r in long) - 2.0 * kept * along + kept**2 * size
        if error < (1.0 - 1e-3) * least:
            least = error
            best = replace(candidate, memory=np.inf if kept == 1.0 else float(-steps * dt / np.log(kept)))
    return best
