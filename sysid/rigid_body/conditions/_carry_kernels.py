"""Kalman filter over states that decay by themselves, with three measurements a step taken one after the other."""

from __future__ import annotations

from math import log

import numpy as np

from core.compiled import njit
from core.kernel_types import Matrix, Stack, Vector


@njit(cache=True, nogil=True)
def carry(
    decay: Vector,
    driven: Vector,
    design: Stack,
    measured: Matrix,
    noise: Vector,
    gate: float,
    memory: float,
    mean: Vector,
    covariance: Matrix,
    means: Matrix,
    covariances: Stack,
) -> float:
    """Filter, and return the log-likelihood of the measurements (without its constant).

    A step multiplies states by `decay` and adds the variance `driven`, (n,); `design` (K, 3, n), `measured` (K, 3) and
    the variances `noise` (3,) are of the measurements; `means` (K + 1, n) and `covariances` (K + 1, n, n) receive the
    state before the first step and after each.
    """
    n = len(mean)
    x, p = mean.copy(), covariance.copy()
    ph, gain = np.empty(n), np.empty(n)
    likelihood = 0.0
    louder = np.ones(3)
    for i in range(n):
        means[0, i] = x[i]
        for j in range(n):
            covariances[0, i, j] = p[i, j]
    for k in range(len(measured)):
        for i in range(n):
            x[i] *= decay[i]
            for j in range(n):
                p[i, j] *= decay[i] * decay[j]
            p[i, i] += driven[i]
        for a in range(3):
            innovation, variance = measured[k, a], noise[a] * max(louder[a], 1.0)
            for i in range(n):
                ph[i] = 0.0
                for j in range(n):
                    ph[i] += p[i, j] * design[k, a, j]
                innovation -= design[k, a, i] * x[i]
            known = 0.0
            for i in range(n):
                known += design[k, a, i] * ph[i]
            variance += known
            unexpected = min(innovation * innovation, gate * gate * variance) - known
            louder[a] += (unexpected / noise[a] - louder[a]) / memory
            least = innovation * innovation / (gate * gate)
            # The likelihood is that of Huber's density: quadratic within the gate, straight beyond it.
            if least > variance:
                ratio = (least / variance) ** 0.5
                likelihood -= 0.5 * log(variance) + gate * gate * (ratio - 0.5)
                variance = least
            else:
                likelihood -= 0.5 * (log(variance) + innovation * innovation / variance)
            for i in range(n):
                gain[i] = ph[i] / variance
                x[i] += gain[i] * innovation
            for i in range(n):
                for j in range(n):
                    p[i, j] += gain[i] * gain[j] * variance - gain[i] * ph[j] - ph[i] * gain[j]
        for i in range(n):
            means[k + 1, i] = x[i]
            for j in range(n):
                covariances[k + 1, i, j] = p[i, j]
    return likelihood
