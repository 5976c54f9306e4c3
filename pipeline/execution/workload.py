"""How long each stage of an analysis will take, estimated from what a log holds, for the progress bar.

Seconds are those of one core of 2024 on 45 logs of all kinds; only their ratios matter, since the time to go is
extrapolated from the time gone (`pipeline.execution.progress.Clock`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from core.lazy import lazy
from pipeline.config import SHORTEST

if TYPE_CHECKING:
    import numpy as np

    from logparse import FlightLog
    from pipeline.results.span import Span
else:
    np = lazy("numpy")  # the bar appears before the numerical packages are loaded


@dataclass(frozen=True, slots=True, kw_only=True)
class Workload:
    """What a log holds, as far as it takes time; by default as in a usual log."""

    megabytes: float = 1.0  #: Of the file.
    logged: float = 90.0  #: Time that the inertial sensors' table covers, s.
    position: bool = True  #: Whether there are enough fixes for one.
    flown: float = 60.0  #: Of the flight, s; 0 without one.
    motors: int = 4
    rows: float = 0.0  #: Of the rate controller in flight.

    @classmethod
    def of(cls, log: FlightLog, flight: Span | None) -> Workload:
        """Return the workload of a log and one of its flights."""
        tables, rates = log.tables, log.tables.times("rates")
        fixes = 0 if tables.gps is None else int((tables.gps["fix"].to_numpy(np.float64) >= 3.0).sum())
        inside = rates is not None and flight is not None and (rates >= flight.start) & (rates <= flight.stop)
        return cls(
            megabytes=1e-6 * log.path.stat().st_size,
            logged=_covered(tables.times("imu")),
            position=fixes > 10,
            flown=0.0 if flight is None else float(np.clip(flight.duration, 1e-3, 1e5)),
            motors=0 if tables.motors is None else tables.motors.shape[1],
            rows=float(np.sum(inside)),
        )

    def seconds(self) -> dict[str, float]:
        """Return the seconds that each stage will take; stages that will not run are left out."""
        seconds = {"read": 0.05 + 0.012 * self.megabytes, "tables": 0.03, "account": 0.08 + 0.03 * self.megabytes}
        seconds["trajectory"] = 0.2 + 0.006 * self.logged if self.position else 0.15 + 0.0015 * self.logged
        if not self.flown:
            return seconds | {"report": 0.05}
        if self.motors and self.logged:
            # The rate controller's rows are thinned to 100 Hz before responses are computed.
            seconds["rotation"] = 0.3 + 0.001 * self.flown + 1e-4 * min(self.rows, 100.0 * self.flown)
        if not self.motors or not self.position or self.flown < SHORTEST:
            return seconds | {"experiment": 0.05, "report": 0.07}
        # Longer flights take transfer functions, and the rigid body, no more time.
        fitted, body = min(self.flown, 350.0), min(self.flown, 600.0)
        return seconds | {
            "experiment": 0.06,
            # With the validation on held-out flight that follows each fit.
            "motors": (0.15 + 0.003 * fitted) * (self.motors / 4.0) ** 0.7 + 0.1 + 0.001 * fitted,
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
