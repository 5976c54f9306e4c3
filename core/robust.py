"""Spread of values of which some are outliers."""

import numpy as np
import numpy.typing as npt


def robust_sigma(values: npt.ArrayLike) -> float:
    """Return the standard deviation of normal values about zero, by the median of their magnitudes (Hampel 1974)."""
    return 1.4826 * float(np.median(np.abs(values)))
