"""Kalman filters, compiled: over states that decay by themselves, and over gusts that push a velocity."""

from __future__ import annotations

from math import exp, log, sqrt

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
    """Filter three measurements a step, one after the other; return their log-likelihood (without its constant).

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


@njit(cache=True, nogil=True)
def whiten(columns: Matrix, dt: float, gust: float, tau: float, jolt: float, noise: float, out: Matrix) -> float:
    """Turn velocities into their innovations over standard deviations.

    The state is the velocity and the acceleration by gusts: ``v' = a + white noise``, ``a' = -a / tau + white noise``.
    The filter is linear, so that a residual and its derivatives are whitened alike (Maine and Iliff 1985, ch. 5).

    Shapes: `columns` (n, m); `out` (n, m).
    """
    n, m = columns.shape
    phi = exp(-dt / tau)
    reach = tau * (1.0 - phi)
    variance = gust * gust
    q_aa = variance * (1.0 - phi * phi)
    q_va = variance * tau * (1.0 - phi) * (1.0 - phi)
    q_vv = 2.0 * variance * tau * (dt - 2.0 * reach + 0.5 * tau * (1.0 - phi * phi)) + jolt * jolt * dt
    p_vv, p_va, p_aa = 1e4, 0.0, variance  # nothing is known of the first velocity
    r = noise * noise
    v, a = np.zeros(m), np.zeros(m)
    total = 0.0
    for k in range(n):
        s = p_vv + r
        root = sqrt(s)
        gain_v, gain_a = p_vv / s, p_va / s
        if k > 0:
            total += log(root)
        for j in range(m):
            innovation = columns[k, j] - v[j]
            # The first velocity is not known beforehand, and tells nothing.
            out[k, j] = innovation / root if k > 0 else 0.0
            new_v, new_a = v[j] + gain_v * innovation, a[j] + gain_a * innovation
            v[j] = new_v + reach * new_a
            a[j] = phi * new_a
        p_aa = p_aa - gain_a * p_va
        p_va = p_va * (1.0 - gain_v)
        p_vv = p_vv * (1.0 - gain_v)
        n_vv = p_vv + 2.0 * reach * p_va + reach * reach * p_aa + q_vv
        n_va = phi * (p_va + reach * p_aa) + q_va
        p_aa = phi * phi * p_aa + q_aa
        p_vv, p_va = n_vv, n_va
    return total
