"""What the estimate found out about a log: sensors missing, silent or wrong, and for how long."""

from itertools import pairwise

import numpy as np
import pandas as pd

from estimation import _kernels
from estimation.faults.outages import LONGEST_SILENCE
from estimation.filter import Filtered
from estimation.timing import LONGEST_HOLE
from estimation.trajectory import POSITION_KNOWN
from logparse import Finding, Severity

#: Refused fixes nearer to each other than this belong to one glitch, s.
GLITCH_PAUSE = 2.0


def missing_sensors(*, gps: bool, mag: bool, baro: bool) -> list[Finding]:
    """Report which aiding sensors are not there, each flag telling whether it is."""
    findings = []
    if not gps:
        findings.append(
            Finding(
                "no-gps",
                Severity.ERROR,
                "No usable GPS fix: horizontal position and velocity drift freely and their sigmas grow accordingly.",
                "Log GPS and wait for a 3-D fix before take-off.",
            )
        )
    if not mag:
        findings.append(
            Finding(
                "no-magnetometer",
                Severity.WARNING,
                "No magnetometer: heading is known only from the movement of the craft, if it moves.",
                "Log the compass.",
            )
        )
    if not baro:
        findings.append(
            Finding(
                "no-baro",
                Severity.INFO,
                "No barometer: height rests on GPS alone.",
                "Log the barometer.",
            )
        )
    return findings


def stuck_magnetometer() -> list[Finding]:
    """Report a magnetometer whose readings never change although the craft turns."""
    return [
        Finding(
            "compass-doubtful",
            Severity.WARNING,
            "The magnetometer repeats one reading while the craft turns: it is not used, and heading is known only "
            "from the movement of the craft.",
            "Look at the compass's cable and its driver (COMPASS_USE, COMPASS_DEV_ID); calibrate it again.",
        )
    ]


def imu_holes(pieces: list[pd.DataFrame]) -> list[Finding]:
    """Report where no IMU was logged: between the samples of successive segments."""
    return [
        Finding(
            "imu-hole",
            Severity.WARNING,
            f"No IMU samples for {after.index[0] - before.index[-1]:.1f} s from t = {before.index[-1]:.1f} s; "
            "the trajectory has no rows there.",
            "Check that the logger keeps up, and that it goes on while disarmed.",
            {"start": float(before.index[-1]), "stop": float(after.index[0])},
        )
        for before, after in pairwise(pieces)
        if after.index[0] - before.index[-1] > LONGEST_HOLE
    ]


def other_imu(imu: int, gain: float, piece: pd.DataFrame) -> list[Finding]:
    """Report that another IMU than the first carries a segment, and by how much it is likelier (inf: the only one)."""
    if imu == 0:
        return []
    start, stop = float(piece.index[0]), float(piece.index[-1])
    reason = (
        "agrees better with GPS, baro and compass than" if np.isfinite(gain) else "goes on where there is a hole in"
    )
    return [
        Finding(
            "imu-doubtful",
            Severity.WARNING,
            f"From t = {start:.1f} to {stop:.1f} s IMU {imu + 1} {reason} IMU 1, and is used instead.",
            "Look at the mounting, calibration and temperature of the first IMU.",
            {"imu": imu, "log_likelihood_gain": gain, "start": start, "stop": stop},
        )
    ]


def gps_troubles(segment: Filtered, t: np.ndarray, covariance: np.ndarray) -> list[Finding]:
    """Report where GPS positions stayed away or were refused, in one segment."""
    o = segment.observations
    mine = np.flatnonzero(o.kind == _kernels.GPS_POSITION)
    if mine.size == 0:
        return []
    findings = []
    when = o.t[mine]
    for before, after in pairwise([*when.tolist(), segment.stop]):
        rows = slice(*np.searchsorted(t, [before, after]))
        if after - before > LONGEST_SILENCE and t[rows].size:
            drift = np.sqrt(np.trace(covariance[rows, :2, :2, :2], axis1=2, axis2=3).max(axis=0))
            findings.append(_outage(before, after, *drift.tolist(), lost=after == segment.stop))
    refused = np.flatnonzero(segment.inverse_variance[o.start[mine]] == 0.0)
    for run in np.split(refused, np.flatnonzero(np.diff(when[refused]) > GLITCH_PAUSE) + 1):
        if run.size < 2:
            continue
        scalars = np.concatenate([np.arange(o.start[g], o.start[g + 1]) for g in mine[run]])
        size = float(np.abs(segment.innovation[scalars]).max())
        start, stop = when[run[[0, -1]]].tolist()
        findings.append(
            Finding(
                "sensor-refused",
                Severity.WARNING,
                f"GPS positions up to {size:.0f} m off were refused from t = {start:.1f} to {stop:.1f} s.",
                "Look at satellites and HDOP there; a mast and distance from power cables help.",
                {"sensor": "gps_position", "start": start, "stop": stop, "size_m": size, "fixes": int(run.size)},
            )
        )
    return findings


def _outage(start: float, stop: float, position: float, velocity: float, *, lost: bool) -> Finding:
    """Report a stretch without GPS positions, with the largest 1-sigma of what is horizontal there, m and m/s."""
    known = f"there the horizontal position is known to {position:.3g} m, velocity to {velocity:.2g} m/s (1-sigma)"
    silence = f"No GPS position for {stop - start:.0f} s from t = {start:.1f} s"
    return Finding(
        "gps-outage",
        Severity.ERROR if lost and position > POSITION_KNOWN else Severity.WARNING,
        f"{silence} to the end of the record: {known} at worst."
        if lost
        else f"{silence}; the smoother bridges it: {known} at worst.",
        "Look at the receiver, its cable and its supply; rely on what was flown before." if lost else "",
        {"start": start, "stop": stop, "position_sigma_m": position, "velocity_sigma_mps": velocity},
    )
