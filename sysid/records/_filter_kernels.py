"""Compiled loops of linear filters, of whole signals and of a few of their many samples."""

import numpy as np

from core.compiled import njit
from core.kernel_types import Matrix, Vector


@njit(cache=True, nogil=True)
def filtered(b: Vector, a: Vector, signals: Matrix, state: Matrix) -> Matrix:
    """Filter the columns of signals in the direct form II transposed.

    `b, a` (n + 1,): coefficients, a[0] being 1; `signals` (N, k); `state` (n + 1, k): at the start, its last row zero;
    it is left as the state at the end. Returns (N, k).
    """
    samples, columns = signals.shape
    result = np.empty((samples, columns))
    if b.size == 3:
        # Most are of this order: two numbers of state stay in registers.
        for c in range(columns):
            first, second = state[0, c], state[1, c]
            for t in range(samples):
                x = signals[t, c]
                y = first + b[0] * x
                first = second + b[1] * x - a[1] * y
                second = b[2] * x - a[2] * y
                result[t, c] = y
            state[0, c], state[1, c] = first, second
        return result
    for t in range(samples):
        for c in range(columns):
            x = signals[t, c]
            y = state[0, c] + b[0] * x
            for i in range(1, b.size):
                state[i - 1, c] = state[i, c] + b[i] * x - a[i] * y
            result[t, c] = y
    return result


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
