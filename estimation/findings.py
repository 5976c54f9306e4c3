"""What the estimate found out about a log: sensors missing, silent or wrong, and for how long."""

from itertools import pairwise

import numpy as np
import pandas as pd

from estimation import _kernels
from estimation.filter import Filtered
from estimation.timing import LONGEST_HOLE
from logparse import Finding, Severity

#: A receiver silent for longer than this is out, s.
LONGEST_SILENCE = 5.0
#: Refused fixes nearer to each other than this belong to one glitch, s.
GLITCH_PAUSE = 2.0


def missing_sensors(*, gps: bool, mag: bool, baro: bool) -> list[Finding]:
    """Report which aiding sensors are not there, each flag telling whether it is.

    Parameters
    ----------
    gps, mag, baro : bool
        Whether the log has the sensor.
    """
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
            "magnetometer-stuck",
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
    """Report that another IMU than the first carries a segment, and by how much it is likelier (inf: the only one).

    Parameters
    ----------
    imu : int
        Number of the IMU that carries the segment, from 0.
    gain : float
        By how much its log-likelihood is above that of the first; inf where the first has a hole.
    piece : DataFrame
        The segment's IMU samples, indexed by t, s.
    """
    if imu == 0:
        return []
    start, stop = float(piece.index[0]), float(piece.index[-1])
    reason = (
        "agrees better with GPS, baro and compass than" if np.isfinite(gain) else "goes on where there is a hole in"
    )
    return [
        Finding(
            "other-imu",
            Severity.WARNING,
            f"From t = {start:.1f} to {stop:.1f} s IMU {imu + 1} {reason} IMU 1, and is used instead.",
            "Look at the mounting, calibration and temperature of the first IMU.",
            {"imu": imu, "log_likelihood_gain": gain, "start": start, "stop": stop},
        )
    ]


def gps_troubles(segment: Filtered) -> list[Finding]:
    """Report where GPS positions stayed away or were refused, in one segment."""
    o = segment.observations
    mine = np.flatnonzero(o.kind == _kernels.GPS_POSITION)
    if mine.size == 0:
        return []
    findings = []
    t = o.t[mine]
    for before, after in pairwise([*t.tolist(), segment.stop]):
        if after - before > LONGEST_SILENCE:
            findings.append(
                Finding(
                    "gps-outage",
                    Severity.WARNING,
                    f"No GPS position for {after - before:.0f} s from t = {before:.1f} s; the smoother bridges it.",
                    evidence={"start": before, "stop": after},
                )
            )
    refused = np.flatnonzero(segment.inverse_variance[o.start[mine]] == 0.0)
    for run in np.split(refused, np.flatnonzero(np.diff(t[refused]) > GLITCH_PAUSE) + 1):
        if run.size < 2:
            continue
        scalars = np.concatenate([np.arange(o.start[g], o.start[g + 1]) for g in mine[run]])
        size = float(np.abs(segment.innovation[scalars]).max())
        findings.append(
            Finding(
                "gps-glitch",
                Severity.WARNING,
                f"GPS positions up to {size:.0f} m off were refused from t = {t[run[0]]:.1f} to {t[run[-1]]:.1f} s.",
                "Look at satellites and HDOP there; a mast and distance from power cables help.",
                {"start": float(t[run[0]]), "stop": float(t[run[-1]]), "size_m": size, "fixes": int(run.size)},
            )
        )
    return findings
