"""Uncertainty of estimates whose residuals are coloured."""

from __future__ import annotations

from collections.abc import Callable, Sequence

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
        coloured = _colouring(covariance, n)
        # One regressor at a time: spectra of all of a long record would be the largest thing in memory.
        for k in range(q):
            result[:, k] += psi.T @ coloured(psi[:, k])
    return 0.5 * (result + result.T)


def lagged_information(signals: Sequence[Floats], lags: int, covariance: Floats) -> Floats:
    """Covariance of ``sum_t u(t - j) e(t)`` over lags j = 1 ... `lags`, for residuals e of a given autocovariance.

    As `coloured_information` of the lagged signals beside each other, which would take `lags` times the memory: two
    columns one lag further on differ by what comes in at one end and goes out at the other.

    Parameters
    ----------
    signals : sequence of ndarray, shape (N_r,)
        u, one array per record, of more than `lags` samples; residuals start at the sample `lags`.
    lags : int
    covariance : ndarray, shape (reach,)

    Returns
    -------
    ndarray, shape (lags, lags)
    """
    result = np.zeros((lags, lags))
    for u in signals:
        n = len(u) - lags
        # By the sample at which a column starts, from 0 (the longest lag) to lags - 1 (one sample).
        found = np.zeros((lags, lags))
        filtered = _colouring(covariance, n)(u[-n - 1 : -1])
        found[-1] = found[:, -1] = [u[start : start + n] @ filtered for start in range(lags)]
        kernel = covariance[:n]
        entering, leaving = u[: lags - 1], u[n : n + lags - 1]
        after = np.array([kernel @ u[start : start + len(kernel)] for start in range(lags - 1)])
        before = np.array([kernel @ u[n + start - len(kernel) + 1 : n + start + 1][::-1] for start in range(lags - 1)])
        change = _both(entering, after, kernel[0]) - _both(leaving, before, kernel[0])
        for start in range(lags - 2, -1, -1):
            found[start, :-1] = found[start + 1, 1:] + change[start]
        result += found[::-1, ::-1]
    return 0.5 * (result + result.T)


def _both(ends: Floats, sums: Floats, variance: float) -> Floats:
    """Products of the samples at one end of all columns with the columns, that of both ends counted once."""
    one = np.outer(ends, sums)
    return one + one.T - variance * np.outer(ends, ends)


def _colouring(covariance: Floats, n: int) -> Callable[[Floats], Floats]:
    """Return the multiplication of n values by the covariance matrix of residuals."""
    reach = min(len(covariance), n)
    size = scipy.fft.next_fast_len(n + reach)
    kernel = np.zeros(size)
    kernel[:reach] = covariance[:reach]
    kernel[size - reach + 1 :] = covariance[reach - 1 : 0 : -1]
    spectrum = scipy.fft.rfft(kernel)
    return lambda values: np.asarray(scipy.fft.irfft(scipy.fft.rfft(values, size) * spectrum, size)[:n])
