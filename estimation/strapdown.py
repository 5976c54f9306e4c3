"""From IMU-rate tables to a smoothed trajectory."""

from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise

import numpy as np
import pandas as pd

from estimation.alignment import Alignment, align
from estimation.consistency import innovation_statistics
from estimation.filter import ForwardPass, Problem, World, assemble, run
from estimation.local_frame import LocalFrame, is_simulated
from estimation.magnetic_field import world_field
from estimation.observations import Observations, observe, usable_field, usable_fixes
from estimation.smoother import Smoothed, smooth
from estimation.states import SENSOR_ERROR_COLUMNS, SensorNoise
from estimation.timing import ACCEL, GYRO, InertialSignal, imu_delays, sample_rate, segments, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.tuning import Tuned, tune
from logparse import Finding, Geodetic, Severity, Tables

#: Segments of the log shorter than this are left out, s.
SHORTEST_SEGMENT = 2.0
#: Gravity where the place is not known: the mean of the globe, m/s^2.
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class _Segment:
    problem: Problem
    result: ForwardPass
    smoothed: Smoothed
    signal: InertialSignal
    t: np.ndarray
    aligned: Alignment
    tuned: Tuned


def estimate_strapdown(
    tables: Tables,
    *,
    rate: float,
    start: float | None,
    stop: float | None,
    date: datetime | None,
    noise: SensorNoise,
) -> Trajectory:
    """Filter and smooth every segment of the IMU; parameters as in `estimation.estimate`."""
    imu = usable(tables.imu, GYRO + ACCEL)
    assert imu is not None  # the caller chose this path because the IMU is there
    fixes = usable_fixes(tables.gps)
    origin = find_origin(tables, fixes)
    frame = None
    field = None
    if origin is not None:
        frame = LocalFrame.at(origin, spherical=is_simulated(tables.parameters))
        field = world_field(origin, tables.parameters, date)
    mag = usable_field(tables.mag)
    world = World(
        gravity=frame.gravity if frame else STANDARD_GRAVITY,
        earth_rate=frame.earth_rate if frame else np.zeros(3),
    )
    if field is None:
        tables = replace(tables, mag=None)
    observations = observe(tables, frame, noise)

    findings = _missing(tables, fixes, mag)
    done: list[_Segment] = []
    pieces = segments(imu)
    for piece in pieces:
        if piece.index[-1] - piece.index[0] < SHORTEST_SEGMENT or len(piece) < 10:
            continue
        aligned = align(tables, piece, frame, field.ned if field else None, noise)
        segment = _estimate_segment(tables, piece, observations, rate, start, stop, aligned, world, noise)
        if segment is not None:
            done.append(segment)
    findings += _holes(pieces)
    if not done:
        # Nothing inside the span asked for: the caller's span is wrong, not the log.
        raise ValueError(f"no IMU data of {SHORTEST_SEGMENT:g} s or more between start={start} and stop={stop}")
    statistics = innovation_statistics([s.problem for s in done], [s.result for s in done])
    gyro_delay, accel_delay = imu_delays(tables.parameters)
    diagnostics: dict[str, object] = {
        "innovations": statistics,
        "log_likelihood": sum(s.result.log_likelihood for s in done),
        "segments": [(float(s.t[0]), float(s.t[-1])) for s in done],
        "imu_rate": sample_rate(imu),
        "gyro_delay": gyro_delay,
        "accel_delay": accel_delay,
        "aligned_still": [s.aligned.still for s in done],
        "yaw_source": [s.aligned.yaw_source for s in done],
        "lags": [dict(s.tuned.lags) for s in done],
        "gyro_bias_walk": [s.tuned.noise.gyro_bias_walk for s in done],
        "hard_iron_walk": [s.tuned.noise.hard_iron_walk for s in done],
        "gps_error_time": [s.tuned.noise.gps_error_time for s in done],
        "declination": float(np.arctan2(field.ned[1], field.ned[0])) if field else float("nan"),
        "declination_source": field.declination_source if field else "none",
    }
    states, sigma = _frames(done)
    return Trajectory(
        states=states,
        sigma=sigma,
        covariance=np.concatenate([s.smoothed.covariance for s in done]),
        origin=origin or Geodetic(float("nan"), float("nan"), 0.0),
        method="strapdown",
        diagnostics=diagnostics,
        findings=tuple(findings),
    )


def find_origin(tables: Tables, fixes: pd.DataFrame | None) -> Geodetic | None:
    """Give the autopilot's origin where logged, else the first good fix, else None."""
    if tables.origin is not None:
        return tables.origin
    if fixes is None:
        return None
    first = fixes.iloc[0]
    return Geodetic(float(first["lat"]), float(first["lon"]), float(first["alt"]))


def _estimate_segment(
    tables: Tables,
    imu: pd.DataFrame,
    observations: Observations,
    rate: float,
    start: float | None,
    stop: float | None,
    aligned: Alignment,
    world: World,
    noise: SensorNoise,
) -> _Segment | None:
    signal = InertialSignal.of(imu, tables.parameters, (noise.gyro, noise.accel))
    begin = max(signal.start, -np.inf if start is None else start)
    end = min(signal.stop, np.inf if stop is None else stop)
    t = np.arange(np.ceil(begin * rate), np.floor(end * rate) + 1) / rate
    if t.size == 0:
        return None
    tuned = tune(signal, observations, aligned.x, aligned.P, world, noise)
    problem = assemble(
        signal, tuned.observations, t, tuned.x, aligned.P, world, tuned.noise, white_scale=tuned.white_scale
    )
    result = run(problem)
    return _Segment(problem, result, smooth(problem, result), signal, t, aligned, tuned)


def _frames(done: list[_Segment]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Lay the segments' estimates out as the tables of a `Trajectory`."""
    index = pd.Index(np.concatenate([s.t for s in done]), name="t")
    x = np.concatenate([s.smoothed.x for s in done])
    rates = np.concatenate([s.signal.rate(s.t) for s in done]) - x[:, 10:13]
    forces = np.concatenate([s.signal.force(s.t) for s in done]) - x[:, 13:16]
    slow = np.concatenate([s.smoothed.slow_variance for s in done])
    fast = np.concatenate([np.diagonal(s.smoothed.covariance, axis1=1, axis2=2) for s in done])
    # A sensor that is not there has no error to estimate.
    there = np.count_nonzero(slow, axis=0) > 0
    errors = [name for name, some in zip(SENSOR_ERROR_COLUMNS, there, strict=True) if some]
    states = np.column_stack([x[:, :10], rates, forces, x[:, 10:][:, there]])
    sigma = np.sqrt(np.maximum(np.column_stack([fast, slow[:, there]]), 0.0))
    return (
        pd.DataFrame(states, index=index, columns=[*STATE_COLUMNS, *errors]),
        pd.DataFrame(sigma, index=index, columns=[*SIGMA_COLUMNS, *errors]),
    )


def _missing(tables: Tables, fixes: pd.DataFrame | None, mag: pd.DataFrame | None) -> list[Finding]:
    """Say which sensors are not there."""
    findings = []
    if fixes is None:
        findings.append(
            Finding(
                "no-gps",
                Severity.ERROR,
                "No usable GPS fix: horizontal position and velocity drift freely and their sigmas grow accordingly.",
                "Set LOG_BITMASK to include GPS and wait for a 3-D fix before take-off.",
            )
        )
    if mag is None:
        findings.append(
            Finding(
                "no-magnetometer",
                Severity.WARNING,
                "No magnetometer: heading is known only from the movement of the craft, if it moves.",
                "Set LOG_BITMASK to include COMPASS.",
            )
        )
    if usable(tables.baro, ["alt"]) is None:
        findings.append(
            Finding(
                "no-baro",
                Severity.INFO,
                "No barometer: height rests on GPS alone.",
                "Set LOG_BITMASK to include the sensors (CTUN, BARO).",
            )
        )
    return findings


def _holes(pieces: list[pd.DataFrame]) -> list[Finding]:
    """Say where the IMU has holes."""
    return [
        Finding(
            "imu-hole",
            Severity.WARNING,
            f"No IMU samples for {after.index[0] - before.index[-1]:.1f} s from t = {before.index[-1]:.1f} s; "
            "the trajectory has no rows there.",
            "Check that the logger keeps up (DSF.Dp) and LOG_DISARMED.",
            {"start": float(before.index[-1]), "stop": float(after.index[0])},
        )
        for before, after in pairwise(pieces)
    ]
