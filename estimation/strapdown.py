"""From IMU-rate tables to a smoothed trajectory."""

from dataclasses import asdict, dataclass, replace
from datetime import datetime
from itertools import pairwise

import numpy as np
import pandas as pd

from estimation.alignment import Alignment, align, with_priors
from estimation.consistency import innovation_statistics
from estimation.filter import ForwardPass, Problem, World, assemble, run
from estimation.local_frame import LocalFrame, is_simulated
from estimation.magnetic_field import world_field
from estimation.observations import Observations, observe, usable_field, usable_fixes
from estimation.smoother import Smoothed, smooth
from estimation.states import SENSOR_ERROR_COLUMNS, SensorNoise
from estimation.timing import ACCEL, GYRO, InertialSignal, imu_delays, sample_rate, segments, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.tuning import WINDOW, Tuned, relinearised, tune
from logparse import Finding, Geodetic, MissingDataError, Severity, Tables

#: Segments of the log shorter than this are left out, s.
SHORTEST_SEGMENT = 2.0
#: Gravity where the place is not known: the mean of the globe, m/s^2.
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class _Segment:
    """A stretch of the log without holes in its IMU, and where it starts."""

    signal: InertialSignal
    aligned: Alignment

    @property
    def length(self) -> float:
        return self.signal.stop - self.signal.start


@dataclass(frozen=True, slots=True)
class _Estimate:
    """What came of a segment, at times t."""

    segment: _Segment
    t: np.ndarray
    problem: Problem
    result: ForwardPass
    smoothed: Smoothed


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

    pieces = segments(imu)
    found = [
        _Segment(
            InertialSignal.of(piece, tables.parameters, (noise.gyro, noise.accel)),
            align(tables, piece, frame, field.ned if field else None, noise),
        )
        for piece in pieces
        if piece.index[-1] - piece.index[0] >= SHORTEST_SEGMENT and len(piece) >= 10
    ]
    if not found:
        raise MissingDataError(
            f"the log has no {SHORTEST_SEGMENT:g} s of IMU samples without a hole: it is too short, or the logger lost "
            "most of it (see DSF.Dp; a faster card or a smaller LOG_BITMASK helps)"
        )
    longest = max(found, key=lambda segment: segment.length)
    tuned = tune(longest.signal, observations, longest.aligned.x, longest.aligned.P, world, noise)
    observations = tuned.in_time(observations)
    done = []
    for segment in found:
        begin = max(segment.signal.start, -np.inf if start is None else start)
        end = min(segment.signal.stop, np.inf if stop is None else stop)
        t = np.arange(np.ceil(begin * rate), np.floor(end * rate) + 1) / rate
        if t.size:
            done.append(_estimate(segment, t, observations, world, tuned))
    if not done:
        raise ValueError(f"the log has no IMU samples between start = {start} and stop = {stop} s")
    gyro_delay, accel_delay = imu_delays(tables.parameters)
    diagnostics: dict[str, object] = {
        "innovations": innovation_statistics([e.problem for e in done], [e.result for e in done]),
        "log_likelihood": sum(e.result.log_likelihood for e in done),
        "segments": [(float(e.t[0]), float(e.t[-1])) for e in done],
        "aligned_still": [e.segment.aligned.still for e in done],
        "yaw_source": [e.segment.aligned.yaw_source for e in done],
        "imu_rate": sample_rate(imu),
        "gyro_delay": gyro_delay,
        "accel_delay": accel_delay,
        "lags": dict(tuned.lags),
        "noise": asdict(tuned.noise),
        "imu_noise_scale": tuple(tuned.imu_scale.tolist()),
        "declination": float(np.arctan2(field.ned[1], field.ned[0])) if field else float("nan"),
        "declination_source": field.declination_source if field else "none",
    }
    findings = _missing(tables, fixes, mag) + _holes(pieces)
    states, sigma = _frames(done)
    return Trajectory(
        states=states,
        sigma=sigma,
        covariance=np.concatenate([e.smoothed.covariance for e in done]),
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


def _estimate(segment: _Segment, t: np.ndarray, observations: Observations, world: World, tuned: Tuned) -> _Estimate:
    """Filter and smooth one segment; a first run over its beginning finds the attitude to linearise about."""
    P = with_priors(segment.aligned.P, tuned.noise)
    signal = segment.signal

    def lay_out(outputs: np.ndarray, x: np.ndarray, stop: float) -> Problem:
        return assemble(
            signal,
            observations,
            outputs,
            x,
            P,
            world,
            tuned.noise,
            white_scale=tuned.white_scale,
            imu_scale=tuned.imu_scale,
            stop=stop,
        )

    first = lay_out(np.array([signal.start]), segment.aligned.x, signal.start + WINDOW)
    problem = lay_out(t, relinearised(first, run(first)), np.inf)
    result = run(problem)
    return _Estimate(segment, t, problem, result, smooth(problem, result))


def _frames(done: list[_Estimate]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Lay the segments' estimates out as the tables of a `Trajectory`."""
    index = pd.Index(np.concatenate([e.t for e in done]), name="t")
    x = np.concatenate([e.smoothed.x for e in done])
    rates = np.concatenate([e.segment.signal.rate(e.t) for e in done]) - x[:, 10:13]
    forces = np.concatenate([e.segment.signal.force(e.t) for e in done]) - x[:, 13:16]
    slow = np.concatenate([e.smoothed.slow_variance for e in done])
    fast = np.concatenate([np.diagonal(e.smoothed.covariance, axis1=1, axis2=2) for e in done])
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
