"""How long each stage of an analysis will take, from what a log holds, so that a progress bar can tell.

Seconds are those of one core of 2024 on 45 logs of all kinds; only their ratios matter, since the time to go is told
from the time gone (`pipeline.execution.progress.Clock`).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from logparse import FlightLog
from pipeline.flight.training import SHORTEST
from pipeline.results.span import Span

#: Rate [Hz] above which the rate controller's rows are thinned before responses are computed.
_THINNED = 100.0
#: Longest flight [s] of which transfer functions take more time, and of which the rigid body does.
_FITTED, _BODY = 350.0, 600.0
#: Fewest fixes that say that there is a position.
_FIXES = 10


def expected_seconds(log: FlightLog, flight: Span | None) -> Mapping[str, float]:
    """Return the seconds that each stage will take; what will not be done is left out."""
    tables, megabytes = log.tables, 1e-6 * log.path.stat().st_size
    seconds = {"read": 0.05 + 0.012 * megabytes, "tables": 0.03, "account": 0.08 + 0.03 * megabytes}
    fixes = 0 if tables.gps is None else int((tables.gps["fix"].to_numpy(np.float64) >= 3.0).sum())
    covered = _covered(tables.times("imu"))
    seconds["trajectory"] = 0.2 + 0.006 * covered if fixes > _FIXES else 0.15 + 0.0015 * covered
    if flight is None:
        return seconds | {"report": 0.05}
    flown = float(np.clip(flight.stop - flight.start, 0.0, 1e5))
    rates, motors = tables.times("rates"), 0 if tables.motors is None else tables.motors.shape[1]
    if motors and covered:
        rows = 0 if rates is None else int(((rates >= flight.start) & (rates <= flight.stop)).sum())
        seconds["rotation"] = 0.3 + 0.001 * flown + 1e-4 * min(rows, _THINNED * flown)
    if not motors or fixes <= _FIXES or flown < SHORTEST:
        return seconds | {"experiment": 0.05, "report": 0.07}
    fitted, body = min(flown, _FITTED), min(flown, _BODY)
    return seconds | {
        "experiment": 0.06,
        # With the judging on held-out flight that follows each.
        "motors": (0.15 + 0.003 * fitted) * (motors / 4.0) ** 0.7 + 0.1 + 0.001 * fitted,
        "mixer": 0.3 + 0.0005 * fitted,
        "reference": 0.08,
        "rigid_body": 0.25 + 0.003 * body,
        "parameters": 0.1 + 0.0006 * body,
        "coverage": 0.03,
        "answer": 0.05,
        "report": 0.3,
    }


def _covered(times: np.ndarray | None) -> float:
    """Return the time that a table covers, gaps left out, s."""
    if times is None or len(times) < 2:
        return 0.0
    return float(np.clip(np.nan_to_num(len(times) * np.median(np.diff(times))), 0.0, 1e5))
