"""Ratios of polynomials with a delay: what a fitted structure amounts to."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy

from sysid.frequency.response import Complex, Floats


@dataclass(frozen=True, slots=True, eq=False)
class StateSpace:
    """``dx/dt = A x + B u(t - delay)``, ``y = C x + D u(t - delay)``; controller canonical form."""

    A: Floats
    B: Floats
    C: Floats
    D: Floats
    delay: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RationalModel:
    """``G(s) = exp(-delay s) num(s) / den(s)``, without the filter of the measurement."""

    #: Highest power first; `den` is monic.
    num: Floats
    den: Floats
    delay: float  #: s.
    covariance: Floats = field(repr=False)  #: Of ``(num, den without its leading 1, delay)``.
    cost: float  #: J of the response that it was fitted to.

    @property
    def poles(self) -> Complex:
        """Return the poles, rad/s, slowest first."""
        return _roots(self.den)

    @property
    def zeros(self) -> Complex:
        """Return the zeros, rad/s, slowest first."""
        return _roots(self.num)

    @property
    def pole_covariance(self) -> tuple[Floats, ...]:
        """Return the covariance of real and imaginary part of each pole, (rad/s)^2, shape (2, 2)."""
        first, derivative = len(self.num), np.polyder(self.den)
        free = len(self.den) - 1
        inner = self.covariance[first : first + free, first : first + free]
        found = []
        for pole in self.poles:
            slope = -(pole ** np.arange(free - 1, -1, -1)) / np.polyval(derivative, pole)
            parts = np.vstack([slope.real, slope.imag])
            found.append(np.asarray(parts @ inner @ parts.T, dtype=np.float64))
        return tuple(found)

    @property
    def state_space(self) -> StateSpace:
        """Return the matrices of a state-space form."""
        a, b, c, d = scipy.signal.tf2ss(self.num, self.den)
        return StateSpace(np.asarray(a), np.asarray(b), np.asarray(c), np.asarray(d), self.delay)


def _roots(polynomial: Floats) -> Complex:
    roots = np.roots(polynomial).astype(np.complex128)
    return np.asarray(sorted(roots, key=lambda root: (abs(root), root.imag)), dtype=np.complex128)
