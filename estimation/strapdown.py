"""From IMU-rate tables to a smoothed trajectory."""

from dataclasses import asdict, dataclass, replace
from datetime import datetime

import numpy as np
import pandas as pd

from estimation.alignment import Alignment, carried_over, with_priors
from estimation.consistency import innovation_statistics
from estimation.filter import ForwardPass, Problem, World, assemble, run
from estimation.findings import gps_troubles, imu_holes, missing_sensors, other_imu
from estimation.observations import Observations, observe, usable_field, usable_fixes
from estimation.segmentation import SHORTEST_SEGMENT, Segment, find_segments
from estimation.smoother import Estimates, filtered, smooth
from estimation.states import SENSOR_ERROR_COLUMNS, SensorNoise
from estimation.surroundings import Surroundings
from estimation.timing import imu_delays, sample_rate, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.tuning import WINDOW, Tuned, relinearised, tune
from logparse import Geodetic, MissingDataError, Tables

#: What a segment learned of the sensors' errors serves the next one after a hole no longer than this, s.
LONGEST_MEMORY = 600.0


@dataclass(frozen=True, slots=True)
class _Estimated:
    """What came of a segment, at times t."""

    segment: Segment
    t: np.ndarray
    problem: Problem
    result: ForwardPass
    estimates: Estimates


def estimate_strapdown(
    tables: Tables,
    *,
    rate: float,
    start: float | None,
    stop: float | None,
    date: datetime | None,
    noise: SensorNoise,
    smoothed: bool,
) -> Trajectory:
    """Filter and smooth every segment of the IMU; parameters as in `estimation.estimate`."""
    place = Surroundings.of(tables, date)
    mag = usable_field(tables.mag) is not None
    if place.field is None:
        tables = replace(tables, mag=None)
    observations = observe(tables, place.frame, noise)
    found = find_segments(tables, place, observations, noise)
    if not found:
        raise MissingDataError(
            f"the log has no {SHORTEST_SEGMENT:g} s of IMU samples without a hole: it is too short, or the logger lost "
            "most of it (see DSF.Dp; a faster card or a smaller LOG_BITMASK helps)"
        )
    longest = max(found, key=lambda segment: segment.length)
    tuned = tune(longest.signal, observations, longest.aligned.x, longest.aligned.P, place.world, noise)
    observations = tuned.in_time(observations)
    span = (-np.inf if start is None else start, np.inf if stop is None else stop)
    done = [e for e in _estimate_all(found, span, rate, observations, place.world, tuned, smoothed) if e.t.size]
    if not done:
        raise ValueError(f"the log has no IMU samples between start = {start} and stop = {stop} s")
    findings = missing_sensors(
        gps=usable_fixes(tables.gps) is not None, mag=mag, baro=usable(tables.baro, ["alt"]) is not None
    )
    findings += imu_holes([segment.samples for segment in found])
    for segment in found:
        findings += other_imu(segment.imu, segment.gain, segment.samples)
    for estimated in done:
        findings += gps_troubles(estimated.problem, estimated.result)
    states, sigma = _frames(done)
    return Trajectory(
        states=states,
        sigma=sigma,
        covariance=np.concatenate([e.estimates.covariance for e in done]),
        origin=place.origin or Geodetic(float("nan"), float("nan"), 0.0),
        method="strapdown",
        diagnostics=_diagnostics(tables, done, place, tuned),
        findings=tuple(findings),
    )


def _diagnostics(tables: Tables, done: list[_Estimated], place: Surroundings, tuned: Tuned) -> dict[str, object]:
    """Say what the filter found of itself and of the sensors."""
    gyro_delay, accel_delay = imu_delays(tables.parameters)
    field = place.field
    return {
        "imu": [e.segment.imu for e in done],
        "imu_rate": sample_rate(max((e.segment for e in done), key=lambda segment: segment.length).samples),
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


def _estimate_all(
    found: list[Segment],
    span: tuple[float, float],
    rate: float,
    observations: Observations,
    world: World,
    tuned: Tuned,
    smoothed: bool,
) -> list[_Estimated]:
    """Estimate segment after segment, each starting with what the one before learned of the sensors."""
    done: list[_Estimated] = []
    for segment in found:
        signal = segment.signal
        begin, end = max(signal.start, span[0]), min(signal.stop, span[1])
        t = np.arange(np.ceil(begin * rate), np.floor(end * rate) + 1) / rate
        aligned = replace(segment.aligned, P=with_priors(segment.aligned.P, tuned.noise))
        if done and (gap := max(signal.start - done[-1].segment.signal.stop, 0.0)) < LONGEST_MEMORY:
            same = segment.imu == done[-1].segment.imu
            aligned = carried_over(aligned, done[-1].result, gap, tuned.noise, same_imu=same)
        done.append(_estimate(segment, aligned, t, observations, world, tuned, smoothed))
    return done


def _estimate(
    segment: Segment,
    aligned: Alignment,
    t: np.ndarray,
    observations: Observations,
    world: World,
    tuned: Tuned,
    smoothed: bool,
) -> _Estimated:
    """Estimate one segment; before smoothing, a run over its beginning finds the attitude to linearise about."""
    signal = segment.signal

    def lay_out(outputs: np.ndarray, x: np.ndarray, stop: float) -> Problem:
        return assemble(
            signal,
            observations,
            outputs,
            x,
            aligned.P,
            world,
            tuned.noise,
            white_scale=tuned.white_scale,
            imu_scale=tuned.imu_scale,
            stop=stop,
        )

    if not smoothed:
        problem = lay_out(t, aligned.x, np.inf)
        result = run(problem)
        return _Estimated(segment, t, problem, result, filtered(result))
    first = lay_out(np.array([signal.start]), aligned.x, signal.start + WINDOW)
    problem = lay_out(t, relinearised(first, run(first)), np.inf)
    result = run(problem)
    return _Estimated(segment, t, problem, result, smooth(problem, result))


def _frames(done: list[_Estimated]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Lay the segments' estimates out as the tables of a `Trajectory`."""
    index = pd.Index(np.concatenate([e.t for e in done]), name="t")
    x = np.concatenate([e.estimates.x for e in done])
    rates = np.concatenate([e.segment.signal.rate(e.t) for e in done]) - x[:, 10:13]
    forces = np.concatenate([e.segment.signal.force(e.t) for e in done]) - x[:, 13:16]
    slow = np.concatenate([e.estimates.slow_variance for e in done])
    fast = np.concatenate([np.diagonal(e.estimates.covariance, axis1=1, axis2=2) for e in done])
    # A sensor that is not there has no error to estimate.
    there = np.count_nonzero(slow, axis=0) > 0
    errors = [name for name, some in zip(SENSOR_ERROR_COLUMNS, there, strict=True) if some]
    states = np.column_stack([x[:, :10], rates, forces, x[:, 10:][:, there]])
    sigma = np.sqrt(np.maximum(np.column_stack([fast, slow[:, there]]), 0.0))
    return (
        pd.DataFrame(states, index=index, columns=[*STATE_COLUMNS, *errors]),
        pd.DataFrame(sigma, index=index, columns=[*SIGMA_COLUMNS, *errors]),
    )
