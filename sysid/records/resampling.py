"""Signals of any rate onto one uniform clock: what is too fast for it does not fold, what came in slow rows is joined.

Samples every T joined by straight lines have the signal's spectrum times ``sinc(f T)^2``, and repetitions of it about
multiples of 1 / T: of a swing at 2 Hz, logged at 10 Hz, an eighth is missing. A filter with the inverse of that gain up
to four tenths of 1 / T, and none of the repetitions, joins the rows as a band-limited signal runs.
"""

from __future__ import annotations

import math

import numpy as np

from core.compiled import njit
from core.kernel_types import Vector
from sysid.records import Floats
from sysid.records.filtering import low_pass_taps

#: How far around the new clock a source is read, in steps of the new clock: more than the filter's half length.
_REACH = 6.0

#: A source is filtered when it is this much faster than the new clock.
FASTER = 1.5

#: Gain ends to follow the inverse, and ends to be any, in parts of the rows' rate.
_PASS, _STOP = 0.4, 0.6

_GRID = 4096


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def filtered_at(extended: Vector, taps: Vector, between: Vector) -> Vector:
    """Filter a signal and interpolate it by straight lines, both only where asked.

    `extended` (M + taps - 1,): signal, continued at both ends by half the filter; `between` (N,): where, in samples of
    the signal, 0 to M - 1. Returns (N,).
    """
    result = np.empty(between.size)
    last = extended.size - taps.size
    for k in range(between.size):
        first = min(int(between[k]), last)
        share = between[k] - first
        total = 0.0
        for j in range(taps.size):
            total += taps[j] * extended[first + j]
        if share > 0.0:
            after = 0.0
            for j in range(taps.size):
                after += taps[j] * extended[first + 1 + j]
            total += share * (after - total)
        result[k] = total
    return result


def resample(source_t: Floats, values: Floats, t: Floats) -> Floats:
    """Resample columns to the clock `t`: zero-phase low-pass where the source is faster, then linear interpolation.

    `source_t` (M,): strictly increasing, s; `values` (M, k): NaN marks missing samples; they are bridged by straight
    lines. A column without any value stays NaN; `t` (N,): uniform, s. Returns (N, k).
    """
    clock = NewClock(source_t, t)
    result = np.full((len(t), values.shape[1]), np.nan)
    for column in range(values.shape[1]):
        result[:, column] = clock.bring(values[:, column])
    return result


class NewClock:
    """Brings signals of one clock to another, as `resample` does."""

    def __init__(self, source_t: Floats, t: Floats) -> None:
        self.source_t, self.t = source_t, t
        self._dt = float((t[-1] - t[0]) / (len(t) - 1))
        self._step = float(np.median(np.diff(source_t)))

    def bring(self, signal: Floats) -> Floats:
        """Return a signal, shape (M,), on the new clock, shape (N,); NaN where fewer than two values are known."""
        t, dt, step, known = self.t, self._dt, self._step, np.isfinite(signal)
        if np.count_nonzero(known) < 2:
            return np.full(len(t), np.nan)
        # The rates of a fast loop are long: what is whole is not copied.
        time, signal = (self.source_t, signal) if known.all() else (self.source_t[known], signal[known])
        if dt < FASTER * step:
            return np.interp(t, time, signal)
        # Only what the new clock asks for is filtered: a damaged time stamp may lie years away.
        last = math.ceil((time[-1] - time[0]) / step + 0.5) - 1
        around = np.floor((t[[0, -1]] + [-_REACH * dt, _REACH * dt] - time[0]) / step).astype(np.int64)
        begin, end = np.clip(around, [0, 1], [last - 1, last])
        grid = time[0] + step * np.arange(begin, end + 1)
        between = np.interp(t, grid, np.arange(len(grid), dtype=np.float64))
        signal = np.interp(grid, time, signal)
        del grid
        # The stop band starts at half of the new rate.
        extended, taps = _extended(signal, step, 0.4 / dt)
        return np.asarray(filtered_at(extended, taps, between))


def logged_rate(values: Floats, dt: float) -> float:
    """Return how often signals that were brought to a clock had been logged, Hz; at most the clock's rate.

    Between what was logged run straight lines, which bend at one sample or two about each.

    `values` (N, k): logged together.
    """
    moving = values[:, np.ptp(values, axis=0) > 0.0]
    bends = np.any(np.abs(np.diff(moving, n=2, axis=0)) > 1e-6 * np.ptp(moving, axis=0), axis=1)
    first = np.flatnonzero(bends[1:] & ~bends[:-1])
    if len(first) < 3 or np.mean(bends) > 0.7:
        return 1.0 / dt
    return float(1.0 / (np.median(np.diff(first)) * dt))


def _extended(signal: Floats, dt: float, cutoff: float) -> tuple[Floats, Floats]:
    """Design a symmetric FIR low-pass filter and extend the signal for it at both ends.

    `signal` (N,). Returns `extended` (N + taps - 1,): the ends are continued by point reflection, which keeps level and
    slope; `taps`, a single one where there is nothing to filter.
    """
    half = min(round(1.6 / (cutoff * dt)), len(signal) - 1)
    if half < 1 or cutoff * dt >= 0.5:
        return signal, np.ones(1)
    before = 2.0 * signal[0] - signal[half:0:-1]
    after = 2.0 * signal[-1] - signal[-2 : -half - 2 : -1]
    return np.concatenate([before, signal, after]), low_pass_taps(2 * half + 1, cutoff * dt)


def join_rows(signals: Floats, dt: float, interval: float) -> Floats:
    """Return signals that were joined by straight lines as smooth as they were between their rows.

    `signals` (N, k): on a uniform clock. Returns (N, k): unchanged where the rows are as fast as the clock, or too few.
    """
    half = round(4 * interval / dt)
    if interval < 1.5 * dt or len(signals) <= 2 * half + 1:
        return signals
    taps = _taps(half, dt / interval)
    before, after = 2.0 * signals[0] - signals[half:0:-1], 2.0 * signals[-1] - signals[-2 : -half - 2 : -1]
    extended = np.concatenate([before, signals, after])
    return np.column_stack([np.convolve(column, taps, mode="valid") for column in extended.T])


def _taps(half: int, step: float) -> Floats:
    """Design the filter for a clock whose step is this part of the interval between rows; shape (2 half + 1,)."""
    frequency = np.fft.rfftfreq(_GRID, step)  # in parts of the rows' rate
    fade = np.clip((_STOP - frequency) / (_STOP - _PASS), 0.0, 1.0)
    gain = np.sin(0.5 * np.pi * fade) ** 2 / np.sinc(np.minimum(frequency, _STOP)) ** 2
    answer = np.fft.irfft(gain, _GRID)
    taps = np.concatenate([answer[-half:], answer[: half + 1]]) * np.hanning(2 * half + 3)[1:-1]
    return np.asarray(taps / taps.sum())
