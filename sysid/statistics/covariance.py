"""Uncertainty of estimates whose residuals are coloured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy

from sysid.records.experiment import Floats


def autocovariance(residuals: Sequence[Floats], lags: int) -> Floats:
    """Estimate the autocovariance over several records, tapered (Bartlett) so that it stays positive semidefinite.

    Parameters
    ----------
    residuals : sequence of ndarray, shape (N_r,)
    lags : int
        Number of lags including 0.

    Returns
    -------
    ndarray, shape (lags,)
    """
    total, result = 0, np.zeros(lags)
    for residual in residuals:
        n = len(residual)
        spectrum = scipy.fft.rfft(residual, scipy.fft.next_fast_len(n + lags))
        product = scipy.fft.irfft(np.abs(spectrum) ** 2, scipy.fft.next_fast_len(n + lags))
        reach = min(lags, n)
        result[:reach] += product[:reach]
        total += n
    return np.asarray(result / total * (1.0 - np.arange(lags) / lags))


def independent_samples(residuals: Sequence[Floats]) -> float:
    """Count the independent samples that coloured residuals are worth: N over the sum of squared autocorrelations."""
    correlation = autocovariance(residuals, max(min(map(len, residuals)) // 2, 1))
    if not correlation[0] > 0.0:
        return float(sum(map(len, residuals)))
    correlation = correlation / correlation[0]
    return float(sum(map(len, residuals)) / (1.0 + 2.0 * np.sum(correlation[1:] ** 2)))


def coloured_information(regressors: Sequence[Floats], covariance: Floats) -> Floats:
    """Covariance of ``sum_t psi(t) e(t)`` for residuals e of a given autocovariance.

    Parameters
    ----------
    regressors : sequence of ndarray, shape (N_r, q)
        psi, one array per record; records are independent.
    covariance : ndarray, shape (lags,)

    Returns
    -------
    ndarray, shape (q, q)
    """
    q = regressors[0].shape[1]
    result = np.zeros((q, q))
    for psi in regressors:
        n = len(psi)
        reach = min(len(covariance), n)
        size = scipy.fft.next_fast_len(n + reach)
        kernel = np.zeros(size)
        kernel[:reach] = covariance[:reach]
        kernel[size - reach + 1 :] = covariance[reach - 1 : 0 : -1]
        spectrum = scipy.fft.rfft(kernel)
        # One regressor at a time: spectra of all of a long record would be the largest thing in memory.
        for k in range(q):
            filtered = scipy.fft.irfft(scipy.fft.rfft(psi[:, k], size) * spectrum, size)[:n]
            result[:, k] += psi.T @ filtered
    return 0.5 * (result + result.T)
