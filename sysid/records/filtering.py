"""Linear filters over sampled signals.

What `scipy.signal` offers for this; importing that takes as long as filtering the signals of a hundred flights.
"""

from collections.abc import Sequence

import numpy as np

from core.compiled import njit
from core.kernel_types import Matrix, Vector
from sysid.records import Floats

#: Samples by which signals are continued at both ends before they are filtered forth and back.
_ENDS = 9


@njit(cache=True, nogil=True)
def filtered(b: Vector, a: Vector, signals: Matrix, state: Matrix) -> Matrix:
    """Filter the columns of signals in the direct form II transposed.

    `b, a` (n + 1,): coefficients, a[0] being 1; `signals` (N, k); `state` (n + 1, k): at the start, its last row zero;
    it is left as the state at the end. Returns (N, k).
    """
    samples, columns = signals.shape
    result = np.empty((samples, columns))
    if b.size == 3:
        # Most are of this order: two numbers of state stay in registers.
        for c in range(columns):
            first, second = state[0, c], state[1, c]
            for t in range(samples):
                x = signals[t, c]
                y = first + b[0] * x
                first = second + b[1] * x - a[1] * y
                second = b[2] * x - a[2] * y
                result[t, c] = y
            state[0, c], state[1, c] = first, second
        return result
    for t in range(samples):
        for c in range(columns):
            x = signals[t, c]
            y = state[0, c] + b[0] * x
            for i in range(1, b.size):
                state[i - 1, c] = state[i, c] + b[i] * x - a[i] * y
            result[t, c] = y
    return result


def lfilter(
    b: Sequence[float] | Floats, a: Sequence[float] | Floats, signals: Floats, zi: Floats | None = None
) -> Floats:
    """Filter signals by ``(sum b_k z^-k) / (sum a_k z^-k)``, as `scipy.signal.lfilter` does along the first axis.

    `signals` (N,) or (N, k); `zi` (n,) or (n, k): state of the direct form II transposed before the first sample, n the
    order; at rest by default.
    """
    order = max(len(b), len(a)) - 1
    size = max(order + 1, 3)
    coefficients = np.zeros((2, size))
    coefficients[0, : len(b)], coefficients[1, : len(a)] = b, a
    coefficients /= coefficients[1, 0]
    columns = np.ascontiguousarray(signals if signals.ndim == 2 else signals[:, None], np.float64)
    state = np.zeros((size, columns.shape[1]))
    if zi is not None and order > 0:
        state[:order] = zi.reshape(order, -1)
    return np.asarray(filtered(coefficients[0], coefficients[1], columns, state)).reshape(np.shape(signals))


def above(signals: Floats, cutoff: float) -> Floats:
    """Pass what is faster than a frequency, without phase: a Butterworth filter of second order, forth and back.

    As `scipy.signal.sosfiltfilt` does it with a section of `scipy.signal.butter`, its ends continued as odd functions.

    `signals` (N, k): more than `_ENDS` samples.
    """
    warped = np.tan(np.pi * cutoff)
    scale = 1.0 + np.sqrt(2.0) * warped + warped**2
    b = np.array([1.0, -2.0, 1.0]) / scale
    a = np.array([1.0, 2.0 * (warped**2 - 1.0) / scale, (1.0 - np.sqrt(2.0) * warped + warped**2) / scale])
    first, last = signals[:1], signals[-1:]
    longer = np.concatenate([2.0 * first - signals[_ENDS:0:-1], signals, 2.0 * last - signals[-2 : -_ENDS - 2 : -1]])
    # What a constant leaves in the filter: it passes nothing of it.
    rest = np.array([[-b[0]], [b[2]]])
    for _ in range(2):
        longer = lfilter(b, a, longer, rest * longer[:1])[::-1]
    return np.asarray(longer[_ENDS:-_ENDS])


def low_pass_taps(count: int, cutoff: float) -> Floats:
    """Design a low-pass filter of finite length by the windowed sinc (Hamming)."""
    taps = np.sinc(2.0 * cutoff * (np.arange(count) - (count - 1) / 2.0)) * np.hamming(count)
    return np.asarray(taps / taps.sum())


def hann(size: int) -> Floats:
    """Return the periodic Hann window, shape (size,)."""
    return np.asarray(np.hanning(size + 1)[:-1])


def detrended(signals: Floats) -> Floats:
    """Subtract the straight line of least squares from each column, shape (N, k)."""
    t = np.arange(len(signals)) - (len(signals) - 1) / 2.0
    slope = t @ signals / max(float(t @ t), 1.0)
    left = np.multiply.outer(t, -slope)
    left -= signals.mean(axis=0)
    left += signals
    return np.asarray(left)


def welch(signal: Floats, rate: float, size: int) -> tuple[Floats, Floats]:
    """Estimate the one-sided power spectral density from windows that overlap by half, each without its mean.

    `signal` (..., N). Returns `hz` (size // 2 + 1,); `density` (..., size // 2 + 1): in squared units of the signal per
    Hz.
    """
    windows = np.lib.stride_tricks.sliding_window_view(signal, size, axis=-1)[..., :: size - size // 2, :]
    density: Floats = np.mean(densities(windows, rate), axis=-2)
    return np.asarray(np.fft.rfftfreq(size, 1.0 / rate), np.float64), density


def densities(windows: Floats, rate: float) -> Floats:
    """Estimate the one-sided power spectral density of each window, of what it has beside its mean.

    `windows` (..., size). Returns (..., size // 2 + 1).
    """
    size = windows.shape[-1]
    taper = hann(size)
    spectra = np.fft.rfft((windows - windows.mean(axis=-1, keepdims=True)) * taper)
    density: Floats = np.abs(spectra) ** 2 / (rate * float(taper @ taper))
    # All but the mean's and the Nyquist frequency's stand for two.
    density[..., 1 : (size + 1) // 2] *= 2.0
    return density
