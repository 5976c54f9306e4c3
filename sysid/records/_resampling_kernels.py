"""Compiled loop of resampling: a filter's output at a few of the signal's many samples."""

import numpy as np

from core.compiled import njit
from core.kernel_types import Vector


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
