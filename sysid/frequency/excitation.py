"""Stretches of a flight in which an axis was excited: chirps of SYSTEMID mode, or whatever else moved it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from logparse import FlightLog
from sysid.frequency.axes import SID_AXES

#: From when to when on the boot clock a log counts, s.
Within = tuple[float, float]

#: Pause [s] in SIDD that ends a run even when its clock goes on.
_PAUSE = 2.0

#: Cycles of its lowest frequency that a chirp must last to be of use, and of any frequency that is looked at.
_SHORTEST, _LEAST_CYCLES = 2.0, 3.0


@dataclass(frozen=True, slots=True)
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

    @property
    def duration(self) -> float:
        """Return the length, s."""
        return self.stop - self.start

    @property
    def worthwhile(self) -> bool:
        """Return whether it lasted two cycles of its lowest frequency, and swept a band in which dynamics show."""
        long_enough = self.high > 0.0 and self.duration * max(self.low, 1e-3) >= _SHORTEST
        return long_enough and self.high > 1.7 * max(self.low, _LEAST_CYCLES / self.duration)


def find_chirps(log: FlightLog, within: Within | None = None) -> tuple[Chirp, ...]:
    """Find the runs of SYSTEMID mode in a log, or of those within a stretch of time [s] of it, in order.

    Of a log whose flight was chosen (`FlightLog.of_flight`) only those of this flight are found. A run ends where its
    clock (SIDD.Time) starts again, where the axis changes, or where SIDD pauses. Without SIDS the parameter SID_AXIS
    tells the axis.
    """
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
    found = []
    for first, last in pairwise(edges):
        if last - first < 8:
            continue
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
        found.append(Chirp(name, number, float(t[first]), float(t[last - 1]), *limits, at_mixer, complete))
    return tuple(chirp for chirp in found if within is None or (within[0] <= chirp.start and chirp.stop <= within[1]))
