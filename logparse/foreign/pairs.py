"""Motion, and its signals in pairs of which one must be the slope of the other; how alike two signals are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from core.units import STANDARD_GRAVITY
from logparse.foreign.columns import ColumnMap

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion in NED and FRD on a uniform clock, at the rate at which it is checked."""

    position: Floats  #: shape (N, 3), m
    velocity: Floats  #: shape (N, 3), m/s
    rotation: Rotation  #: Body to NED.
    rates: Floats  #: shape (N, 3), rad/s
    motors: Floats  #: shape (N, k), in the order declared
    dt: float  #: s

    def half(self, seconds: float) -> int:
        """Return half of a time in samples, at least one."""
        return max(round(seconds / self.dt / 2.0), 1)

    def acceleration(self, reach: int) -> Floats:
        """Acceleration over 2 * reach samples, m/s^2; shape (N - 2 reach, 3)."""
        return np.asarray((self.velocity[2 * reach :] - self.velocity[: -2 * reach]) / (2.0 * reach * self.dt))

    def specific_force(self, reach: int) -> Floats:
        """Acceleration less gravity in body axes, m/s^2, over 2 * reach samples; shape (N - 2 reach, 3)."""
        pushed = self.acceleration(reach) - np.array([0.0, 0.0, STANDARD_GRAVITY])
        return self.rotation[reach:-reach].apply(pushed, inverse=True)


@dataclass(frozen=True, slots=True)
class Pair:
    """A signal, and what it must be the slope of."""

    what: str  #: ``"velocity"`` or ``"rates"``.
    columns: tuple[str, ...]
    other: tuple[str, ...]  #: Columns of what changes.
    axes: str
    still: float  #: Movement below which there is nothing to compare, in the unit of the signal.
    signal: Floats  #: shape (N, 3)
    change: Callable[[int], Floats]  #: Of the other over so many samples, shape (N - width, 3).
    dt: float

    def over(self, width: int) -> tuple[Floats, Floats]:
        """Return the slope and the mean of the signal over so many samples, shape (N - width, 3)."""
        return self.change(width) / (width * self.dt), mean_over(self.signal, width)

    def moved(self, slope: Floats, signal: Floats) -> list[int]:
        """Return the axes along which either moves."""
        return [k for k in range(3) if max(slope[:, k].std(), signal[:, k].std()) > self.still]


def pairs_of(declared: ColumnMap, motion: Motion) -> list[Pair]:
    """Return velocity beside position and rates beside attitude, where both are logged."""
    position, rotation = motion.position, motion.rotation

    def moved(width: int) -> Floats:
        return np.asarray(position[width:] - position[:-width])

    def turning(width: int) -> Floats:
        return turned(rotation, width)

    found, dt = [], motion.dt
    if (late := declared.velocity) is not None:
        found.append(Pair("velocity", late.columns, declared.position.columns, "NED", 0.05, motion.velocity, moved, dt))
    if (late := declared.rates) is not None:
        found.append(Pair("rates", late.columns, declared.attitude.columns, "xyz", 0.05, motion.rates, turning, dt))
    return found


def turned(rotation: Rotation, width: int) -> Floats:
    """Return the turns over so many samples in body axes, rad; shape (N - width, 3)."""
    return np.asarray((rotation[:-width].inv() * rotation[width:]).as_rotvec())


def mean_over(values: Floats, width: int) -> Floats:
    """Average columns, shape (N, k), over `width` samples from each on; shape (N - width, k)."""
    total = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), 0.5 * (values[1:] + values[:-1])]), axis=0)
    return np.asarray((total[width:] - total[:-width]) / width)


def alike(a: Floats, b: Floats) -> float:
    """Return the correlation of signals, or of the columns of two together; zero where one does not move."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    norm = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    return float(np.sum(a * b)) / norm if norm > 0.0 else 0.0


def ratio(of: Floats, by: Floats) -> float:
    """Return how many times `of` is as large as `by`, by least squares through both."""
    return float(np.sqrt(np.sum((of - of.mean(axis=0)) ** 2) / max(float(np.sum((by - by.mean(axis=0)) ** 2)), 1e-300)))
