"""Findings on whether a trajectory and its sensors can be trusted.

A sensor with less than 5 % of its readings refused is in order. Up to 20 % it is reported as doubtful. Beyond that, or
where the trajectory contradicts the accuracy that a GPS receiver states, the trajectory is withdrawn, because which of
the two is wrong is not known.
"""

from collections.abc import Iterator, Mapping
from itertools import pairwise

import numpy as np
import pandas as pd

from core.findings import info, warning
from estimation import _kernels
from estimation.consistency import SensorStatistics
from estimation.filter import Filtered
from estimation.observations import usable_fixes
from estimation.outages import LONGEST_SILENCE
from estimation.place import LocalFrame
from estimation.shocks import Shocks
from estimation.states import SensorNoise
from estimation.timing import LONGEST_HOLE
from estimation.trajectory import POSITION_KNOWN
from logparse import Finding, Geodetic, Severity, Tables
from logparse.craft.vehicle import is_simulated

#: Share of refused readings, and mean normalised innovation squared, beyond which a sensor is reported.
SUSPECT_SHARE, SUSPECT_NIS = 0.05, 2.0
#: Share of refused readings beyond which the trajectory is withdrawn.
DOUBTFUL_SHARE = 0.20
#: A fix is contradicted if the trajectory is further from it than so many times its stated accuracy; the trajectory is
#: withdrawn if this share of fixes is contradicted.
CONTRADICTION, CONTRADICTED_SHARE = 5.0, 0.10
#: Lower bounds of stated accuracies, m and m/s: the first and last for interpolation between rows; the other because a
#: single-frequency receiver without corrections wanders over minutes by 2.5 m CEP (u-blox M8 data sheet), 1-sigma
#: 2.1 m per axis, whatever it states, and the trajectory is right not to follow.
BEST_POSITION, BEST_SPEED = 0.5, 0.3
BEST_UNCORRECTED = 2.1
#: Fix types from which on the receiver measures phases against a base (RTK).
CORRECTED = 5.0
#: Largest bias of an accelerometer (with axes, units and scale right), m/s^2, and of a gyro, rad/s.
LARGEST_ACCEL_BIAS, LARGEST_GYRO_BIAS = 5.0, 0.5
#: Lag beyond which a sensor is reported, s: some hundredths are its driver's.
LATE = 0.25

#: Random walk of the hard iron from which on a compass is reported, T/sqrt(s): 6 uT in 100 s are 17 degrees of heading
#: in a field of 20 uT, and thirty times the default of `SensorNoise`.
WANDERING = 6e-7

#: Wander of GPS heights, over the stated accuracy, from which on a receiver is reported.
HEIGHT_WANDER = 2.0
#: Scale error from which on a gyro is reported.
SCALE_OFF = 0.01

#: No craft flies on after its velocity stepped by so much, m/s, so many times: the steps are an error of the IMU.
WRECKING_STEP, WRECKED = 5.0, 3
#: Steps in more than this share of a log's seconds, four fifths of them spread over more than the second share of it,
#: are no impacts: sound logs of chirps near instability have 5.1 % (methodic_quad15_roll40), exchanged axes 6 % and up.
STEPPING, SPREAD = 0.055, 0.2

#: Names of the sensors whose lag is estimated.
SENSOR_NAMES: Mapping[str, str] = {"gps": "GPS", "gps2": "second GPS", "mag": "compass", "baro": "barometer"}

#: Names of the readings of each sensor.
READING_NAMES: Mapping[str, str] = {
    "gps_position": "GPS positions",
    "gps_height": "GPS heights",
    "gps_velocity": "GPS velocities",
    "gps_climb": "vertical velocities of the GPS",
    "baro": "barometer readings",
    "mag": "compass readings",
    "gps2_position": "positions of the second GPS",
    "gps2_velocity": "velocities of the second GPS",
    "range_finder": "range finder readings",
    "autopilot": "autopilot's positions and velocities",
}


def doubtful_sensors(innovations: Mapping[str, SensorStatistics]) -> list[Finding]:
    """Report sensors that were refused often, or disagree by more than their noise."""
    findings, doubts = [], []
    for name, sensor in innovations.items():
        total = sensor["count"] + sensor["refused"]
        share, nis = sensor["refused"] / total, sensor.get("nis", 1.0)
        if share > SUSPECT_SHARE or nis > SUSPECT_NIS:
            findings.append(_suspect(name, share, nis))
        if share > DOUBTFUL_SHARE:
            doubts.append(f"{share:.0%} of the {READING_NAMES[name]}")
    if doubts:
        findings.append(inconsistent(f"it had to refuse {' and '.join(doubts)}"))
    return findings


def _suspect(name: str, share: float, nis: float) -> Finding:
    fused = bool(np.isfinite(nis))
    others = (
        f", and the others differ from the trajectory by {np.sqrt(nis):.1f} times what their noise explains (root mean "
        "square)"
    )
    return warning(
        "sensor-doubtful",
        f"{share:.0%} of the {READING_NAMES[name]} were refused{others if fused else ''}.",
        "Look at that sensor: its mounting, cables, and what is switched on near it.",
        sensor=name,
        refused_share=share,
        nis=nis if fused else None,
    )


def inconsistent(why: str, evidence: Mapping[str, float] | None = None) -> Finding:
    """Return the error that withdraws a trajectory."""
    return Finding(
        "trajectory-inconsistent",
        Severity.ERROR,
        f"The trajectory contradicts the sensors: {why}. Which of them is wrong cannot be decided, so neither speeds "
        "nor models are stated.",
        "Look at GPS, compass, barometer and the IMU's vibration; logs of flights before and after may tell which.",
        evidence or {},
    )


def impossible_biases(states: pd.DataFrame) -> Iterator[Finding]:
    """Report biases that only wrong axes, units or scale of the IMU, or a wrong heading, explain."""
    for what, columns, largest, unit in (
        ("accelerometer", ["b_ax", "b_ay", "b_az"], LARGEST_ACCEL_BIAS, "m/s²"),
        ("gyro", ["b_gx", "b_gy", "b_gz"], LARGEST_GYRO_BIAS, "rad/s"),
    ):
        bias = float(np.linalg.norm(states[columns].median()))
        if bias > largest:
            yield inconsistent(
                f"they agree only if the {what} is off by {bias:.2g} {unit}, as one with wrong axes, units or scale",
                {"bias": bias},
            )
    if "b_mx" in states:
        # In level flight a wrong heading appears as a hard iron of up to twice the horizontal field.
        iron = float(np.median(np.linalg.norm(states[["b_mx", "b_my", "b_mz"]], axis=1)))
        level = float(np.median(np.hypot(states["m_n"], states["m_e"])))
        if iron > level:
            yield inconsistent(
                f"they agree only if the compass is off by {1e6 * iron:.0f} µT, more than the horizontal field "
                f"of {1e6 * level:.0f} µT by which it tells the heading",
                {"bias": iron},
            )


def contradicted_receiver(
    tables: Tables, states: pd.DataFrame, origin: Geodetic, lag: float, *, velocities: bool = True
) -> Iterator[Finding]:
    """Compare a trajectory with the GPS by the accuracy that the receiver states."""
    fixes = usable_fixes(tables.gps)
    if fixes is None or not np.isfinite(origin.lat):
        return
    when = fixes["t_valid"].to_numpy(float)
    when = np.where(np.isfinite(when), when, fixes.index.to_numpy(float)) - lag
    t = states.index.to_numpy(float)
    after = np.clip(np.searchsorted(t, when), 1, len(t) - 1)
    known = (when >= t[0]) & (when <= t[-1]) & (t[after] - t[after - 1] < 1.0)
    frame = LocalFrame.at(origin, spherical=is_simulated(tables.parameters))
    place = frame.to_ned(*(fixes[c].to_numpy(float) for c in ("lat", "lon", "alt")))
    wandering = np.where(fixes["fix"].to_numpy(float) >= CORRECTED, BEST_POSITION, BEST_UNCORRECTED)
    for what, columns, measured, accuracy, best in (
        ("positions", ("p_n", "p_e"), place[:, :2], fixes["h_acc"], wandering),
        (
            "velocities",
            ("v_n", "v_e"),
            fixes[["v_n", "v_e"]].to_numpy(float),
            fixes["s_acc"],
            np.full(len(fixes), BEST_SPEED),
        ),
    ):
        stated = accuracy.to_numpy(float)
        compared = known & np.isfinite(measured).all(axis=1) & np.isfinite(stated) & (stated > 0.0)
        if np.count_nonzero(compared) < 20 or (what == "velocities" and not velocities):
            continue
        estimate = np.column_stack([np.interp(when[compared], t, states[c].to_numpy(float)) for c in columns])
        distance = np.hypot(*(estimate - measured[compared]).T)
        beyond = distance > CONTRADICTION * np.maximum(stated[compared], best[compared])
        share = float(beyond.mean())
        if share > CONTRADICTED_SHARE:
            unit = "m" if what == "positions" else "m/s"
            yield inconsistent(
                f"{share:.0%} of the GPS {what} lie more than {CONTRADICTION:g} times their accuracy (as stated, "
                f"or that of their class) from it, up to {distance.max():.0f} {unit}",
                {"contradicted_share": share, "largest": float(distance.max())},
            )


def late_sensors(lags: Mapping[str, float]) -> Iterator[Finding]:
    """Report sensors whose clock is off; their data are used at corrected times."""
    for sensor, lag in lags.items():
        if abs(lag) > LATE:
            yield warning(
                "sensor-doubtful",
                f"The {SENSOR_NAMES[sensor]} is {abs(lag):.2f} s {'later' if lag > 0 else 'earlier'} "
                "than its rows say, by the IMU's movement; its data are used at the times found.",
                "Set GPS_DELAY_MS, and look at the receiver's rate and cable."
                if sensor.startswith("gps")
                else "Look at how this sensor is connected, and at what filters its readings.",
                sensor=sensor,
                lag_s=lag,
            )


def doubtful_settings(noise: SensorNoise, yaw_scale: float) -> Iterator[Finding]:
    """Report sensors whose noise or scale, as estimated from the log, is unusual for their class."""
    if (share := noise.gps_height_share) >= HEIGHT_WANDER:
        yield warning(
            "sensor-doubtful",
            f"The heights of the GPS swing by {share:.1f} times the accuracy that it states (or that of its class): "
            "height rests on the barometer.",
            "Look at the receiver's antenna, satellites and HDOP.",
            sensor="gps_height",
            share=share,
        )
    if (walk := noise.hard_iron_walk) >= WANDERING:
        moved = walk * 1e6 * float(np.sqrt(10.0))
        yield warning(
            "sensor-doubtful",
            f"The compass's readings wander by {moved:.1f} µT within ten seconds, beside what turning explains: "
            "headings rest on the gyro and on how the craft accelerates.",
            "Move the compass away from power wires and iron, or calibrate it against the motors' current "
            "(COMPASS_MOTCT).",
            wander_ut_10s=moved,
        )
    off = 1.0 / yaw_scale - 1.0
    if abs(off) >= SCALE_OFF:
        yield warning(
            "sensor-doubtful",
            f"The gyro shows {abs(off):.1%} {'more' if off > 0.0 else 'less'} yaw than the craft turned, by compass "
            "and GPS; its rates are used with the scale found.",
            "Calibrate the IMU's temperature (INS_TCAL), or use another IMU.",
            yaw_scale=yaw_scale,
        )


def missed_steps(shocks: list[Shocks], length: float) -> list[Finding]:
    """Report steps of attitude or velocity that the other sensors measured and the IMU missed."""
    t, sizes = (np.concatenate(parts) for parts in zip(*(s.steps for s in shocks), strict=True))
    if t.size == 0:
        return []
    seconds = np.unique(np.floor(t))
    share = len(seconds) / max(length, 1.0)
    findings = [
        warning(
            "sensor-doubtful",
            f"At {len(t)} moments from t = {t.min():.1f} to {t.max():.1f} s, in {100.0 * share:.2g} % of "
            "the log's seconds, the craft's motion changed by more than its IMU tells: impacts, saturation, or "
            "vibration beyond its range.",
            "Look at vibration (VIBE) and the IMU's mount.",
            steps=len(t),
            share_of_seconds=share,
        )
    ]
    steps = sizes[:, 1]
    wrecking = int(np.count_nonzero(steps > WRECKING_STEP))
    if wrecking >= WRECKED:
        findings.append(
            inconsistent(
                f"at {wrecking} moments they agree only if velocity stepped by "
                f"{WRECKING_STEP:g} to {steps.max():.0f} m/s unseen by the IMU, after which no craft flies on",
                {"steps": wrecking, "largest": float(steps.max())},
            )
        )
    all_through = np.ptp(np.quantile(seconds, [0.1, 0.9])) > SPREAD * length
    if share > DOUBTFUL_SHARE or (share > STEPPING and all_through):
        findings.append(
            inconsistent(
                f"the IMU missed what the other sensors saw in {100.0 * share:.2g} % of the log's seconds, as one "
                "whose axes, scale or mount are not what the log says"
            )
        )
    return findings


def only_one_withdrawal(findings: list[Finding]) -> list[Finding]:
    """Keep the first `trajectory-inconsistent` of several: one reason is enough to withdraw a trajectory."""
    first = next((f for f in findings if f.id == "trajectory-inconsistent"), None)
    return [f for f in findings if f.id != "trajectory-inconsistent" or f is first]


#: Longest time between refused fixes of one glitch, s.
GLITCH_PAUSE = 2.0


def missing_sensors(*, gps: bool, mag: bool, baro: bool) -> Iterator[Finding]:
    """Report aiding sensors that were not logged; each flag is whether it was."""
    if not gps:
        reason = "No usable GPS fix: horizontal position and velocity drift freely and their sigmas grow accordingly."
        advice = "Log GPS and wait for a 3-D fix before take-off."
        yield Finding("not-logged", Severity.ERROR, reason, advice, {"what": "gps"})
    if not mag:
        reason = "No magnetometer: heading is known only from the movement of the craft, if it moves."
        yield warning("not-logged", reason, "Log the compass.", what="mag")
    if not baro:
        yield info("not-logged", "No barometer: the height is less sure.", "Log the barometer.", what="baro")


def stuck_magnetometer() -> Finding:
    """Report a magnetometer whose readings never change although the craft turns."""
    return warning(
        "sensor-doubtful",
        "The magnetometer repeats one reading while the craft turns: it is not used, and heading is known only "
        "from the movement of the craft.",
        "Look at the compass's cable and its driver (COMPASS_USE, COMPASS_DEV_ID); calibrate it again.",
    )


def imu_holes(pieces: list[pd.DataFrame]) -> Iterator[Finding]:
    """Report where no IMU was logged: between the samples of successive segments."""
    for before, after in pairwise(pieces):
        start, stop = float(before.index[-1]), float(after.index[0])
        if stop - start > LONGEST_HOLE:
            yield warning(
                "log-gaps",
                f"No IMU samples for {stop - start:.1f} s from t = {start:.1f} s; the trajectory has no rows there.",
                "Check that the logger keeps up, and that it goes on while disarmed.",
                start=start,
                stop=stop,
            )


def other_imu(imu: int, gain: float, piece: pd.DataFrame) -> Iterator[Finding]:
    """Report that a segment uses another IMU than the first, with its gain of log-likelihood (inf: the only one)."""
    if imu == 0:
        return
    start, stop = float(piece.index[0]), float(piece.index[-1])
    reason = (
        "agrees better with GPS, baro and compass than" if np.isfinite(gain) else "goes on where there is a hole in"
    )
    yield warning(
        "sensor-doubtful",
        f"From t = {start:.1f} to {stop:.1f} s IMU {imu + 1} {reason} IMU 1, and is used instead.",
        "Look at the mounting, calibration and temperature of the first IMU.",
        imu=imu,
        log_likelihood_gain=gain,
        start=start,
        stop=stop,
    )


def gps_troubles(segment: Filtered, t: np.ndarray, covariance: np.ndarray) -> list[Finding]:
    """Report outages and refused positions of the GPS in one segment."""
    o = segment.observations
    fixes = np.flatnonzero(o.kind == _kernels.GPS_POSITION)
    if fixes.size == 0:
        return []
    findings = []
    when = o.t[fixes]
    for before, after in pairwise([*when.tolist(), segment.stop]):
        rows = slice(*np.searchsorted(t, [before, after]))
        if after - before > LONGEST_SILENCE and t[rows].size:
            drift = np.sqrt(np.trace(covariance[rows, :2, :2, :2], axis1=2, axis2=3).max(axis=0))
            findings.append(_outage(before, after, *drift.tolist(), lost=after == segment.stop))
    refused = np.flatnonzero(segment.inverse_variance[o.start[fixes]] == 0.0)
    for run in np.split(refused, np.flatnonzero(np.diff(when[refused]) > GLITCH_PAUSE) + 1):
        if run.size < 2:
            continue
        scalars = np.concatenate([np.arange(o.start[g], o.start[g + 1]) for g in fixes[run]])
        size = float(np.abs(segment.innovation[scalars]).max())
        start, stop = when[run[[0, -1]]].tolist()
        findings.append(
            warning(
                "sensor-doubtful",
                f"GPS positions up to {size:.0f} m off were refused from t = {start:.1f} to {stop:.1f} s.",
                "Look at satellites and HDOP there; a mast and distance from power cables help.",
                sensor="gps_position",
                start=start,
                stop=stop,
                size_m=size,
                fixes=int(run.size),
            )
        )
    return findings


def _outage(start: float, stop: float, position: float, velocity: float, *, lost: bool) -> Finding:
    """Report a time without GPS positions, with the largest horizontal 1-sigmas in it, m and m/s."""
    known = f"there the horizontal position is known to {position:.3g} m, velocity to {velocity:.2g} m/s (1-sigma)"
    silence = f"No GPS position for {stop - start:.0f} s from t = {start:.1f} s"
    return Finding(
        "position-unknown",
        Severity.ERROR if lost and position > POSITION_KNOWN else Severity.WARNING,
        f"{silence} to the end of the record: {known} at worst."
        if lost
        else f"{silence}; the smoother bridges it: {known} at worst.",
        "Look at the receiver, its cable and its supply; rely on what was flown before." if lost else "",
        {"start": start, "stop": stop, "position_sigma_m": position, "velocity_sigma_mps": velocity},
    )
