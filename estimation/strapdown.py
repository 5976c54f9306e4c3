"""From IMU-rate tables to a smoothed trajectory."""

from dataclasses import asdict, dataclass, replace
from datetime import datetime

import numpy as np
import pandas as pd

from estimation import _kernels
from estimation.alignment import Alignment, align, turned, with_priors
from estimation.consistency import innovation_statistics
from estimation.filter import ForwardPass, Problem, World, assemble, run
from estimation.findings import gps_troubles, imu_holes, missing_sensors, other_imu
from estimation.local_frame import LocalFrame, is_simulated
from estimation.magnetic_field import MagneticField, world_field
from estimation.observations import Observations, find_origin, observe, usable_field, usable_fixes
from estimation.smoother import Smoothed, smooth
from estimation.states import SENSOR_ERROR_COLUMNS, SensorNoise
from estimation.timing import ACCEL, GYRO, InertialSignal, imu_delays, sample_rate, segments, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.tuning import DECISIVE, WINDOW, Tuned, relinearised, tune
from logparse import Geodetic, MissingDataError, Tables

#: Segments of the log shorter than this are left out, s.
SHORTEST_SEGMENT = 2.0
FEWEST_SAMPLES = 10
#: An IMU logged slower than this cannot carry attitude from sample to sample, Hz: at the 10 Hz of telemetry, movement
#: and vibration alias so far that the autopilot's own attitude is the better guide.
SLOWEST_IMU = 15.0
#: Headings that are tried where nothing tells the heading.
HEADINGS = 8
#: Gravity where the place is not known: the mean of the globe, m/s^2.
STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class _Surroundings:
    """Where the log was flown, as far as it is known."""

    origin: Geodetic | None
    frame: LocalFrame | None
    field: MagneticField | None
    world: World


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
    place = _surroundings(tables, date)
    mag = usable_field(tables.mag) is not None
    if place.field is None:
        tables = replace(tables, mag=None)
    observations = observe(tables, place.frame, noise)
    imus = [imu for imu in _imus(tables) if imu is not None]
    candidates = [_segments(tables, imu, place, observations, noise) for imu in imus]
    chosen, gain = _likeliest_imu(candidates, observations, place.world, noise)
    found = candidates[chosen]
    if not found:
        raise MissingDataError(
            f"the log has no {SHORTEST_SEGMENT:g} s of IMU samples without a hole: it is too short, or the logger lost "
            "most of it (see DSF.Dp; a faster card or a smaller LOG_BITMASK helps)"
        )
    longest = max(found, key=lambda segment: segment.length)
    tuned = tune(longest.signal, observations, longest.aligned.x, longest.aligned.P, place.world, noise)
    observations = tuned.in_time(observations)
    done = []
    for segment in found:
        begin = max(segment.signal.start, -np.inf if start is None else start)
        end = min(segment.signal.stop, np.inf if stop is None else stop)
        t = np.arange(np.ceil(begin * rate), np.floor(end * rate) + 1) / rate
        if t.size:
            done.append(_estimate(segment, t, observations, place.world, tuned))
    if not done:
        raise ValueError(f"the log has no IMU samples between start = {start} and stop = {stop} s")
    findings = missing_sensors(
        gps=usable_fixes(tables.gps) is not None, mag=mag, baro=usable(tables.baro, ["alt"]) is not None
    )
    findings += imu_holes(segments(imus[chosen])) + other_imu(chosen, gain)
    for estimate in done:
        findings += gps_troubles(estimate.problem, estimate.result)
    states, sigma = _frames(done)
    return Trajectory(
        states=states,
        sigma=sigma,
        covariance=np.concatenate([e.smoothed.covariance for e in done]),
        origin=place.origin or Geodetic(float("nan"), float("nan"), 0.0),
        method="strapdown",
        diagnostics={"imu": chosen, "imu_rate": sample_rate(imus[chosen]), **_diagnostics(tables, done, place, tuned)},
        findings=tuple(findings),
    )


def _surroundings(tables: Tables, date: datetime | None) -> _Surroundings:
    """Find the origin and what the world is like there."""
    origin = find_origin(tables)
    if origin is None:
        return _Surroundings(None, None, None, World(STANDARD_GRAVITY, np.zeros(3)))
    frame = LocalFrame.at(origin, spherical=is_simulated(tables.parameters))
    field = world_field(origin, tables.parameters, date)
    return _Surroundings(origin, frame, field, World(frame.gravity, frame.earth_rate))


def _imus(tables: Tables) -> list[pd.DataFrame | None]:
    """Give the usable rows of every IMU that is logged fast enough, the first one first."""
    others = [usable(imu, GYRO + ACCEL) for imu in tables.further.get("imu", ())]
    return [usable(tables.imu, GYRO + ACCEL), *(imu for imu in others if sample_rate(imu) >= SLOWEST_IMU)]


def _segments(
    tables: Tables, imu: pd.DataFrame, place: _Surroundings, observations: Observations, noise: SensorNoise
) -> list[_Segment]:
    """Split one IMU at its holes and align each piece."""
    found = []
    for piece in segments(imu):
        if piece.index[-1] - piece.index[0] < SHORTEST_SEGMENT or len(piece) < FEWEST_SAMPLES:
            continue
        signal = InertialSignal.of(piece, tables.parameters, (noise.gyro, noise.accel))
        aligned = align(tables, piece, place.frame, place.field.ned if place.field else None, noise)
        if aligned.yaw_source == "unknown" and place.frame is not None:
            aligned = _heading_from_movement(signal, aligned, observations, place.world, noise)
        found.append(_Segment(signal, aligned))
    return found


def _heading_from_movement(
    signal: InertialSignal, aligned: Alignment, observations: Observations, world: World, noise: SensorNoise
) -> Alignment:
    """Try headings all around and take that under which GPS and IMU agree best."""
    if not np.any(observations.between(signal.start, signal.stop).kind == _kernels.GPS_VELOCITY):
        return aligned
    step = 2.0 * np.pi / HEADINGS
    tries = [turned(aligned, k * step, 0.5 * step) for k in range(HEADINGS)]
    return max(tries, key=lambda start: _fit(_Segment(signal, start), observations, world, noise))


def _fit(segment: _Segment, observations: Observations, world: World, noise: SensorNoise) -> float:
    """Give the log-likelihood of a segment's beginning with everything as documented."""
    signal, aligned = segment.signal, segment.aligned
    outputs = np.array([signal.start])
    stop = signal.start + WINDOW
    problem = assemble(signal, observations, outputs, aligned.x, aligned.P, world, noise, stop=stop)
    return run(problem, keep=False).log_likelihood


def _likeliest_imu(
    candidates: list[list[_Segment]], observations: Observations, world: World, noise: SensorNoise
) -> tuple[int, float]:
    """Choose the IMU that agrees best with the other sensors, and by how much; the first unless decisively worse."""
    spans = [max(found, key=lambda segment: segment.length) if found else None for found in candidates]
    if len(candidates) == 1 or spans[0] is None:
        return 0, 0.0
    # The same measurements for all, or the likelihoods would not compare.
    common = [span for span in spans if span is not None]
    seen = observations.between(max(s.signal.start for s in common) + 0.1, min(s.signal.stop for s in common) - 0.1)
    fits = [-np.inf if span is None else _fit(span, seen, world, noise) for span in spans]
    best = int(np.argmax(fits))
    gain = fits[best] - fits[0]
    return (best, gain) if gain > DECISIVE else (0, 0.0)


def _diagnostics(tables: Tables, done: list[_Estimate], place: _Surroundings, tuned: Tuned) -> dict[str, object]:
    """Say what the filter found of itself and of the sensors."""
    gyro_delay, accel_delay = imu_delays(tables.parameters)
    field = place.field
    return {
        "innovations": innovation_statistics([e.problem for e in done], [e.result for e in done]),
        "log_likelihood": sum(e.result.log_likelihood for e in done),
        "segments": [(float(e.t[0]), float(e.t[-1])) for e in done],
        "aligned_still": [e.segment.aligned.still for e in done],
        "yaw_source": [e.segment.aligned.yaw_source for e in done],
        "gyro_delay": gyro_delay,
        "accel_delay": accel_delay,
        "lags": dict(tuned.lags),
        "noise": asdict(tuned.noise),
        "imu_noise_scale": tuple(tuned.imu_scale.tolist()),
        "declination": float(np.arctan2(field.ned[1], field.ned[0])) if field else float("nan"),
        "declination_source": field.declination_source if field else "none",
    }


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
