"""When samples were true, which of them are usable, and the IMU's increments between any two times."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline, PPoly

GYRO = ["gyro_x", "gyro_y", "gyro_z"]
ACCEL = ["accel_x", "accel_y", "accel_z"]

#: Times are merged on this grid, s: finer than any autopilot's jitter, coarser than rounding.
TICK = 1e-4
#: A hole in the IMU longer than this is not bridged: the flight goes on in a new segment, s.
LONGEST_HOLE = 1.0
#: A craft that turns faster than this is in use, rad/s.
GYRO_MOVING = 0.2
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
    kept = table[np.isfinite(table[columns].to_numpy(float)).all(axis=1) & np.isfinite(table.index.to_numpy(float))]
    if not kept.index.is_monotonic_increasing:
        kept = kept.sort_index()
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

    Attributes
    ----------
    rate, force : PPoly
        rad/s and m/s^2 in body axes, of time on the boot clock, each shifted by its filter's delay.
    angle, velocity : PPoly
        Their integrals.
    noise_t : ndarray, shape (n,)
        s
    noise_density : ndarray, shape (n, 2)
        Density of the white noise of rate and force about `noise_t`, (rad/s)^2/Hz and (m/s^2)^2/Hz.
    start, stop : float
        s; where both are known.
    times : ndarray
        Times of the gyro samples, s.
    """

    rate: PPoly
    force: PPoly
    angle: PPoly
    velocity: PPoly
    noise_t: np.ndarray
    noise_density: np.ndarray
    start: float
    stop: float
    times: np.ndarray

    @classmethod
    def of(cls, imu: pd.DataFrame, parameters: Mapping[str, float], floor: tuple[float, float]) -> "InertialSignal":
        """Make the signal of one segment of the IMU table; `floor` is the sensors' own noise density (gyro, accel)."""
        t, values, hole = _regular(imu.index.to_numpy(float), imu[GYRO + ACCEL].to_numpy(float))
        density = noise_density(t, values, imu_cutoffs(parameters), floor)
        density += hole[:, None] * np.array([UNSEEN_RATE**2, UNSEEN_FORCE**2])
        gyro_delay, accel_delay = imu_delays(parameters)
        rate = CubicSpline(t - gyro_delay, values[:, :3], bc_type="natural")
        force = CubicSpline(t - accel_delay, values[:, 3:], bc_type="natural")
        return cls(
            rate=rate,
            force=force,
            angle=rate.antiderivative(),
            velocity=force.antiderivative(),
            noise_t=t,
            noise_density=density,
            start=float(t[0] - min(gyro_delay, accel_delay)),
            stop=float(t[-1] - max(gyro_delay, accel_delay)),
            times=t - gyro_delay,
        )

    def increments(self, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Integrate between successive times.

        Returns
        -------
        angle, velocity : ndarray, shape (n - 1, 3)
            rad and m/s, in body axes
        variance : ndarray, shape (n - 1, 2)
            Variance that white noise adds to attitude and velocity in each interval, rad^2 and (m/s)^2.
        """
        dt = np.diff(t)
        middle = 0.5 * (t[1:] + t[:-1])
        at = np.clip(np.searchsorted(self.noise_t, middle), 0, len(self.noise_t) - 1)
        return np.diff(self.angle(t), axis=0), np.diff(self.velocity(t), axis=0), self.noise_density[at] * dt[:, None]


def _regular(t: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Drop samples crowding together and fill holes by lines, so that a spline does not swing between them.

    The third result is for each sample the length of the hole that it fills, s; 0 for what was measured.
    """
    step = float(np.median(np.diff(t)))
    kept = np.concatenate([[True], np.diff(t) > 0.3 * step])
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

    Parameters
    ----------
    t : ndarray, shape (n,)
        s
    values : ndarray, shape (n, 6)
        Rates, then specific forces.
    cutoffs : (float, float)
        Of the low-pass filters on either, Hz; 0 for none.
    floor : (float, float)
        The sensors' own density, rad/s/sqrt(Hz) and m/s^2/sqrt(Hz).

    Returns
    -------
    ndarray, shape (n, 2)
        (rad/s)^2/Hz and (m/s^2)^2/Hz
    """
    step = float(np.median(np.diff(t)))
    density = np.empty((len(t), 2))
    for column, cutoff in enumerate(cutoffs):
        # Neighbours are taken so far apart that the filter leaves noise for the misfit to see.
        stride = max(1, round(1.0 / (step * 2.5 * cutoff))) if cutoff > 0.0 else 1
        block = values[:, 3 * column : 3 * column + 3]
        power = np.zeros(len(t))
        inside = slice(2 * stride, len(t) - 2 * stride)
        if len(t) > 4 * stride:
            misfit = sum(weight * block[k * stride : len(t) - (4 - k) * stride] for k, weight in enumerate(MISFIT))
            power[inside] = (misfit**2).mean(axis=1)
        level = _level(power[inside] if len(t) > 4 * stride else power, len(t), 2 * stride, step)
        beyond = np.where(power > 9.0 * level, power - level, 0.0)
        level += _aliased_share(cutoff, step, stride) * beyond
        spacing = stride * step
        density[:, column] = np.maximum(level * spacing / _misfit_of_white(cutoff * spacing), floor[column] ** 2)
    return density


def _level(power: np.ndarray, rows: int, first: int, step: float) -> np.ndarray:
    """Give the running median of the misfit's power, as a mean of normal noise, at all `rows` of the signal.

    `power` begins at row `first`.
    """
    span = min(len(power), max(3, round(NOISE_SPAN / step)))
    hop = max(1, round(NOISE_STEP / step))
    medians = np.median(np.lib.stride_tricks.sliding_window_view(power, span)[::hop], axis=1)
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
    """Power of the misfit of samples whose noise was white before a second-order Butterworth filter.

    Parameters
    ----------
    cutoff : float
        As a fraction of the sampling rate; 0 for no filter.

    Returns
    -------
    float
        Relative to the noise density at low frequency, folded into the band of one sample.
    """
    f = np.linspace(0.0, 0.5, 257)
    seen = np.abs(np.exp(-2j * np.pi * np.outer(f, np.arange(5))) @ MISFIT) ** 2
    if cutoff <= 0.0:
        return float(seen.mean())
    folded = (1.0 / (1.0 + ((f[:, None] + np.arange(-4, 5)) / cutoff) ** 4)).sum(axis=1)
    return float(np.mean(seen * folded) / folded[0])
