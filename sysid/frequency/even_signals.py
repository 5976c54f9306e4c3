"""Signals of the rate controllers on an even clock, to which each is brought once for all axes and their checks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.frequency.rate_signals import RateSignals
from sysid.frequency.records import EvenClock, Logged, on_uniform_clock
from sysid.frequency.response import Floats

#: Times, signals and which of them count, as `on_uniform_clock` returns them.
OnClock = tuple[Floats, Logged, NDArray[np.bool_]]

#: Signals that are not among the rows, by name: from times [s] to values at them.
Further = Mapping[str, Callable[[Floats], Floats]]


class EvenSignals:
    """Signals over one stretch of a log on an even clock, brought there when they are first asked for.

    They are kept in the precision in which they are logged.

    Parameters
    ----------
    signals : RateSignals
    start, stop : float
        s.
    """

    def __init__(self, signals: RateSignals, start: float, stop: float) -> None:
        self._signals = signals
        self._rows = rows_within(signals, start, stop)
        self._clock = EvenClock.of(signals.t[self._rows])
        self._columns: dict[str, Logged] = {}

    def between(self, names: Sequence[str], further: Further, start: float, stop: float) -> OnClock | None:
        """Return signals of a part of the stretch.

        Returns
        -------
        clock, values, usable : ndarray, shape (N,), (N, len(names) + len(further)) and (N,)
            As `on_uniform_clock` returns them; None beyond the stretch, and where a row of them is no number.
        """
        t, rounded = self._clock.t, 1e-3 * self._clock.step
        if start < self._clock.rows[0] - self._clock.step or stop > self._clock.rows[-1] + self._clock.step:
            return None
        known = {name: self._signals.columns[name][self._rows] for name in names if name not in self._columns}
        if not all(np.isfinite(column).all() for column in known.values()):
            return None
        if known:
            brought = self._clock.bring(np.column_stack(list(known.values())).astype(np.float64, copy=False))
            columns = zip(known.items(), brought.T, strict=True)
            self._columns |= {name: values.astype(logged.dtype) for (name, logged), values in columns}
        self._columns |= {name: at(t).astype(np.float32) for name, at in further.items() if name not in self._columns}
        part = slice(*np.searchsorted(t, (start - rounded, stop + rounded)))
        values = np.column_stack([self._columns[name][part] for name in (*names, *further)])
        return t[part], values, self._clock.usable[part]


def rows_within(signals: RateSignals, start: float, stop: float) -> slice:
    """Return which rows of signals lie within a stretch of time."""
    return slice(np.searchsorted(signals.t, start), np.searchsorted(signals.t, stop, side="right"))


def brought_evenly(signals: RateSignals, names: Sequence[str], further: Further, start: float, stop: float) -> OnClock:
    """Bring signals of a stretch of time to an even clock of its own.

    Returns
    -------
    clock, values, usable : ndarray, shape (N,), (N, len(names) + len(further)) and (N,)
        As `on_uniform_clock` returns them.
    """
    rows = rows_within(signals, start, stop)
    t, values, usable = on_uniform_clock(signals.t[rows], [signals.columns[name][rows] for name in names])
    return t, np.column_stack([values, *(at(t) for at in further.values())]), usable
