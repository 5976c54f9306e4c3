"""Compiled loops of cubic splines."""

import numpy as np

from core.compiled import njit
from core.kernel_types import Matrix, Vector


@njit(cache=True, nogil=True)
def interpolated(t: Vector, values: Matrix, at: Vector) -> Matrix:
    """Interpolate by cubic splines, "not a knot" at the second and the last but one sample.

    The equations for the derivatives at the samples are solved from the first to the last and back. They need no
    pivots: steps are positive, so that what is divided by never falls below a step's part.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Ascending, four or more.
    values : ndarray, shape (n, k)
    at : ndarray, shape (m,)

    Returns
    -------
    ndarray, shape (m, k)
    """
    n, columns = values.shape
    slope = np.empty((n, columns))  # the derivative at each sample, in the end
    ratio = np.empty(n)  # of the derivative of the next sample to what that of a sample is without it
    for i in range(n):
        if i == 0:
            step, after = t[1] - t[0], t[2] - t[1]
            pivot, next_ = after, step + after
            for c in range(columns):
                one, two = (values[1, c] - values[0, c]) / step, (values[2, c] - values[1, c]) / after
                weighed = (step + 2.0 * (step + after)) * after * one + step * step * two
                slope[i, c] = weighed / (step + after) / pivot
        elif i < n - 1:
            before, after = t[i] - t[i - 1], t[i + 1] - t[i]
            pivot, next_ = 2.0 * (before + after) - after * ratio[i - 1], before
            for c in range(columns):
                one, two = (values[i, c] - values[i - 1, c]) / before, (values[i + 1, c] - values[i, c]) / after
                slope[i, c] = (3.0 * (after * one + before * two) - after * slope[i - 1, c]) / pivot
        else:
            step, before = t[i] - t[i - 1], t[i - 1] - t[i - 2]
            pivot, next_ = before - (step + before) * ratio[i - 1], 0.0
            for c in range(columns):
                one, two = (values[i, c] - values[i - 1, c]) / step, (values[i - 1, c] - values[i - 2, c]) / before
                weighed = (step + 2.0 * (step + before)) * before * one + step * step * two
                slope[i, c] = (weighed / (step + before) - (step + before) * slope[i - 1, c]) / pivot
        ratio[i] = next_ / pivot
    for i in range(n - 2, -1, -1):
        for c in range(columns):
            slope[i, c] -= ratio[i] * slope[i + 1, c]
    result = np.empty((at.size, columns))
    k = 0
    for j in range(at.size):
        x = at[j]
        if x < t[k] or (k + 8 < n and x >= t[k + 8]):
            first, beyond = 0, n - 1
            while beyond - first > 1:
                middle = (first + beyond) // 2
                if t[middle] <= x:
                    first = middle
                else:
                    beyond = middle
            k = first
        while k < n - 2 and x >= t[k + 1]:
            k += 1
        step, x = t[k + 1] - t[k], x - t[k]
        for c in range(columns):
            left, right = slope[k, c], slope[k + 1, c]
            chord = (values[k + 1, c] - values[k, c]) / step
            bend = (left + right - 2.0 * chord) / step
            result[j, c] = values[k, c] + x * (left + x * ((chord - left) / step - bend + x * (bend / step)))
    return result
