"""Slopes and means of columns over some samples, which noise of single samples hardly moves."""

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


def slopes(values: Floats, dt: float, reach: int) -> Floats:
    """Differentiate columns over 2 * reach samples about each; shape (N - 2 reach, ...)."""
    return np.asarray((values[2 * reach :] - values[: -2 * reach]) / (2.0 * reach * dt))


def mean_over(values: Floats, width: int) -> Floats:
    """Average columns, shape (N, k), over `width` samples from each on; shape (N - width, k)."""
    total = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), 0.5 * (values[1:] + values[:-1])]), axis=0)
    return np.asarray((total[width:] - total[:-width]) / width)
