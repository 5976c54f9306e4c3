"""Denominators that are stable by construction: products of sections with logarithms as parameters.

A second-order section is ``s^2 + 2 zeta w s + w^2`` with parameters ``(ln w, ln zeta)``, real poles included
(zeta > 1); an odd order has one first-order section ``s + w`` with parameter ``ln w``, last.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.experiment import Floats

#: Damping ratios that a fit may use; below, a mode rings for the whole of any flight.
DAMPING = (0.005, 20.0)


@dataclass(frozen=True, slots=True)
class Band:
    """Frequencies that records of this length and rate can tell anything about, rad/s."""

    lowest: float
    highest: float


def resolvable_band(duration: float, dt: float) -> Band:
    """Give the band of poles for the longest record, from a tenth of its inverse length to the Nyquist frequency.

    A pole slower than that cannot be told from an integrator; one faster not from a gain.
    """
    return Band(0.1 / duration, np.pi / dt)


def clip(theta: Floats, band: Band) -> Floats:
    """Bring parameters, shape (groups, n), into the band and the range of damping."""
    n = theta.shape[1]
    lower, upper = np.full(n, np.log(band.lowest)), np.full(n, np.log(band.highest))
    damping = np.arange(1, n - n % 2, 2)
    lower[damping], upper[damping] = np.log(DAMPING[0]), np.log(DAMPING[1])
    return np.clip(theta, lower, upper)


def denominators(theta: Floats) -> tuple[Floats, Floats]:
    """Multiply the sections out.

    Parameters
    ----------
    theta : ndarray, shape (groups, n)

    Returns
    -------
    a : ndarray, shape (groups, n)
        Ascending powers of s without the leading 1.
    slope : ndarray, shape (groups, n, n)
        ``d a[g, k] / d theta[g, i]`` at ``[g, k, i]``.
    """
    groups, n = theta.shape
    factors: list[Floats] = []
    derivatives: list[tuple[Floats, ...]] = []
    one, none = np.ones(groups), np.zeros(groups)
    for i in range(0, n - 1, 2):
        w, damping = np.exp(theta[:, i]), 2.0 * np.exp(theta[:, i] + theta[:, i + 1])
        factors.append(np.array([w * w, damping, one]))
        derivatives.append((np.array([2.0 * w * w, damping]), np.array([none, damping])))
    if n % 2:
        w = np.exp(theta[:, n - 1])
        factors.append(np.array([w, one]))
        derivatives.append((np.array([w]),))
    slope = np.zeros((n, n, groups))
    column = 0
    for which, own in enumerate(derivatives):
        rest = np.ones((1, groups))
        for other, factor in enumerate(factors):
            if other != which:
                rest = _multiply(rest, factor)
        for derivative in own:
            product = _multiply(rest, derivative)
            slope[: len(product), column] = product
            column += 1
    whole = np.ones((1, groups))
    for factor in factors:
        whole = _multiply(whole, factor)
    return np.ascontiguousarray(whole[:n].T), np.ascontiguousarray(slope.transpose(2, 0, 1))


def _multiply(first: Floats, second: Floats) -> Floats:
    """Multiply polynomials of many groups at once; shape (powers, groups), ascending."""
    product = np.zeros((len(first) + len(second) - 1, first.shape[1]))
    for power, coefficients in enumerate(second):
        product[power : power + len(first)] += coefficients * first
    return product
