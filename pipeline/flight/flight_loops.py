"""Oscillations and tracking of the autopilot's loops, as any flight shows them."""

from __future__ import annotations

import numpy as np

from logparse import FlightLog
from pipeline.results.loops import FlightLoops
from pipeline.results.span import Span
from sysid.loops.controller import AXES
from sysid.loops.evidence import find_oscillation

#: Fewest samples of asked and flown attitude that make an RMS.
_FEWEST = 50
#: Median error [rad] with which no craft flies: one of both attitudes is wrong.
_APART = np.radians(15.0)


def assess_loops(log: FlightLog, sound: Span) -> FlightLoops:
    """Look at the loops of one flight."""
    whole = log.flight is None or sound.stop >= log.flight.stop - 1.0
    # A broken craft swings for other reasons than its gains.
    found = {axis: find_oscillation(log, axis) for axis in AXES} if whole else {}
    oscillations = {axis: each.hz for axis, each in found.items() if each is not None}
    return FlightLoops(oscillations_hz=oscillations, tracking_rad=_tracking(log, sound))


def _tracking(log: FlightLog, span: Span) -> dict[str, float]:
    """Compute the RMS difference between asked and flown roll and pitch, rad."""
    errors = {}
    for axis in ("roll", "pitch"):
        asked = next(iter(log.tables.columns("setpoints", (axis,))), None)
        flown = next(iter(log.tables.columns("attitude", (axis,))), None)
        if asked is None or flown is None:
            continue
        asked, flown = asked.dropna().loc[span.start : span.stop], flown.dropna().loc[span.start : span.stop]
        if min(len(asked), len(flown)) < _FEWEST:
            continue
        difference = asked.to_numpy() - np.interp(asked.index, flown.index, flown)
        if np.median(np.abs(difference)) > _APART:
            continue  # no craft flies like that: one of both is wrong, and the timeline says so
        errors[axis] = float(np.sqrt(np.mean(difference**2)))
    return errors
