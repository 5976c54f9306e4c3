"""One output of several records as a separable least-squares problem; denominators are stable by construction.

A denominator is a product of sections with logarithms as parameters. A second-order section is
``s^2 + 2 zeta w s + w^2`` with parameters ``(ln w, ln zeta)``, real poles included (zeta > 1); an odd order has one
first-order section ``s + w`` with parameter ``ln w``, last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from sysid.records.experiment import Floats
from sysid.transfer_functions._kernels import multiply_out

#: Damping ratios that a fit may use. Below, a mode loses nothing in any flight; fits to flights come down to 0.0003
#: (Elhesasy 2024, table A1, motor 7 to x), and a mode held at 0.005 instead leaves a third more than the noise.
DAMPING = (1e-4, 20.0)


@dataclass(frozen=True, slots=True)
class Band:
    """Frequencies that records of this length and rate can tell anything about, rad/s."""

    lowest: float
    highest: float


def resolvable_band(duration: float, dt: float) -> Band:
    """Return the band of poles for the longest record, from a tenth of its inverse length to the Nyquist frequency.

    A pole slower than that cannot be told from an integrator; one faster not from a gain.
    """
    return Band(0.1 / duration, np.pi / dt)


def clip(theta: Floats, band: Band, orders: Sequence[int] = ()) -> Floats:
    """Clip parameters, shape (groups, n), to the band and the range of damping."""
    lower, upper = _bounds(band, theta.shape[1], tuple(orders) or (theta.shape[1],))
    return np.asarray(np.minimum(np.maximum(theta, lower), upper))


@lru_cache(maxsize=64)
def _bounds(band: Band, n: int, orders: tuple[int, ...]) -> tuple[Floats, Floats]:
    """Return the least and the largest parameters, shape (groups, n); of one group when all are of one order."""
    lower, upper = np.full((len(orders), n), np.log(band.lowest)), np.full((len(orders), n), np.log(band.highest))
    for g, order in enumerate(orders):
        damping = np.arange(1, order - order % 2, 2)
        lower[g, damping], upper[g, damping] = np.log(DAMPING[0]), np.log(DAMPING[1])
    return lower, upper


def from_poles(poles: NDArray[np.complex128]) -> Floats:
    """Return the parameters of a denominator with these poles, shape (n,); unstable ones are reflected.

    Pairs are made of neighbours, so that real poles make well-conditioned sections too.
    """
    poles = -np.abs(poles.real) + 1j * poles.imag
    size = np.maximum(np.abs(poles), 1e-12)
    pairs = np.sort_complex(poles[poles.imag > 1e-9 * size])
    real = np.sort(size[np.abs(poles.imag) <= 1e-9 * size])
    # A single real pole, where there must be one, is the slowest.
    single, real = (real[:1], real[1:]) if len(real) % 2 else (real[:0], real)
    w = np.concatenate([np.abs(pairs), np.sqrt(real[::2] * real[1::2])])
    damping = np.concatenate([-pairs.real / np.abs(pairs), 0.5 * (real[::2] + real[1::2]) / w[len(pairs) :]])
    order = np.argsort(w)
    sections = np.column_stack([np.log(w), np.log(np.maximum(damping, 1e-12))])[order]
    return np.concatenate([sections.ravel(), np.log(single)])


def take(theta: Floats, order: int) -> Floats:
    """Keep the slowest sections of one denominator, shape (n,), as one of lower order."""
    n = len(theta)
    sections = theta[: n - n % 2].reshape(-1, 2)
    sections = sections[np.argsort(sections[:, 0])]
    single = theta[-1:] if n % 2 else sections[-1, :1]
    if order % 2 and len(sections) > order // 2 and not n % 2:
        single = sections[order // 2, :1]
    return np.concatenate([sections[: order // 2].ravel(), single[: order % 2]])


def denominators(theta: Floats, orders: Sequence[int] = ()) -> tuple[Floats, Floats]:
    """Multiply sections (groups, n) out: a, ascending without the leading 1, and ``d a / d theta`` (groups, n, n).

    Beyond the order of a denominator, where they differ, parameters are idle and results zero.
    """
    groups, n = theta.shape
    return multiply_out(np.ascontiguousarray(theta), np.array(orders or (n,) * groups, np.int64))


@dataclass(frozen=True, slots=True, kw_only=True)
class FitProblem:
    """One output of several records, in normalised units."""

    #: tuple of ndarray, shape (N_r, m): About their trim, each of unit variance over all records.
    inputs: tuple[Floats, ...]
    outputs: tuple[Floats, ...]  #: tuple of ndarray, shape (N_r,): About their trim, of unit variance over all records.
    group: tuple[int, ...]  #: shape (m,): Which denominator each input passes.
    orders: tuple[int, ...]  #: shape (groups,): Poles of each denominator, integrators included.
    counts: tuple[int, ...]  #: shape (m,): Coefficients of each numerator, zeros + 1.
    dt: float  #: s.
    hold: str  #: {"zoh", "foh"}
    band: Band  #: Where poles may lie.
    ridge: float  #: Weight of the numerators' impulse-response energy relative to the information in the data.
    #: Variance of the residual over the energy [s] that the response to an initial state is expected to have.
    initial: float
    integrators: int = 0  #: How many poles of every denominator are fixed at zero.
    #: shape (m,): Of each input, s; empty for none. Where a descent starts when they are estimated.
    delays: tuple[float, ...] = ()
    longest_delay: float = 0.0  #: Delays are estimated from 0 to this, s; 0 takes them as given.

    @property
    def groups(self) -> int:
        """Number of denominators."""
        return len(self.orders)

    @property
    def samples(self) -> int:
        """Samples of all records together."""
        return sum(self.lengths)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Samples of each record."""
        return tuple(map(len, self.outputs))

    @property
    def order(self) -> int:
        """Most poles of a denominator."""
        return max(self.orders)

    @property
    def numerators(self) -> int:
        """Most coefficients of a numerator."""
        return max(self.counts)

    @property
    def lags(self) -> int:
        """Most parameters of a denominator."""
        return self.order - self.integrators

    @property
    def lag_orders(self) -> tuple[int, ...]:
        """Parameters of each denominator: poles that are not integrators."""
        return tuple(order - self.integrators for order in self.orders)

    @property
    def used(self) -> Floats:
        """1 for the coefficients that numerators have, 0 for those above their count; shape (numerators, m)."""
        return _used(self.counts)

    @property
    def start_delays(self) -> Floats:
        """Delays of the inputs, s, shape (m,)."""
        return np.array(self.delays or (0.0,) * len(self.group))

    @property
    def delay_parameters(self) -> int:
        """How many delays are estimated: those of all inputs, or none."""
        return len(self.group) if self.longest_delay > 0.0 else 0


@lru_cache(maxsize=64)
def _used(counts: tuple[int, ...]) -> Floats:
    used = (np.arange(max(counts))[:, None] < np.array(counts)).astype(np.float64)
    used.setflags(write=False)
    return used
