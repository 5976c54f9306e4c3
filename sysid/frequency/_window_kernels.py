"""Compiled loops over the windows of spectra.

Transforms are kept as real numbers, shape (K, q, 2, F): of K windows and q signals the real and the imaginary parts at
F frequencies, which the innermost loops go along.
"""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from core.compiled import njit
from core.kernel_types import Int64s, Stack

Floats = NDArray[np.float64]
#: In single precision, which is as much as they hold.
Transforms = Annotated[NDArray[np.float32] | NDArray[np.float64], np.empty((0, 0, 0, 0), np.float32)]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def halved(padded: Floats, taps: Floats) -> Floats:
    """Filter signals and keep every second sample.

    `padded` (q, N): N at least as many as the taps; `taps` (n,). Returns ((N - n) // 2 + 1, q).
    """
    count = (padded.shape[1] - taps.size) // 2 + 1
    result = np.empty((count, padded.shape[0]))
    for signal in range(padded.shape[0]):
        for k in range(count):
            total = 0.0
            for i in range(taps.size):
                total += padded[signal, 2 * k + i] * taps[i]
            result[k, signal] = total
    return result


@njit(cache=True, nogil=True)
def products(left: Transforms, right: Transforms, places: Int64s, turns: Stack) -> Floats:
    """Sum the products of the transforms of one set of signals, conjugate, with those of another over windows.

    `left` (K, q, 2, F); `right` (K, r, 2, F); `places` (K,): place of each window, ascending, in the unit by which
    windows are shifted; `turns` (M, 2, F): weight and turn of the products between a window and one that comes 1, 2,
    ... M units later, whose transform is the conjugate one. With M = 0 windows meet themselves, and nothing else.
    Returns (q, r, 2, F).
    """
    windows, rows, _, count = left.shape
    result = np.zeros((rows, right.shape[1], 2, count))
    met = np.empty((2, count))
    for k in range(windows):
        for i in range(rows):
            if turns.shape[0] == 0:
                for f in range(count):
                    met[0, f], met[1, f] = left[k, i, 0, f], left[k, i, 1, f]
            else:
                for f in range(count):
                    met[0, f] = met[1, f] = 0.0
                for other in range(k + 1, windows):
                    apart = places[other] - places[k]
                    if apart > turns.shape[0]:
                        break
                    for f in range(count):
                        a, b = left[other, i, 0, f], left[other, i, 1, f]
                        x, y = turns[apart - 1, 0, f], turns[apart - 1, 1, f]
                        # The conjugate of the turn, since the transform is conjugate below.
                        met[0, f] += a * x + b * y
                        met[1, f] += b * x - a * y
            for j in range(right.shape[1]):
                for f in range(count):
                    a, b, x, y = met[0, f], met[1, f], right[k, j, 0, f], right[k, j, 1, f]
                    result[i, j, 0, f] += a * x + b * y
                    result[i, j, 1, f] += a * y - b * x
    return result
