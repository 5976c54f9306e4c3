"""Cubic splines without `scipy.interpolate`, which imports all optimisers: that takes longer than to read a log."""

import numpy as np
import numpy.typing as npt

from core._spline_kernels import interpolated

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
    if len(t) >= 4:
        # Arrays that may not be written are other types, for which all would be compiled again.
        return interpolated(*(np.require(array, np.float64, ["C", "W"]) for array in (t, values, at)))
    k = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(t) - 2)[:, None]
    step, x = np.diff(t)[:, None], at[:, None] - t[k]
    slope = np.diff(values, axis=0) / step
    curve = np.zeros(values.shape[1]) if len(t) == 2 else (slope[1] - slope[0]) / (t[2] - t[0])
    # The parabola through three, or the line through two.
    between = slope[k[:, 0]] + curve * (x - step[k[:, 0]])
    return np.asarray(values[k[:, 0]] + x * between)
