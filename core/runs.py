"""Unbroken runs of samples."""

import numpy as np
import numpy.typing as npt


def runs(on: npt.ArrayLike) -> npt.NDArray[np.intp]:
    """Return the first sample of each unbroken run of true ones and the one behind its last, shape (k, 2)."""
    return np.flatnonzero(np.diff(np.asarray(on, np.int8), prepend=0, append=0)).reshape(-1, 2)
