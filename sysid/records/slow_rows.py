"""What straight lines between the rows of a slow log take from a signal's swings, given back.

Samples every T joined by straight lines have the signal's spectrum times ``sinc(f T)^2``, and repetitions of it about
multiples of 1 / T: of a swing at 2 Hz, logged at 10 Hz, an eighth is missing. A filter with the inverse of that gain up
to four tenths of 1 / T, and none of the repetitions, joins the rows as a band-limited signal runs.
"""

from __future__ import annotations

import numpy as np

from sysid.records.arrays import Floats

#: Gain ends to follow the inverse, and ends to be any, in parts of the rows' rate.
_PASS, _STOP = 0.4, 0.6

#: Half of the filter's length, in intervals between rows.
_HALF = 4

#: A clock that is not this much faster than the rows leaves no lines to mend.
_FASTER = 1.5

_GRID = 4096


def join_rows(signals: Floats, dt: float, interval: float) -> Floats:
    """Return signals that were joined by straight lines as smooth as they were between their rows.

    `signals` (N, k): on a uniform clock. Returns (N, k): unchanged where the rows are as fast as the clock, or too few.
    """
    half = round(_HALF * interval / dt)
    if interval < _FASTER * dt or len(signals) <= 2 * half + 1:
        return signals
    taps = _taps(half, dt / interval)
    before, after = 2.0 * signals[0] - signals[half:0:-1], 2.0 * signals[-1] - signals[-2 : -half - 2 : -1]
    extended = np.concatenate([before, signals, after])
    return np.column_stack([np.convolve(column, taps, mode="valid") for column in extended.T])


def _taps(half: int, step: float) -> Floats:
    """Lay out the filter for a clock whose step is this part of the interval between rows; shape (2 half + 1,)."""
    frequency = np.fft.rfftfreq(_GRID, step)  # in parts of the rows' rate
    fade = np.clip((_STOP - frequency) / (_STOP - _PASS), 0.0, 1.0)
    gain = np.sin(0.5 * np.pi * fade) ** 2 / np.sinc(np.minimum(frequency, _STOP)) ** 2
    answer = np.fft.irfft(gain, _GRID)
    taps = np.concatenate([answer[-half:], answer[: half + 1]]) * np.hanning(2 * half + 3)[1:-1]
    return np.asarray(taps / taps.sum())
