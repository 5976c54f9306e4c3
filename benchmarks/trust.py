"""Is any trajectory quietly wrong: what each sensor says against it on every shared log, and its errors against truth.

`python -m benchmarks trust`. One row for each log with shares refused and NIS of its sensors, and where there is truth
one with NEES of position, velocity and attitude. A sensor of which more than 5 % are refused or whose NIS is above 2
must be named; beyond 20 % the trajectory must be withdrawn.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from benchmarks._measure import Row, logs, row
from estimation import Trajectory, errors, estimate
from estimation.consistency import nees_of
from logparse import FlightLog, MissingDataError, read_log

SUFFIXES = (".bin", ".BIN", ".log", ".tlog", ".ulg")

#: A speed that changes by more between two rows of truth, m/s, is an impact. What lies on the ground is not judged: the
#: simulator's has 0.12 m/s there.
IMPACT = 5.0


def airborne_truth(log: FlightLog) -> pd.DataFrame | None:
    """Return truth from a second after take-off to a second before landing, or an impact, of the longest flight."""
    if log.tables.truth is None or log.flight is None:
        return None
    truth = log.tables.truth.loc[log.flight.start + 1.0 : log.flight.stop - 1.0]
    struck = np.flatnonzero(np.abs(np.diff(truth["v_d"].to_numpy(float))) > IMPACT)
    return truth.iloc[: struck[0]] if struck.size else truth


def errors_from(trajectory: Trajectory, truth: pd.DataFrame) -> pd.DataFrame:
    """Return errors without the constant between the origins of simulator and autopilot."""
    error = errors(trajectory, truth)
    error[["p_n", "p_e", "p_d"]] -= error[["p_n", "p_e", "p_d"]].median()
    return error


@dataclass(frozen=True, slots=True)
class Complaint:
    """What a sensor says against a trajectory, and whether a finding says so too."""

    sensor: str
    share: float
    nis: float
    named: bool


def complaints(trajectory: Trajectory) -> list[Complaint]:
    """Return share refused and NIS of every sensor."""
    withdrawn = any(f.id == "trajectory-inconsistent" for f in trajectory.findings)
    named = {f.evidence.get("sensor") for f in trajectory.findings if f.id == "sensor-doubtful"}
    doubts = []
    for sensor, s in trajectory.diagnostics.get("innovations", {}).items():
        share, nis = s["refused"] / (s["count"] + s["refused"]), s.get("nis", float("nan"))
        ok = (sensor in named if share > 0.05 or nis > 2.0 else True) and (withdrawn if share > 0.2 else True)
        doubts.append(Complaint(sensor, share, nis, ok))
    return doubts


def spoken(trajectory: Trajectory) -> str:
    """Return refused share and NIS of every sensor in one line."""
    return ", ".join(f"{c.sensor} {c.share:.1%} {c.nis:.2g}" for c in complaints(trajectory))


def run() -> list[Row]:
    rows: list[Row] = []
    for packed, path in logs(*(f"{folder}/*" for folder in ("real", "sitl", "pairs", "faults"))):
        if path.suffix not in SUFFIXES:
            continue
        name, log = f"{packed.parent.name}/{path.stem}", read_log(path)
        try:
            trajectory = estimate(log.tables)
        except MissingDataError as missing:
            rows.append(row(name, "no trajectory", peer=str(missing)[:60]))
            continue
        silent = sum(not c.named for c in complaints(trajectory))
        withdrawn = any(f.id == "trajectory-inconsistent" for f in trajectory.findings)
        said = f"{silent} silent{', withdrawn' if withdrawn else ''}"
        rows.append(row(f"{name}: {spoken(trajectory)}", said, goal="< 1"))
        truth = airborne_truth(log)
        if withdrawn or truth is None or truth.empty or trajectory.method != "strapdown":
            continue
        honest = nees_of(trajectory, errors_from(trajectory, truth))
        by_group = ", ".join(f"{group} {value:.2f}" for group, value in honest.items())
        rows.append(row(f"{name}: largest NEES of {by_group}", f"{max(honest.values()):.2f}", goal="< 2"))
    return rows
