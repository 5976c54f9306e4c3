"""Experiments: records of inputs and outputs on one clock, and how they are cut from a flight or a table."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Fewest samples that make a record.
MIN_SAMPLES = 8
