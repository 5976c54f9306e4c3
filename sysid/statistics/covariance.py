"""Uncertainty of estimates whose residuals are coloured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby, islice

import numpy as np
import scipy

from sysid.records.experiment import Floats
from sysid.records.filtering import lfilter

#: Powers of the time over which values are averaged, with which the Allan variance of each kind of noise goes.
_KINDS = np.array([-1.0, 0.0, 1.0, 2.0])

#: Values whose spectra are taken together: they stay in the processor's cache.
AT_ONCE = 1 << 15


def autocovariance(residuals: Sequence[Floats], lags: int) -> Floats:
    """Estimate the autocovariance over several records, tapered (Bartlett) so that it stays positive semidefinite.

    `residuals` (N_r,). Returns (lags,).
    """
    total, result = 0, np.zeros(lags)
    for n, alike in groupby(residuals, key=len):
        together = np.stack(list(alike))
        size = scipy.fft.next_fast_len(n + lags)
        spectra = scipy.fft.rfft(together, size)
        product = scipy.fft.irfft(np.sum(np.abs(spectra) ** 2, axis=0), size)
        reach = min(lags, n)
        result[:reach] += product[:reach]
        total += together.size
    return np.asarray(result / total * (1.0 - np.arange(lags) / lags))


def long_run_variance(values: Floats, reach: float) -> float:
    """Return the variance of the mean of values correlated over `reach` samples, times their number, shape (N,).

    With Bartlett weights (Newey and West 1987). The few lags need no transform, which takes longer to import than a log
    to read.
    """
    n, lags = len(values), int(max(min(len(values) // 4, np.ceil(reach)), 1))
    products = np.array([values[lag:] @ values[: n - lag] for lag in range(lags)])
    covariance = products / n * (1.0 - np.arange(lags) / lags)
    return float(max(2.0 * covariance.sum() - covariance[0], 0.2 * covariance[0], 1e-12))


def wander(values: Floats) -> float:
    """Return the standard error of the mean of values that may go on wandering as they do, shape (N,).

    As of an inertial sensor (IEEE 952): white noise, flicker, random walk and ramp by the Allan variance of averages
    over 1, 2, 4, ... values, taken on to averages over all. Scatter alone would have it that a slow drift averages.
    """
    if not np.any(values):
        return 0.0
    known = np.concatenate([[0.0], np.cumsum(values)])
    lengths = 2 ** np.arange(int(np.log2(max(len(values) // 2, 1))) + 1)
    means = [(known[length:] - known[:-length]) / length for length in lengths]
    apart = [0.5 * float(np.mean((length[n:] - length[:-n]) ** 2)) for length, n in zip(means, lengths, strict=True)]
    allan = np.maximum(apart, 1e-12 * max(apart))
    kinds = lengths[:, None] ** _KINDS
    weight, sizes = np.sqrt(np.maximum(len(values) // lengths - 1, 1)), np.zeros(len(_KINDS))
    model = allan
    for _ in range(6):  # an Allan variance errs by a part of itself
        sizes, _ = scipy.optimize.nnls(kinds * (weight / model)[:, None], allan * weight / model)
        model = kinds @ sizes
    return float(np.sqrt(sizes @ float(len(values)) ** _KINDS))


def residual_colour(residuals: Sequence[Floats]) -> Floats:
    """Estimate the autocovariance of residuals by an autoregressive model whose order Akaike's criterion chooses.

    A fit takes out of its residuals just what resembles its regressors. A sample autocovariance over many lags shows
    that hole in the spectrum and promises errors that are too small, worst for models that integrate; a model of the
    few orders that white or wind-blown residuals need passes over it (den Haan and Levin 1997).
    """
    lengths = tuple(map(len, residuals))
    samples, longest = sum(lengths), max(lengths)
    highest = int(min(round(10.0 * np.log10(samples)), min(lengths) // 4))
    products = [[residual[k:] @ residual[: len(residual) - k] for k in range(highest + 1)] for residual in residuals]
    gamma: Floats = np.sum(products, axis=0) / samples
    if gamma[0] <= 0.0:
        return gamma[:1]
    # Levinson's recursion gives the models of all orders.
    a, variance = np.zeros(0), float(gamma[0])
    best = (samples * np.log(variance), a)
    for order in range(1, highest + 1):
        reflection = -(gamma[order] + a @ gamma[order - 1 : 0 : -1]) / variance
        a = np.concatenate([a + reflection * a[::-1], [reflection]])
        variance *= 1.0 - reflection**2
        if variance <= 1e-12 * gamma[0]:
            break
        best = min(best, (samples * np.log(variance) + 2.0 * order, a), key=lambda one: one[0])
    a = best[1]
    order = len(a)
    if order == 0:
        return gamma[:1]
    # Beyond its order the model's autocovariance follows its own difference equation.
    past = [-sum(a[i] * gamma[order + j - i] for i in range(j, order)) for j in range(order)]
    following = lfilter([1.0], np.concatenate([[1.0], a]), np.zeros(longest), np.array(past))
    whole = np.concatenate([gamma[: order + 1], following])[:longest]
    lasting = np.flatnonzero(np.abs(whole) > 1e-4 * gamma[0])
    return np.asarray(whole[: lasting[-1] + 1])


def independent_samples(residuals: Sequence[Floats]) -> float:
    """Count the independent samples that coloured residuals are worth: N over the sum of squared autocorrelations."""
    correlation = autocovariance(residuals, max(min(map(len, residuals)) // 2, 1))
    if not correlation[0] > 0.0:
        return float(sum(map(len, residuals)))
    correlation = correlation / correlation[0]
    return float(sum(map(len, residuals)) / (1.0 + 2.0 * np.sum(correlation[1:] ** 2)))


def coloured_information(regressors: Sequence[Floats], covariance: Floats) -> Floats:
    """Covariance of ``sum_t psi(t) e(t)`` for residuals e of a given autocovariance.

    `regressors` (N_r, q): psi, one array per record; records are independent; `covariance` (lags,). Returns (q, q).
    """
    q = regressors[0].shape[1]
    result = np.zeros((q, q))
    for n, alike in groupby(regressors, key=len):
        coloured = _colouring(covariance, n)
        # Short records many at a time, long ones by one regressor: their spectra would be the largest thing in memory.
        many, few = max(AT_ONCE // (n * q), 1), min(max(AT_ONCE // n, 1), q)
        while together := list(islice(alike, many)):
            psi = np.concatenate(together)
            for k in range(0, q, few):
                shaped = psi[:, k : k + few].reshape(len(together), n, -1)
                result[:, k : k + few] += psi.T @ coloured(shaped).reshape(psi[:, k : k + few].shape)
    return 0.5 * (result + result.T)


def lagged_information(signals: Sequence[Floats], lags: int, covariance: Floats) -> Floats:
    """Covariance of ``sum_t u(t - j) e(t)`` over lags j = 1 ... `lags`, for residuals e of a given autocovariance.

    As `coloured_information` of the lagged signals beside each other, which would take `lags` times the memory: two
    columns one lag further on differ by what comes in at one end and goes out at the other.

    `signals` (N_r,): u, one array per record, of more than `lags` samples; residuals start at the sample `lags`;
    `covariance` (reach,). Returns (lags, lags).
    """
    result = np.zeros((lags, lags))
    for u in signals:
        n = len(u) - lags
        # By the sample at which a column starts, from 0 (the longest lag) to lags - 1 (one sample).
        products = np.zeros((lags, lags))
        filtered = _colouring(covariance, n)(u[-n - 1 : -1, None])[:, 0]
        products[-1] = products[:, -1] = [u[start : start + n] @ filtered for start in range(lags)]
        kernel = covariance[:n]
        entering, leaving = u[: lags - 1], u[n : n + lags - 1]
        after = np.array([kernel @ u[start : start + len(kernel)] for start in range(lags - 1)])
        before = np.array([kernel @ u[n + start - len(kernel) + 1 : n + start + 1][::-1] for start in range(lags - 1)])
        change = _both(entering, after, kernel[0]) - _both(leaving, before, kernel[0])
        for start in range(lags - 2, -1, -1):
            products[start, :-1] = products[start + 1, 1:] + change[start]
        result += products[::-1, ::-1]
    return 0.5 * (result + result.T)


def _both(ends: Floats, sums: Floats, variance: float) -> Floats:
    """Products of the samples at one end of all columns with the columns, that of both ends counted once."""
    one = np.outer(ends, sums)
    return one + one.T - variance * np.outer(ends, ends)


def _colouring(covariance: Floats, n: int) -> Callable[[Floats], Floats]:
    """Return the multiplication of n values, along the axis before the last, by the covariance matrix of residuals."""
    reach = min(len(covariance), n)
    size = scipy.fft.next_fast_len(n + reach)
    kernel = np.zeros(size)
    kernel[:reach] = covariance[:reach]
    kernel[size - reach + 1 :] = covariance[reach - 1 : 0 : -1]
    spectrum = scipy.fft.rfft(kernel)[:, None]

    def coloured(values: Floats) -> Floats:
        spectra = scipy.fft.rfft(values, size, axis=-2)
        spectra *= spectrum
        return np.asarray(scipy.fft.irfft(spectra, size, axis=-2)[..., :n, :])

    return coloured
