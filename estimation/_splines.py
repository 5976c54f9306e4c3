"""Compiled cubic splines through the samples of an IMU."""

import numpy as np

from logparse.numerics.compiled import njit
from logparse.numerics.kernel_types import Matrix, Vector


@njit(cache=True, nogil=True)
def along_spline(knots: Vector, values: Matrix, at: Vector, integrate: bool) -> Matrix:
    """Follow the natural cubic spline through samples: its values, or its integrals from one time to the next.

    Parameters
    ----------
    knots : ndarray, shape (n,)
        Ascending, two or more.
    values : ndarray, shape (n, 3)
    at : ndarray, shape (m,)
        Ascending; outside of the knots the outermost cubics go on.
    integrate : bool

    Returns
    -------
    ndarray, shape (m, 3), or (m - 1, 3) of integrals
    """
    n = knots.size
    # Second derivatives by elimination: they are zero at both ends (de Boor 1978, chapter IV).
    second = np.zeros((n, 3))
    above = np.zeros(n)
    for i in range(1, n - 1):
        left, right = knots[i] - knots[i - 1], knots[i + 1] - knots[i]
        pivot = 1.0 / (2.0 * (left + right) - left * above[i - 1])
        above[i] = right * pivot
        for c in range(3):
            bend = (values[i + 1, c] - values[i, c]) / right - (values[i, c] - values[i - 1, c]) / left
            second[i, c] = (6.0 * bend - left * second[i - 1, c]) * pivot
    for i in range(n - 3, 0, -1):
        for c in range(3):
            second[i, c] -= above[i] * second[i + 1, c]
    result = np.empty((max(at.size - 1, 0) if integrate else at.size, 3))
    area, before = np.zeros(3), np.zeros(3)
    i = 0
    for k in range(at.size):
        while i < n - 2 and at[k] >= knots[i + 1]:
            h = knots[i + 1] - knots[i]
            for c in range(3):
                area[c] += h * (
                    0.5 * (values[i, c] + values[i + 1, c]) - h * h / 24.0 * (second[i, c] + second[i + 1, c])
                )
            i += 1
        h, s = knots[i + 1] - knots[i], at[k] - knots[i]
        for c in range(3):
            y, m, jerk = values[i, c], second[i, c], (second[i + 1, c] - second[i, c]) / h
            slope = (values[i + 1, c] - y) / h - h / 6.0 * (2.0 * m + second[i + 1, c])
            if integrate:
                total = area[c] + s * (y + s * (slope / 2.0 + s * (m / 6.0 + s * jerk / 24.0)))
                if k > 0:
                    result[k - 1, c] = total - before[c]
                before[c] = total
            else:
                result[k, c] = y + s * (slope + s * (m / 2.0 + s * jerk / 6.0))
    return result
