"""Cubic splines without `scipy.interpolate`, which imports all optimisers: that takes longer than to read a log."""

import numpy as np
import numpy.typing as npt
import scipy

Floats = npt.NDArray[np.float64]


def cubic_spline(t: Floats, values: Floats, at: Floats) -> Floats:
    """Interpolate by the cubic spline through all samples, "not a knot" at the second and the last but one.

    As ``scipy.interpolate.CubicSpline(t, values)(at)``; beyond the samples the outermost cubics go on.

    Parameters
    ----------
    t : ndarray, shape (n,)
        Ascending, two or more.
    values : ndarray, shape (n, k)
    at : ndarray, shape (m,)

    Returns
    -------
    ndarray, shape (m, k)
    """
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)
    step, x = np.diff(t), at - t[k]
    result = np.empty((len(at), values.shape[1]))
    # Column by column: of a long log what lies between takes ten times the memory of the values.
    for column, of_column in enumerate(values.T):
        cubics = _cubics(t, step, np.ascontiguousarray(of_column, dtype=np.float64))
        total = cubics[3][k]
        for coefficient in cubics[2::-1]:
            total *= x
            total += coefficient[k]
        result[:, column] = total
    return result


def _cubics(t: Floats, step: Floats, values: Floats) -> tuple[Floats, ...]:
    """Return the coefficients of each interval's cubic, of the powers 0 to 3 of the time since its beginning."""
    slope = np.diff(values) / step
    if len(t) < 4:
        derivative = _of_few(t, slope)
    else:
        bands, right = np.zeros((3, len(t))), np.empty(len(t))
        before, after = step[:-1], step[1:]
        bands[0, 2:], bands[1, 1:-1], bands[2, :-2] = before, 2.0 * (before + after), after
        right[1:-1] = 3.0 * (after * slope[:-1] + before * slope[1:])
        # The third derivative does not jump at the second sample, nor at the last but one.
        for end, next_, sign in ((0, 1, 1), (-1, -2, -1)):
            both = step[end] + step[next_]
            bands[1, end], bands[0 if sign > 0 else 2, next_] = step[next_], both
            weighed = (step[end] + 2.0 * both) * step[next_] * slope[end] + step[end] ** 2 * slope[next_]
            right[end] = weighed / both
        derivative = scipy.linalg.solve_banded((1, 1), bands, right, overwrite_ab=True, overwrite_b=True)
    bend = (derivative[:-1] + derivative[1:] - 2.0 * slope) / step
    return values, derivative, (slope - derivative[:-1]) / step - bend, bend / step


def _of_few(t: Floats, slope: Floats) -> Floats:
    """Differentiate, at the samples, the parabola through three, or the line through two."""
    if len(t) == 2:
        return np.repeat(slope, 2)
    curve = (slope[1] - slope[0]) / (t[2] - t[0])
    return np.asarray(slope[0] + curve * (2.0 * t - t[0] - t[1]))
