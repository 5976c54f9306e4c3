"""Signals of any rate onto one uniform clock, without folding what is too fast for it."""

from __future__ import annotations

import numpy as np
from scipy.signal import firwin, oaconvolve

from sysid.experiment import Floats

#: Pass band of the anti-aliasing filter in parts of the new sampling rate; the stop band starts at half of it.
PASS = 0.4

#: A source is filtered when it is this much faster than the new clock.
FASTER = 1.5


def resample(source_t: Floats, values: Floats, t: Floats) -> Floats:
    """Bring columns to the clock `t`: zero-phase low-pass where the source is faster, then straight lines.

    Parameters
    ----------
    source_t : ndarray, shape (M,)
        Strictly increasing, s.
    values : ndarray, shape (M, k)
        NaN marks missing samples; they are bridged by straight lines. A column without any value stays NaN.
    t : ndarray, shape (N,)
        Uniform, s.

    Returns
    -------
    ndarray, shape (N, k)
    """
    dt = float((t[-1] - t[0]) / (len(t) - 1))
    step = float(np.median(np.diff(source_t)))
    result = np.full((len(t), values.shape[1]), np.nan)
    for column in range(values.shape[1]):
        known = np.isfinite(values[:, column])
        if np.count_nonzero(known) < 2:
            continue
        time, signal = source_t[known], values[known, column]
        if dt >= FASTER * step:
            grid = np.arange(time[0], time[-1] + 0.5 * step, step)
            time, signal = grid, low_pass(np.interp(grid, time, signal), step, PASS / dt)
        result[:, column] = np.interp(t, time, signal)
    return result


def low_pass(signal: Floats, dt: float, cutoff: float) -> Floats:
    """Filter with a symmetric FIR filter; the ends are continued by point reflection, which keeps level and slope.

    Parameters
    ----------
    signal : ndarray, shape (N,)
    dt : float
        s.
    cutoff : float
        Hz.
    """
    half = min(round(1.6 / (cutoff * dt)), len(signal) - 1)
    if half < 1 or cutoff * dt >= 0.5:
        return signal
    taps = firwin(2 * half + 1, 2.0 * cutoff * dt)
    before = 2.0 * signal[0] - signal[half:0:-1]
    after = 2.0 * signal[-1] - signal[-2 : -half - 2 : -1]
    return np.asarray(oaconvolve(np.concatenate([before, signal, after]), taps, mode="valid"))
