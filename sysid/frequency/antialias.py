"""Bringing a fast signal to the times of slower rows without folding what is above half of their rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.cubic_spline import cubic_spline
from sysid.frequency.response import Floats
from sysid.records.filtering import low_pass_taps

#: Highest frequency that is passed on, in parts of the slower rate, and half the length of the filter in its samples.
_PASS, _REACH = 0.5, 15.0

#: Steps of the fast signal, in parts of the slow one's, from which on there is nothing to take away.
_ALIKE = 0.9

#: Longest step between samples, in usual ones, over which a filter may reach.
_HOLE = 2.5

#: Fewest samples of a piece.
_FEWEST = 8


def _pieces(t: Floats) -> NDArray[np.intp]:
    """Return the number of the stretch without holes that each sample is of, shape (N,)."""
    step = np.diff(t, prepend=t[:1])
    return np.cumsum(step > _HOLE * np.median(step))


def below(t: Floats, values: Floats, at: Floats, step: float) -> Floats:
    """Return signals at the times of rows `step` [s] apart, with what is above half of their rate taken away.

    The filter has no phase, and a gain of one below 0.44 of the rate. Signals that are no faster pass by cubic splines.

    `t` (N,); `values` (N, k); `at` (M,). Returns (M, k): NaN in holes, and at ends that the filter does not reach.
    """
    pieces = _pieces(t)
    result = np.full((len(at), values.shape[1]), np.nan)
    for piece in np.unique(pieces):
        rows = pieces == piece
        clock, even = t[rows], values[rows]
        if len(clock) < _FEWEST:
            continue
        own = float(np.median(np.diff(clock)))
        if own < _ALIKE * step:
            reach = round(_REACH * step / own)
            grid = clock[0] + own * np.arange(int((clock[-1] - clock[0]) / own + 1e-6) + 1)
            if len(grid) < 2 * reach + _FEWEST:
                continue
            taps = low_pass_taps(2 * reach + 1, _PASS * own / step)
            even = np.column_stack([np.convolve(each, taps, "valid") for each in cubic_spline(clock, even, grid).T])
            clock = grid[reach : len(grid) - reach]
        inside = (at >= clock[0]) & (at <= clock[-1])
        if inside.any():
            result[inside] = cubic_spline(clock, even, at[inside])
    return result
