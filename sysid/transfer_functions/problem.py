"""One output of several records, posed as a separable least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from sysid.records.experiment import Experiment, Floats
from sysid.transfer_functions.sections import Band


@dataclass(frozen=True, slots=True, kw_only=True)
class Problem:
    """One output of several records, in normalised units."""

    #: tuple of ndarray, shape (N_r, m): About their trim, each of unit variance over all records.
    inputs: tuple[Floats, ...]
    outputs: tuple[Floats, ...]  #: tuple of ndarray, shape (N_r,): About their trim, of unit variance over all records.
    group: tuple[int, ...]  #: shape (m,): Which denominator each input passes.
    order: int  #: Poles of each denominator, integrators included; the most where `orders` differ.
    numerators: int  #: Coefficients of each numerator, zeros + 1; the most where `counts` differ.
    dt: float  #: s.
    hold: str  #: {"zoh", "foh"}
    band: Band  #: Where poles may lie.
    ridge: float  #: Weight of the numerators' impulse-response energy relative to the information in the data.
    #: Variance of the residual over the energy [s] that the response to an initial state is expected to have.
    initial: float
    integrators: int = 0  #: How many poles of every denominator are fixed at zero.
    orders: tuple[int, ...] = ()  #: shape (groups,): Poles of each denominator; empty when all have `order`.
    counts: tuple[int, ...] = ()  #: shape (m,): Coefficients of each numerator; empty when all have `numerators`.
    #: shape (m,): Of each input, s; empty for none. Where a descent starts when they are estimated.
    delays: tuple[float, ...] = ()
    longest_delay: float = 0.0  #: Delays are estimated from 0 to this, s; 0 takes them as given.

    @property
    def groups(self) -> int:
        """Number of denominators."""
        return max(self.group) + 1

    @property
    def samples(self) -> int:
        """Samples of all records together."""
        return sum(self.lengths)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Samples of each record."""
        return tuple(map(len, self.outputs))

    @property
    def lags(self) -> int:
        """Parameters of each denominator: poles that are not integrators."""
        return self.order - self.integrators

    @property
    def all_orders(self) -> tuple[int, ...]:
        """Poles of each denominator."""
        return self.orders or (self.order,) * self.groups

    @property
    def used(self) -> Floats:
        """1 for the coefficients that numerators have, 0 for those above their count; shape (numerators, m)."""
        return _used(self.numerators, self.counts or (self.numerators,) * len(self.group))

    @property
    def start_delays(self) -> Floats:
        """Delays of the inputs, s, shape (m,)."""
        return np.array(self.delays or (0.0,) * len(self.group))

    @property
    def delay_parameters(self) -> int:
        """How many delays are estimated: those of all inputs, or none."""
        return len(self.group) if self.longest_delay > 0.0 else 0


@lru_cache(maxsize=64)
def _used(numerators: int, counts: tuple[int, ...]) -> Floats:
    used = (np.arange(numerators)[:, None] < np.array(counts)).astype(np.float64)
    used.setflags(write=False)
    return used


@dataclass(frozen=True, slots=True)
class Cut:
    """Which columns of a record a problem is about, and the units in which it has them."""

    column: int  #: Of the outputs.
    active: tuple[int, ...]  #: Columns of the inputs.
    input_scale: Floats  #: shape (m,)
    output_scale: float

    def inputs(self, record: Experiment) -> Floats:
        """Return inputs about their trim, scaled."""
        return np.ascontiguousarray((record.u - record.input_trim)[:, list(self.active)] / self.input_scale)

    def output(self, record: Experiment) -> Floats:
        """Return the output about its trim, scaled."""
        return np.asarray((record.y[:, self.column] - record.output_trim[self.column]) / self.output_scale)
