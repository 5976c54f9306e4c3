"""Arrays of records: their type, and how few samples are too few."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Fewest samples that make a record.
MIN_SAMPLES = 8
