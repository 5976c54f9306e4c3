"""Whitening by a Kalman filter: what of a velocity could not be foreseen when gusts push as a Gauss-Markov process."""

from __future__ import annotations

from math import exp, log, sqrt

import numpy as np

from core.compiled import njit
from core.kernel_types import Matrix

#: Variance of what is not known of the first velocity, (m/s)^2.
_FIRST = 1e4


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
    p_vv, p_va, p_aa = _FIRST, 0.0, variance
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
