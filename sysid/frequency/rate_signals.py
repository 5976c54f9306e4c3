"""What the rate controllers of a log say, and that of the height: outputs, measurements and targets, as rows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from logparse import FlightLog
from logparse.craft.log_settings import Need, bit_to_set
from logparse.tables import COLUMNS
from sysid.frequency.axes import FrequencyError
from sysid.frequency.excitation import Within
from sysid.frequency.records import Logged, on_uniform_clock
from sysid.frequency.response import Floats

#: Time [s] before and after what is needed of the rate controllers that tells of air and battery there.
_AROUND = 30.0


@dataclass(frozen=True, eq=False)
class RateSignals:
    """What the rate controllers of a log said: their outputs, what they measured and what they wanted."""

    t: Floats  #: shape (N,): Times of validity (of the gyro sample), s.
    columns: dict[str, Logged]  #: dict of str to ndarray, shape (N,): By name, as in `Axis`.
    with_chirp: bool  #: Whether the outputs contain a chirp added at the mixer; RATE's do, sums of PID terms do not.
    source: str = ""  #: What they are, where they are not the controllers' own.

    @cached_property
    def step(self) -> float:
        """Return the usual step, s."""
        return float(np.median(np.diff(self.t)))

    def within(self, start: float, stop: float) -> slice:
        """Return which rows lie within a stretch of time."""
        return slice(np.searchsorted(self.t, start), np.searchsorted(self.t, stop, side="right"))

    def evenly(
        self, names: Sequence[str], start: float, stop: float, *further: Callable[[Floats], Floats]
    ) -> tuple[Floats, Logged, NDArray[np.bool_]]:
        """Bring columns of a stretch, and functions of time beside them, to an even clock, as `on_uniform_clock` does.

        In the precision in which they are logged.
        """
        rows = self.within(start, stop)
        t, values, usable = on_uniform_clock(self.t[rows], [self.columns[name][rows] for name in names])
        values = np.column_stack([values, *(at(t) for at in further)])
        return t, values.astype(self.columns[names[0]].dtype, copy=False), usable


def rate_signals(log: FlightLog, within: Within | None = None) -> RateSignals:
    """Read the rate controllers of a log: RATE, or the PID messages where it has none."""
    t = log.tables.times("rates")
    if t is None or len(t) < 16:
        raise FrequencyError(
            f"{log.path.name}: no RATE or PID messages; {bit_to_set(Need.FAST_RATES, log)}, "
            "and fly one minute of short stick inputs on each axis"
        )
    rows = slice(None)
    if within is not None:
        rows = slice(*np.searchsorted(t, (within[0] - _AROUND, within[1] + _AROUND)))
    columns = log.tables.columns("rates", tuple(COLUMNS["rates"]))
    # In single precision, as the fast loop is logged: all in double are the largest thing in memory.
    known = {str(each.name): each.to_numpy()[rows].astype(np.float32) for each in columns}
    log.tables.release(keep="imu")  # what the columns were made of is as large as they are
    told = {name: values for name, values in known.items() if np.isfinite(values).any()}
    return RateSignals(t[rows], told, "RATE" in log.messages)
