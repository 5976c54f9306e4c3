"""What each motor explains of the moments in windows of time, given all else that makes moments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.records.arrays import Floats
from sysid.rotors.motor_faults.moments import Flags, Moments, long_run_variance

#: Part of the best change of all moments that one motor must explain, and of its own explanation that none of the
#: others may reach if it is to be named alone.
ONE_MOTOR, ALIKE = 0.8, 0.85

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class WindowFits:
    """What each motor explains by itself in each of several windows, all shape (windows, motors)."""

    loss: Floats
    gain: Floats  #: Squared loss in standard deviations.
    part: Floats  #: Part of the best change of all moments that it explains.

    def alone(self, sign: float) -> Flags:
        """Return where a motor that gives less (1) or more (-1) explains what is seen, and no other as well."""
        gain = np.where(sign * self.loss > 0.0, self.gain, 0.0)
        others = np.sort(gain, axis=1)[:, -2:-1]
        best = gain == gain.max(axis=1, keepdims=True)
        return np.asarray(best & (gain > 0.0) & (self.part >= ONE_MOTOR) & (others < ALIKE * gain))


@dataclass(frozen=True, slots=True, eq=False)
class Remainder:
    """Moments that motion does not explain, and what does, by axis."""

    moments: Moments
    bases: list[Floats]  #: list of ndarray, shape (n, p): Orthonormal.
    residuals: list[Floats]  #: list of ndarray, shape (n,)

    @classmethod
    def of(cls, moments: Moments, *, lag: bool = False) -> Remainder:
        """Fit what else makes moments; with `lag` the motors' own lag too, which hides what lasts."""
        bases, residuals = [], []
        for asked, columns in zip(moments.asked, moments.columns, strict=True):
            each = np.column_stack([columns, np.gradient(asked, moments.t)]) if lag else columns
            basis = np.linalg.qr(each / np.maximum(np.linalg.norm(each, axis=0), 1e-12))[0]
            bases.append(np.asarray(basis))
            residuals.append(np.asarray(asked - basis @ (basis.T @ asked)))
        return cls(moments, bases, residuals)

    def fits(self, variances: Sequence[float], first: Rows, last: Rows) -> WindowFits:
        """Explain the windows of rows from `first` to before `last` by each motor, given each axis's noise."""
        thrust = self.moments.thrust
        hits, squares, free = (np.zeros((len(first), thrust.shape[1])) for _ in range(3))

        def total(values: Floats) -> Floats:
            sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
            return np.asarray(sums[last] - sums[first])

        for residual, basis, variance, factors in zip(
            self.residuals, self.bases, variances, self.moments.factors, strict=True
        ):
            seen, power = total(thrust * residual[:, None]), total(thrust**2)
            # What else moves takes of each window: the part of the motor's thrust that lies along it.
            left = power - sum(total(thrust * column[:, None]) ** 2 for column in basis.T)
            left = np.maximum(left, 1e-12)
            hits += factors * seen / variance
            squares += factors**2 * left / variance
            free += seen**2 / left / variance
        squares = np.maximum(squares, 1e-12)
        gain = hits**2 / squares
        return WindowFits(hits / squares, gain, gain / np.maximum(free, 1e-12))

    def without(self, row: int, column: int, loss: float) -> list[Floats]:
        """Return the residuals without a loss of one motor from a row on."""
        step = np.where(np.arange(len(self.moments.t)) >= row, self.moments.thrust[:, column], 0.0)
        return [
            residual - loss * factors[column] * (step - basis @ (basis.T @ step))
            for residual, basis, factors in zip(self.residuals, self.bases, self.moments.factors, strict=True)
        ]


def variances_of(residuals: Sequence[Floats], moments: Moments) -> list[float]:
    """Return the long-run variance of the residual of each axis."""
    return [long_run_variance(residual, moments.step) for residual in residuals]


def spread(values: Floats) -> float:
    """Estimate the standard deviation of values about zero from their bulk."""
    return max(1.4826 * float(np.median(np.abs(values))), 1e-6)
