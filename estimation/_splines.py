"""Compiled cubic splines through the samples of an IMU."""

import numpy as np

from core.compiled import njit
from core.kernel_types import Matrix, Vector


@njit(cache=True, nogil=True)
def along_spline(knots: Vector, values: Matrix, at: Vector, integrate: bool) -> Matrix:
    """Follow the natural cubic spline through samples: its values, or its integrals from one time to the next."""
    n = knots.size
    # Second derivatives by elimination: they are zero at both ends (de Boor 1978, chapter IV).
    second = np.zeros((n, 3))
    above = np.zeros(n)
    chord = np.zeros(3)
    left = 0.0
    for i in range(n - 1):
        right = knots[i + 1] - knots[i]
        per_right = 1.0 / right
        pivot = 1.0 / (2.0 * (left + right) - left * above[i - 1]) if i > 0 else 0.0
        above[i] = right * pivot
        for c in range(3):
            before = chord[c]
            chord[c] = (values[i + 1, c] - values[i, c]) * per_right
            if i > 0:
                second[i, c] = (6.0 * (chord[c] - before) - left * second[i - 1, c]) * pivot
        left = right
    for i in range(n - 3, 0, -1):
        for c in range(3):
            second[i, c] -= above[i] * second[i + 1, c]
    result = np.empty((max(at.size - 1, 0) if integrate else at.size, 3))
    area, earlier = np.zeros(3), np.zeros(3)
    i = 0
    per_h = 1.0 / (knots[1] - knots[0])
    for k in range(at.size):
        while i < n - 2 and at[k] >= knots[i + 1]:
            h = knots[i + 1] - knots[i]
            for c in range(3):
                area[c] += h * (
                    0.5 * (values[i, c] + values[i + 1, c]) - h * h * (1.0 / 24.0) * (second[i, c] + second[i + 1, c])
                )
            i += 1
            per_h = 1.0 / (knots[i + 1] - knots[i])
        h, s = knots[i + 1] - knots[i], at[k] - knots[i]
        for c in range(3):
            y, m, jerk = values[i, c], second[i, c], (second[i + 1, c] - second[i, c]) * per_h
            slope = (values[i + 1, c] - y) * per_h - h * (1.0 / 6.0) * (2.0 * m + second[i + 1, c])
            if integrate:
                total = area[c] + s * (y + s * (0.5 * slope + s * (1.0 / 6.0 * m + s * (1.0 / 24.0 * jerk))))
                if k > 0:
                    result[k - 1, c] = total - earlier[c]
                earlier[c] = total
            else:
                result[k, c] = y + s * (slope + s * (0.5 * m + s * (1.0 / 6.0 * jerk)))
    return result
