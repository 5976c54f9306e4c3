"""When samples were true, which of them are usable, and the IMU's increments between any two times."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pandas as pd

from estimation._splines import along_spline

GYRO = ["gyro_x", "gyro_y", "gyro_z"]
ACCEL = ["accel_x", "accel_y", "accel_z"]

#: Times are merged on this grid, s: finer than any autopilot's jitter, coarser than rounding.
TICK = 1e-4
#: A hole in the IMU longer than this is not bridged: the flight goes on in a new segment, s.
LONGEST_HOLE = 1.0
#: A craft that turns faster than this is in use, rad/s.
GYRO_MOVING = 0.2
#: A craft that turns faster than this at all can learn its heading, rad/s.
TURNING = 0.06
#: Samples beyond a window that its spline is laid through: each takes the end's influence down to a quarter.
MARGIN = 40
#: What a multirotor may do unseen while IMU samples are missing: 1-sigma rate and specific force, rad/s and m/s^2.
UNSEEN_RATE, UNSEEN_FORCE = 0.5, 2.0


def filter_delay(cutoff: float) -> float:
    """Delay of ArduPilot's second-order Butterworth low-pass at low frequency, s, for its cut-off [Hz]; 0 Hz is off."""
    return float(np.sqrt(2.0) / (2.0 * np.pi * cutoff)) if cutoff > 0.0 else 0.0


def imu_cutoffs(parameters: Mapping[str, float]) -> tuple[float, float]:
    """Cut-off of the autopilot's low-pass filters on gyro and accelerometer, Hz; 0 where off or not logged."""
    return (
        parameters.get("INS_GYRO_FILTER", parameters.get("IMU_GYRO_CUTOFF", 0.0)),
        parameters.get("INS_ACCEL_FILTER", parameters.get("IMU_ACCEL_CUTOFF", 0.0)),
    )


def imu_delays(parameters: Mapping[str, float]) -> tuple[float, float]:
    """Delay of gyro and accelerometer samples by the autopilot's low-pass filters, s; 0 where the log does not tell."""
    gyro, accel = imu_cutoffs(parameters)
    return filter_delay(gyro), filter_delay(accel)


def usable(table: pd.DataFrame | None, columns: list[str]) -> pd.DataFrame | None:
    """Keep the rows whose `columns` are all finite, in order of time without repetition; None when none are left."""
    if table is None or not set(columns) <= set(table.columns):
        return None
    good = np.isfinite(table.index.to_numpy(float))
    for column in columns:
        good &= np.isfinite(table[column].to_numpy(float))
    # What is good as it is stays where it is: a long log's IMU is too large to be copied for nothing.
    kept = table if good.all() else table[good]
    if not kept.index.is_monotonic_increasing:
        kept = kept.sort_index()
    if not kept.index.is_unique:
        kept = kept[~kept.index.duplicated()]
    return None if kept.empty else kept


def sample_rate(table: pd.DataFrame | None) -> float:
    """Median sampling rate, Hz; 0 for fewer than two rows."""
    if table is None or len(table) < 2:
        return 0.0
    return float(1.0 / np.median(np.diff(table.index.to_numpy(float))))


def segments(table: pd.DataFrame, longest_hole: float = LONGEST_HOLE) -> list[pd.DataFrame]:
    """Split a table at holes in time."""
    breaks = np.flatnonzero(np.diff(table.index.to_numpy(float)) > longest_hole) + 1
    edges = [0, *breaks.tolist(), len(table)]
    return [table.iloc[a:b] for a, b in pairwise(edges)]


@dataclass(frozen=True, slots=True)
class InertialSignal:
    """Angular rate and specific force of one IMU as continuous functions of time.

    Between samples both are cubic splines: offline we may look at the next sample, so an interval is integrated to
    higher order than the trapezoid which the autopilot has.
    """

    t: np.ndarray  #: shape (n,): When the samples were written, s on the boot clock.
    #: shape (n, 6): Rate and force in body axes, rad/s and m/s^2; of the table itself where nothing had to be mended.
    values: np.ndarray
    #: By which each was true before it was written, s.
    gyro_delay: float
    accel_delay: float
    #: shape (n, 2): Density of the white noise of rate and force about `t`, (rad/s)^2/Hz and (m/s^2)^2/Hz.
    noise_density: np.ndarray
    #: s; where both are known.
    start: float
    stop: float

    @classmethod
    def of(cls, imu: pd.DataFrame, parameters: Mapping[str, float], floor: tuple[float, float]) -> "InertialSignal":
        """Make the signal of one segment of the IMU table; `floor` is the sensors' own noise density (gyro, accel)."""
        known = imu if list(imu.columns) == GYRO + ACCEL else imu[GYRO + ACCEL]
        t, values, hole = _regular(imu.index.to_numpy(float), known.to_numpy(float))
        density = noise_density(t, values, imu_cutoffs(parameters), floor)
        for column, motion in enumerate((UNSEEN_RATE, UNSEEN_FORCE)):
            density[:, column] += hole * motion**2
        gyro_delay, accel_delay = imu_delays(parameters)
        return cls(
            t=t,
            values=values,
            gyro_delay=gyro_delay,
            accel_delay=accel_delay,
            noise_density=density,
            start=float(t[0] - min(gyro_delay, accel_delay)),
            stop=float(t[-1] - max(gyro_delay, accel_delay)),
        )

    def rescaled(self, yaw: float) -> "InertialSignal":
        """Return the signal with the rate about the down axis times a factor."""
        if yaw == 1.0:
            return self
        values = self.values.copy()
        values[:, 2] *= yaw
        return replace(self, values=values)

    def before(self, stop: float) -> "InertialSignal":
        """Return the signal without the samples that nothing before `stop` [s] needs."""
        last = int(np.searchsorted(self.t, stop + max(self.gyro_delay, self.accel_delay))) + MARGIN + 1
        return replace(self, t=self.t[:last], values=self.values[:last], noise_density=self.noise_density[:last])

    def beyond(self, rate: float) -> np.ndarray:
        """Return for each sample whether the craft turns faster than `rate` [rad/s] about any axis, beyond its bias."""
        still = [float(np.median(self.values[:, axis])) for axis in range(3)]
        return np.asarray(
            np.logical_or.reduce([np.abs(self.values[:, axis] - still[axis]) > rate for axis in range(3)])
        )

    def rate(self, t: np.ndarray) -> np.ndarray:
        """Angular rate at ascending times; shape (n, 3), rad/s."""
        return self._along(t, slice(0, 3), self.gyro_delay, integrate=False)

    def force(self, t: np.ndarray) -> np.ndarray:
        """Specific force at ascending times; shape (n, 3), m/s^2."""
        return self._along(t, slice(3, 6), self.accel_delay, integrate=False)

    def samples_between(self, start: float, stop: float) -> np.ndarray:
        """Return the times of the gyro samples in a span of time, s."""
        first, last = np.searchsorted(self.t, [start + self.gyro_delay, stop + self.gyro_delay])
        return self.t[first:last] - self.gyro_delay

    def _along(self, t: np.ndarray, columns: slice, delay: float, *, integrate: bool) -> np.ndarray:
        at = np.ascontiguousarray(t, float) + delay
        if at.size == 0:
            return np.empty((0, 3))
        first, last = np.searchsorted(self.t, [at[0], at[-1]])
        window = slice(max(first - MARGIN, 0), last + MARGIN)
        # Copies: views of a table cannot be written to, which to numba is another type to compile for.
        return along_spline(self.t[window].copy(), self.values[window, columns].copy(), at, integrate)

    def increments(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return angles and velocities (n - 1, 3) between times, and what noise adds to their variance."""
        dt = np.diff(t)
        middle = 0.5 * (t[1:] + t[:-1])
        first, last = np.searchsorted(self.t, t[[0, -1]])
        at = np.minimum(first + np.searchsorted(self.t[first:last], middle), len(self.t) - 1)
        angle = self._along(t, slice(0, 3), self.gyro_delay, integrate=True)
        velocity = self._along(t, slice(3, 6), self.accel_delay, integrate=True)
        return angle, velocity, self.noise_density[at] * dt[:, None]


def _regular(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Drop samples crowding together and fill holes by lines, so that a spline does not swing between them.

    The third result is for each sample the length of the hole that it fills, s; 0 for what was measured.
    """
    step = float(np.median(np.diff(t)))
    kept = np.concatenate([[True], np.diff(t) > 0.3 * step])
    if not kept.all():
        t, values = t[kept], values[kept]
    gaps = np.diff(t)
    holes = np.flatnonzero(gaps > 2.5 * step)
    if holes.size == 0:
        return t, values, np.zeros(len(t))
    parts = [np.linspace(t[i], t[i + 1], round(gaps[i] / step) + 1)[1:-1] for i in holes]
    fill = np.concatenate(parts)
    length = np.concatenate([np.full(len(part), gaps[i]) for part, i in zip(parts, holes, strict=True)])
    filled = np.column_stack([np.interp(fill, t, column) for column in values.T])
    order = np.argsort(np.concatenate([t, fill]), kind="stable")
    return (
        np.concatenate([t, fill])[order],
        np.concatenate([values, filled])[order],
        np.concatenate([np.zeros(len(t)), length])[order],
    )


#: What is left of a sample after its neighbours two and one before and after have predicted it by a cubic.
MISFIT = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
#: Time over which the noise of an IMU is averaged, and from one such span to the next, s.
NOISE_SPAN, NOISE_STEP = 4.0, 1.0
#: Samples of which the noise is estimated at a time.
NOISE_PIECE = 1 << 14
#: Median of the mean of three squares of unit normal numbers (chi-square with three degrees of freedom, over three).
MEDIAN_OF_THREE = 0.78866


def noise_density(
    t: np.ndarray, values: np.ndarray, cutoffs: tuple[float, float], floor: tuple[float, float]
) -> np.ndarray:
    """Estimate the white noise of an IMU about each of its samples from what neighbouring samples do not foretell.

    Each sample is predicted by the cubic through its two neighbours on either side; of white noise with variance s^2
    the misfit has 70/36 s^2, less where a low-pass filter took away the high frequencies that it looks at. What is left
    of vibration and aliasing counts as noise, which is what it is to the integral.

    Movement misfits too, but in an instant, and only what of it lies about the sampling frequency disturbs the
    integral. So the noise is the median over four seconds; what a sample misfits beyond three sigma of that is a step
    of the rate or force, and counts by the share of a step's power at the sampling frequency (`_aliased_share`).
    """
    step = float(np.median(np.diff(t)))
    density = np.empty((len(t), 2))
    for column, cutoff in enumerate(cutoffs):
        # Neighbours are taken so far apart that the filter leaves noise for the misfit to see.
        stride = max(1, round(1.0 / (step * 2.5 * cutoff))) if cutoff > 0.0 else 1
        power = np.zeros(len(t))
        inside = slice(2 * stride, len(t) - 2 * stride)
        if len(t) > 4 * stride:
            _add_misfit(power[inside], values[:, 3 * column : 3 * column + 3], stride)
        level = _level(power[inside] if len(t) > 4 * stride else power, len(t), 2 * stride, step)
        beyond = np.where(power > 9.0 * level, power - level, 0.0)
        level += _aliased_share(cutoff, step, stride) * beyond
        spacing = stride * step
        density[:, column] = np.maximum(level * spacing / _misfit_of_white(cutoff * spacing), floor[column] ** 2)
    return density


def _add_misfit(power: np.ndarray, values: np.ndarray, stride: int) -> None:
    """Add the mean square over three axes of what neighbours `stride` samples apart do not foretell."""
    # In pieces that stay in the cache: the columns of a long log's table lie far apart in memory.
    for first in range(0, len(power), NOISE_PIECE):
        last = min(first + NOISE_PIECE, len(power))
        for axis in np.ascontiguousarray(values[first : last + 4 * stride].T):
            misfit = np.zeros(last - first)
            for k, weight in enumerate(MISFIT):
                misfit += weight * axis[k * stride : k * stride + last - first]
            power[first:last] += misfit**2 / 3.0


def _level(power: np.ndarray, rows: int, first: int, step: float) -> np.ndarray:
    """Return the running median of the misfit's power, as a mean of normal noise, at all `rows` of the signal.

    `power` begins at row `first`.
    """
    span = min(len(power), max(3, round(NOISE_SPAN / step)))
    hop = max(1, round(NOISE_STEP / step))
    windows = np.lib.stride_tricks.sliding_window_view(power, span)[::hop]
    # A few at a time: side by side they overlap, and are several times the signal.
    medians = np.concatenate([np.median(windows[k : k + 16], axis=1) for k in range(0, len(windows), 16)])
    middle = first + 0.5 * (span - 1) + hop * np.arange(len(medians))
    return np.asarray(np.interp(np.arange(rows), middle, medians) / MEDIAN_OF_THREE)


def _aliased_share(cutoff: float, step: float, stride: int) -> float:
    """Power of a step at the sampling frequency, over that at the frequency that the misfit looks at.

    A step's spectrum falls with 1/f, and a second-order Butterworth filter takes its part; the sampling folds what lies
    about its own frequency down to where the integral takes it for movement.
    """
    seen, folded = 0.5 / (stride * step), 1.0 / step
    filtered = (1.0 + (seen / cutoff) ** 4) / (1.0 + (folded / cutoff) ** 4) if cutoff > 0.0 else 1.0
    return float(filtered * (seen / folded) ** 2)


def _misfit_of_white(cutoff: float) -> float:
    """Power of the misfit of noise behind a second-order Butterworth filter over its density at low frequency."""
    f = np.linspace(0.0, 0.5, 257)
    seen = np.abs(np.exp(-2j * np.pi * np.outer(f, np.arange(5))) @ MISFIT) ** 2
    if cutoff <= 0.0:
        return float(seen.mean())
    folded = (1.0 / (1.0 + ((f[:, None] + np.arange(-4, 5)) / cutoff) ** 4)).sum(axis=1)
    return float(np.mean(seen * folded) / folded[0])
