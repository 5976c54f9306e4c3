"""Stretches of a flight in which an axis was excited by a chirp of SYSTEMID mode, and the chirp itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray

from logparse import FlightLog
from logparse.tables import between
from sysid.frequency.axes import SID_AXES
from sysid.frequency.response import Floats

#: From when to when on the boot clock a log counts, s.
Within = tuple[float, float]

#: Pause [s] in SIDD that ends a run even when its clock goes on.
_PAUSE = 2.0

#: Cycles of its lowest frequency that a chirp must last to be of use, and of any frequency that is looked at.
_SHORTEST, _LEAST_CYCLES = 2.0, 3.0

#: Time [s] before a chirp that is its own, and in which a craft settles after it, or after take-off.
_BEFORE, _SETTLES = 0.5, 2.0

#: Order of the spline through the rows of a chirp, and the fewest that it takes.
_ORDER = 13
FEWEST_ROWS = 4 * _ORDER


@dataclass(frozen=True, slots=True, eq=False)
class Chirp:
    """One run of SYSTEMID mode."""

    axis: str  #: Axis of the craft that it excites; empty for a SID_AXIS that nobody knows.
    sid_axis: int  #: As SID_AXIS numbers it; 0 where the log does not tell.
    #: s on the boot clock.
    start: float
    stop: float
    #: Frequencies that were swept, Hz.
    low: float
    high: float
    at_mixer: bool  #: Whether the chirp was added after the controller (SID_AXIS 10-13).
    complete: bool  #: Whether it ran as long as SIDS announced.
    rows: pd.DataFrame = field(repr=False)  #: Those of `Tables.systemid` within it.
    _splines: dict[str, Callable[[Floats], Floats] | None] = field(init=False, repr=False, default_factory=dict)

    @property
    def duration(self) -> float:
        """Return the length, s."""
        return self.stop - self.start

    @property
    def worthwhile(self) -> bool:
        """Return whether it lasted two cycles of its lowest frequency, and swept a band in which dynamics show."""
        long_enough = self.high > 0.0 and self.duration * max(self.low, 1e-3) >= _SHORTEST
        return long_enough and self.high > 1.7 * max(self.low, _LEAST_CYCLES / self.duration)

    @property
    def t(self) -> Floats:
        """Return the times of its rows, s."""
        return self.rows.index.to_numpy(np.float64)

    @property
    def hz(self) -> Floats:
        """Return the frequency at its rows, Hz."""
        return self.rows["frequency"].to_numpy(np.float64) / (2.0 * np.pi)

    def added(self, t: Floats) -> Floats:
        """Interpolate what was added at the times `t` [s]; zero outside it; in the unit of `Tables.systemid`."""
        return np.asarray(np.interp(t, self.t, self.rows["target"].to_numpy(np.float64), 0.0, 0.0))

    def spline(self, column: str = "target") -> Callable[[Floats], Floats] | None:
        """Return a spline through all rows, of what was added or of another column, level beyond; None of too few.

        A spline through rows that end where the chirp is fast swings beyond all bounds there. Order 13: at 0.4 of the
        logging rate a cubic is wrong by 20 %, this one by 0.3 %.
        """
        if column not in self._splines:
            self._splines[column] = self._spline(column)
        return self._splines[column]

    def _spline(self, column: str) -> Callable[[Floats], Floats] | None:
        values = self.rows[column].to_numpy(np.float64)
        known = np.isfinite(values)
        if np.count_nonzero(known) < FEWEST_ROWS:
            return None
        times = self.t[known]
        smooth = scipy.interpolate.make_interp_spline(times, values[known], k=_ORDER)
        return lambda t: np.asarray(smooth(np.clip(t, times[0], times[-1])), np.float64)

    def below_folding(self, t: Floats) -> Chirp:
        """Cut it to the time in which it sweeps what rows at `t` [s] can show; above, it folds onto the rest.

        Rows may come slower outside chirps, as those of RATE do.
        """
        inside = t[(t >= self.start) & (t <= self.stop)]
        step = float(np.median(np.diff(inside))) if len(inside) > 1 else np.inf
        shown = self.t[self.hz <= 0.5 / step]
        if self.high <= 0.5 / step or len(shown) < 8:
            return self
        start, stop = float(shown[0]), float(shown[-1])
        return replace(self, start=start, stop=stop, high=0.5 / step, rows=between(self.rows, start, stop))


def find_chirps(log: FlightLog, within: Within | None = None) -> tuple[Chirp, ...]:
    """Find the runs of SYSTEMID mode in a log, or of those within a time span [s] of it, in order.

    Of a log whose flight was chosen (`FlightLog.of_flight`) only those of this flight are found. A run ends where its
    clock (SIDD.Time) starts again, where the axis changes, or where SIDD pauses. Without SIDS the parameter SID_AXIS
    tells the axis.
    """
    return log.derived(_find_chirps, within)


def _find_chirps(log: FlightLog, within: Within | None) -> tuple[Chirp, ...]:
    table = log.tables.systemid
    if table is None or len(table) < 8:
        return ()
    if within is None and log.of_one_flight and log.flight is not None:
        within = log.flight.start, log.flight.stop
    t = table.index.to_numpy(np.float64)
    elapsed = table["elapsed"].to_numpy(np.float64)
    axis = table["axis"].to_numpy(np.float64)
    axis = np.where(np.isfinite(axis), axis, log.parameters.get("SID_AXIS", 0.0))
    frequency = table["frequency"].to_numpy(np.float64) / (2.0 * np.pi)
    target = table["target"].to_numpy(np.float64)
    new = (np.diff(elapsed) < -1e-3) | (np.diff(t) > _PAUSE) | (np.diff(axis) != 0.0)
    edges = np.concatenate([[0], np.flatnonzero(new) + 1, [len(t)]])
    planned = table["planned"].to_numpy(np.float64)
    chirps = []
    for first, last in pairwise(edges):
        number = int(axis[first])
        name, at_mixer = SID_AXES.get(number, ("", False))
        moving = np.abs(target[first:last]) > 0.0
        if np.count_nonzero(moving) < 8:
            continue
        # After its last cycle a run only waits.
        last = first + int(np.flatnonzero(moving)[-1]) + 1
        lasted = float(t[last - 1] - t[first])
        complete = not lasted < 0.95 * planned[last - 1]
        swept = frequency[first:last][moving[: last - first]]
        swept = swept[np.isfinite(swept)]
        if len(swept) >= 8:
            limits = float(swept.min()), float(swept.max())
        else:  # Autotuning of PX4 says what it adds, not at which frequency; the coherence tells where it did.
            limits = _SHORTEST / max(lasted, 1e-3), 0.45 / float(np.median(np.diff(t[first:last])))
        span, rows = (float(t[first]), float(t[last - 1])), table.iloc[first:last]
        chirps.append(Chirp(name, number, *span, *limits, at_mixer, complete, rows))
    return tuple(chirp for chirp in chirps if within is None or (within[0] <= chirp.start and chirp.stop <= within[1]))


def mixer_chirps(log: FlightLog, axis: str, within: Within | None = None) -> list[Chirp]:
    """Return the chirps at the mixer on one axis that show dynamics, in order."""
    return [chirp for chirp in find_chirps(log, within) if chirp.axis == axis and chirp.at_mixer and chirp.worthwhile]


def outside_chirps(log: FlightLog, t: Floats) -> NDArray[np.bool_]:
    """Return which times [s] are of ordinary flying: long enough after every chirp."""
    kept = np.ones(len(t), dtype=bool)
    for chirp in find_chirps(log):
        kept &= (t < chirp.start - _BEFORE) | (t > chirp.stop + _SETTLES)
    return kept


def ordinary_runs(log: FlightLog, t: Floats, known: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    """Return which rows of those that are `known` are of ordinary flying in the air, in runs without gaps."""
    if log.flight is None or len(t) < 2:
        return []
    flown = (t > log.flight.start + _SETTLES) & (t < log.flight.stop - _SETTLES)
    rows = np.flatnonzero(known & flown & outside_chirps(log, t))
    gaps = (np.diff(rows) > 1) | (np.diff(t[rows]) > 3.0 * np.median(np.diff(t)))
    return np.split(rows, np.flatnonzero(gaps) + 1)
