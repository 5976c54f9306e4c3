"""Spectra of sampled signals by windows (Welch 1967).

What `scipy.signal` offers for this; importing that takes as long as the spectra of a hundred flights.
"""

import numpy as np

from sysid.records.arrays import Floats


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
