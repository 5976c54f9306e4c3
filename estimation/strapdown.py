"""From IMU-rate tables to a smoothed trajectory."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from functools import partial
from itertools import pairwise

import numpy as np
import pandas as pd

from estimation import _kernels
from estimation._kernels import Estimates
from estimation.alignment import Alignment, carried_over, with_priors
from estimation.compass import CompassTurn, compass_finding, compass_turn
from estimation.consistency import innovation_statistics
from estimation.filter import Filtered, FilterSegment, assemble, new_memory, run, ticks
from estimation.observations import Observations, observe, usable_field, usable_fixes
from estimation.outages import outages, variance_growth, widen
from estimation.place import World
from estimation.segmentation import SHORTEST_SEGMENT, Segment, Surroundings, find_segments
from estimation.shocks import Shocks
from estimation.smoother import PASSES, admit, between_rows, fill_in, filtered, new_adjoint, smooth_piece
from estimation.states import SENSOR_ERROR_COLUMNS, SIZE, SensorNoise
from estimation.timing import TICK, TURNING, InertialSignal, imu_delays, sample_rate, usable
from estimation.trajectory import SIGMA_COLUMNS, STATE_COLUMNS, Trajectory
from estimation.trust import (
    LATE,
    contradicted_receiver,
    doubtful_sensors,
    doubtful_settings,
    gps_troubles,
    impossible_biases,
    imu_holes,
    late_sensors,
    missed_steps,
    missing_sensors,
    only_one_withdrawal,
    other_imu,
    stuck_magnetometer,
)
from estimation.tuning import RELINEARISED, WINDOW, Tuned, is_sought, relinearised, settled, tune, window
from logparse import Finding, Geodetic, MissingDataError, Tables

#: Rows of the trajectory that are smoothed at a time; a multiple of `_kernels.SLOW_EVERY`.
PIECE = 512
#: With fewer fixes the log counts as one without GPS: they tell where it was flown, and nothing of the flight.
FEWEST_FIXES = 10
#: The sensor errors of a segment start the next one after a hole no longer than this, s.
LONGEST_MEMORY = 600.0


@dataclass(frozen=True, slots=True)
class _Rows:
    """Rows of the trajectory at times t; rates and forces as measured, shape (n, 3)."""

    t: np.ndarray
    estimates: Estimates
    rates: np.ndarray
    forces: np.ndarray


@dataclass(frozen=True, slots=True)
class _Estimated:
    """A segment with its filter's record and the rows of the trajectory."""

    segment: Segment
    filtered: Filtered
    rows: _Rows


@dataclass(frozen=True, slots=True)
class _Known:
    """Segments of a log and tuned settings of their sensors."""

    observations: Observations  #: At the times that their tables give.
    segments: list[Segment]
    tuned: Tuned

    @classmethod
    def of(cls, tables: Tables, place: Surroundings, noise: SensorNoise) -> "_Known":
        observations = observe(tables, place.frame, noise)
        segments = find_segments(tables, place, observations, noise)
        if not segments:
            raise MissingDataError(
                f"the log has no {SHORTEST_SEGMENT:g} s of IMU samples without a hole: it is too short, or the logger "
                "lost most of it (a faster card or fewer messages help)"
            )
        longest = _longest(segments)
        tuned = tune(longest.signal, observations, longest.aligned, place.world, noise)
        if max(map(abs, tuned.lags.values()), default=0.0) > LATE:
            # An IMU that agreed better with a sensor of another time was chosen for nothing.
            segments, before = find_segments(tables, place, tuned.in_time(observations), noise), longest.imu
            longest = _longest(segments)
            if longest.imu != before:
                tuned = tune(longest.signal, observations, longest.aligned, place.world, noise)
        segments = [s.rescaled(tuned.yaw_scale) if s.imu == longest.imu else s for s in segments]
        return cls(observations, segments, tuned)


def _longest(segments: list[Segment]) -> Segment:
    return max(segments, key=lambda segment: segment.length)


def _find_turn(known: _Known, tables: Tables, place: Surroundings, noise: SensorNoise) -> CompassTurn | None:
    """Return the turn of the compass where it is certain or doubtful, else None.

    Noise that was tuned with a turned compass is too large. So a suspected turn is estimated again with noise tuned
    without the compass.
    """
    if tables.mag is None or place.field is None:
        return None

    def turn_of(which: _Known, tuned: Tuned) -> CompassTurn | None:
        segment, seen = _longest(which.segments), tuned.in_time(known.observations)
        return compass_turn(segment.signal, seen, segment.aligned, place.world, field, which.tuned, noise)

    field = place.field.ned
    turn = turn_of(known, known.tuned)
    if turn is None or not turn.suspected:
        return None
    free = _Known.of(tables.changed(mag=None), replace(place, compass_useless=True), noise)
    turn = turn_of(free, replace(free.tuned, lags={"mag": known.tuned.lags["mag"], **free.tuned.lags}))
    return turn if turn is not None and (turn.certain or turn.doubtful) else None


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
    """Filter and smooth every segment of the IMU, and join their rows to one trajectory."""
    place = Surroundings.of(tables, date)
    rows, remarks = _estimate_log(tables, place, rate, (start, stop), noise, smoothed=smoothed)
    index = pd.Index(np.concatenate([segment.t for segment in rows]), name="t")
    errors = _sensor_errors(rows)
    states = _states(rows, index, errors)
    # States are as large as the log again, and the estimates that they were made of are needed no longer.
    rows = [
        replace(segment, estimates=segment.estimates._replace(x=np.empty(0)), rates=np.empty(0), forces=np.empty(0))
        for segment in rows
    ]
    sigma = _sigma(rows, index, errors)
    doubts = [*remarks.doubts, *impossible_biases(states)]
    if place.origin is not None:
        doubts += contradicted_receiver(tables, states, place.origin, remarks.gps_lag)
    covariances = [segment.estimates.covariance for segment in rows]
    return Trajectory(
        states=states,
        sigma=sigma,
        # With seven digits of what nobody knows to two: in double precision, errors take more than the states.
        covariance=np.concatenate(covariances, dtype=np.float32),
        origin=place.origin or Geodetic(float("nan"), float("nan"), 0.0),
        method="strapdown",
        diagnostics=remarks.diagnostics,
        findings=(*remarks.findings, *only_one_withdrawal(doubts)),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Remarks:
    """Findings on the sensors and diagnostics of the filter."""

    findings: list[Finding]
    doubts: list[Finding]  #: Of which one may withdraw the trajectory.
    diagnostics: dict[str, object]
    gps_lag: float  #: Beyond that of the tables, s.


def _estimate_log(
    tables: Tables,
    place: Surroundings,
    rate: float,
    span: tuple[float | None, float | None],
    noise: SensorNoise,
    *,
    smoothed: bool,
) -> tuple[list[_Rows], _Remarks]:
    """Estimate every segment of a log.

    Segments and filters, which are as large as the IMU's samples, are released when it returns.
    """
    findings = [stuck_magnetometer()] if place.compass_useless else []
    mag = usable_field(tables.mag) is not None
    tables, known, turn = _prepare(tables, place, noise)
    segments, tuned = known.segments, known.tuned
    observations = tuned.in_time(known.observations)
    done = _estimate_all(segments, span, rate, observations, place.world, noise, tuned, smoothed)
    done = [estimated for estimated in done if estimated.rows.t.size]
    if not done:
        raise ValueError(f"the log has no IMU samples between start = {span[0]} and stop = {span[1]} s")
    fixes = usable_fixes(tables.gps)
    findings += missing_sensors(
        gps=fixes is not None and len(fixes) >= FEWEST_FIXES, mag=mag, baro=usable(tables.baro, ["alt"]) is not None
    )
    findings += imu_holes([segment.samples for segment in segments])
    for segment in segments:
        findings += other_imu(segment.imu, segment.gain, segment.samples)
    for estimated in done:
        findings += gps_troubles(estimated.filtered, estimated.rows.t, estimated.rows.estimates.covariance)
    doubts = [compass_finding(turn)] if turn is not None else []
    doubts += doubtful_sensors(innovation_statistics([e.filtered for e in done]))
    doubts += missed_steps([e.filtered.shocks for e in done], sum(e.segment.length for e in done))
    doubts += late_sensors(tuned.lags)
    doubts += doubtful_settings(tuned.noise, tuned.yaw_scale)
    rows = [estimated.rows for estimated in done]
    if turn is not None:
        for segment_rows in rows:
            segment_rows.estimates.covariance[:, 2, 2, 2] += turn.heading_sigma**2
    diagnostics = _diagnostics(tables, done, place, tuned)
    gps_lag = tuned.lags.get("gps", 0.0)
    return rows, _Remarks(findings=findings, doubts=doubts, diagnostics=diagnostics, gps_lag=gps_lag)


def _prepare(tables: Tables, place: Surroundings, noise: SensorNoise) -> tuple[Tables, _Known, CompassTurn | None]:
    """Find segments and settings of a log; its tables come back with the compass turned right, or without it."""
    if place.field is None or place.compass_useless:
        tables = tables.changed(mag=None)
    known = _Known.of(tables, place, noise)
    turn = _find_turn(known, tables, place, noise)
    if turn is not None and tables.mag is not None and turn.certain and not turn.exchanged:
        tables = tables.changed(mag=turn.corrected(tables.mag))
        known = _Known.of(tables, place, noise)
    return tables, known, turn


def _diagnostics(tables: Tables, done: list[_Estimated], place: Surroundings, tuned: Tuned) -> dict[str, object]:
    """Return the diagnostics of the filter and the sensors."""
    gyro_delay, accel_delay = imu_delays(tables.parameters)
    field = place.field
    return {
        "imu": [e.segment.imu for e in done],
        "imu_rate": sample_rate(max((e.segment for e in done), key=lambda segment: segment.length).samples),
        "innovations": innovation_statistics([e.filtered for e in done]),
        "log_likelihood": sum(e.filtered.log_likelihood for e in done),
        "segments": [(float(e.rows.t[0]), float(e.rows.t[-1])) for e in done],
        "aligned_still": [e.segment.aligned.still for e in done],
        "yaw_source": [e.segment.aligned.yaw_source for e in done],
        "gyro_delay": gyro_delay,
        "accel_delay": accel_delay,
        "lags": dict(tuned.lags),
        "noise": asdict(tuned.noise),
        "imu_noise_scale": tuple(tuned.imu_scale.tolist()),
        "yaw_scale": tuned.yaw_scale,
        "declination": float(np.arctan2(field.ned[1], field.ned[0])) if field else float("nan"),
        "declination_source": field.declination_source if field else "none",
    }


def _estimate_all(
    segments: list[Segment],
    span: tuple[float | None, float | None],
    rate: float,
    observations: Observations,
    world: World,
    noise: SensorNoise,
    tuned: Tuned,
    smoothed: bool,
) -> list[_Estimated]:
    """Estimate segment after segment, each starting with the sensor errors of the one before."""
    done: list[_Estimated] = []
    first, last = (-np.inf if span[0] is None else span[0]), (np.inf if span[1] is None else span[1])
    for segment in segments:
        signal = segment.signal
        begin, end = max(signal.start, first), min(signal.stop, last)
        t = np.arange(np.ceil(begin * rate), np.floor(end * rate) + 1) / rate
        aligned = with_priors(segment.aligned, noise, tuned.noise)
        if done and (gap := max(signal.start - done[-1].segment.signal.stop, 0.0)) < LONGEST_MEMORY:
            same = segment.imu == done[-1].segment.imu
            aligned = carried_over(aligned, done[-1].filtered, gap, tuned.noise, same_imu=same)
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
    """Estimate one segment: smooth it, leave out what disagrees with all the rest, and smooth again until nothing does.

    Before each pass a run over its beginning finds the attitude to linearise about.
    """
    signal = segment.signal
    observations = observations.between(*(ticks(np.array([signal.start, signal.stop])) * TICK))
    pieces = _Pieces(signal, aligned, t, world, tuned)
    x, gate = aligned.x, tuned.noise.gate
    if not smoothed:
        forward, estimates = pieces.filter(observations, x)
    else:
        for _ in range(PASSES):
            x = pieces.relinearise(observations, x)
            forward, estimates = pieces.smooth(observations, x)
            admitted = admit(observations, estimates.deletion, gate)
            shocks = pieces.shocks.widened(estimates.nodes, estimates.shock, estimates.shock_size)
            if np.array_equal(admitted, observations.admitted) and shocks is pieces.shocks:
                break
            observations, pieces.shocks = replace(observations, admitted=admitted), shocks
    moving, _ = window(signal)
    if spans := outages(observations, moving, signal.stop):
        widen(estimates.covariance, t, spans, variance_growth(partial(pieces.nis, x=x), observations, moving))
    rates = np.concatenate([signal.rate(rows) for rows in pieces.rows])
    forces = np.concatenate([signal.force(rows) for rows in pieces.rows])
    if smoothed:
        fill_in(estimates.x)
    return _Estimated(segment, forward, _Rows(t, estimates, rates, forces))


class _Pieces:
    """One segment, filtered and smoothed in pieces.

    The smoother wants the filter's history, which for a long flight is larger than its log. So the segment is filtered
    once without, and then again piece by piece from behind, each from the state that the first pass left before it.
    """

    def __init__(self, signal: InertialSignal, aligned: Alignment, t: np.ndarray, world: World, tuned: Tuned) -> None:
        self.signal, self.aligned, self.t, self.world, self.tuned = signal, aligned, t, world, tuned
        self.moves = bool(signal.beyond(TURNING).any())
        # A piece ends just before the first row of the next one.
        self.spans = list(pairwise([signal.start, *(t[PIECE::PIECE] - TICK).tolist(), signal.stop]))
        self.shocks = Shocks.none()
        self.rows = [t[k * PIECE : (k + 1) * PIECE] for k in range(len(self.spans))]
        # Room for the segment's estimates, which every pass fills anew.
        self.room = Estimates(
            np.empty((len(t), SIZE + 1)),
            np.empty((len(t), 3, 3, 3)),
            np.empty((-(-len(t) // _kernels.SLOW_EVERY), SIZE - _kernels.SLOW)),
            np.empty(0),
            np.empty(0),
            np.empty((0, 2)),
            np.empty((0, 2)),
        )

    def lay_out(
        self, observations: Observations, outputs: np.ndarray, x: np.ndarray, P: np.ndarray, start: float, stop: float
    ) -> FilterSegment:
        """Set up the filter of one piece that starts with x and P."""
        return assemble(
            self.signal,
            observations,
            outputs,
            x,
            P,
            self.world,
            self.tuned.noise,
            white_scale=self.tuned.white_scale,
            imu_scale=self.tuned.imu_scale,
            start=start,
            stop=stop,
            moves=self.moves,
            prior=np.diag(self.aligned.P),
            shocks=self.shocks,
        )

    def relinearise(self, observations: Observations, x: np.ndarray) -> np.ndarray:
        """Return the start with the attitude that its first minutes find, shape (29,)."""
        start, levelled = self.signal.start, self.aligned.levelled
        for _ in range(RELINEARISED if is_sought(self.aligned.P, levelled=levelled) else 1):
            first = self.lay_out(observations, np.array([start]), x, self.aligned.P, start, start + WINDOW)
            before, x = x, relinearised(first, run(first), levelled=levelled)
            if settled(before, x):
                break
        return x

    def filter(self, observations: Observations, x: np.ndarray) -> tuple[Filtered, Estimates]:
        """Filter only: each row knows what was measured before it."""
        forward, _ = self._forward(observations, x, self.room)
        return forward, self.room

    def smooth(self, observations: Observations, x: np.ndarray) -> tuple[Filtered, Estimates]:
        """Filter, then smooth piece by piece from behind."""
        forward, starts = self._forward(observations, x, None)
        adjoint = new_adjoint()
        pieces = []
        for number in range(len(starts) - 1, -1, -1):
            x, P, memory = starts[number]
            problem = self.lay_out(observations, self.rows[number], x, P, *self.spans[number])
            piece = smooth_piece(problem, run(problem, memory=memory), adjoint)
            _insert(piece, self.room, number)
            pieces.append((piece.deletion, piece.nodes, piece.shock, piece.shock_size))
        deletion, nodes, shock, size = (np.concatenate(parts[::-1]) for parts in zip(*pieces, strict=True))
        return forward, self.room._replace(deletion=deletion, nodes=nodes, shock=shock, shock_size=size)

    def nis(self, observations: Observations, x: np.ndarray) -> np.ndarray:
        """Return the normalised innovation squared of each reading, predicted from those before it; shape (s,)."""
        P, memory, squares = self.aligned.P, new_memory(x), []
        for start, stop in self.spans:
            problem = self.lay_out(observations, np.empty(0), x, P, start, stop)
            result = run(problem, keep=False, memory=memory)
            x, P = result.last_state, result.last_covariance
            squares.append(result.innovation**2 / result.variance)
        return np.concatenate(squares)

    def _forward(
        self, observations: Observations, x: np.ndarray, estimates: Estimates | None
    ) -> tuple[Filtered, list[tuple[np.ndarray, np.ndarray, np.ndarray]]]:
        """Filter the pieces one after the other; the second result holds state, covariance and memory at their starts.

        With `estimates` those of the filter are put there, and what lies beyond the gate is refused at once: no
        smoother looks back.
        """
        P, memory = self.aligned.P, new_memory(x)
        innovation, inverse_variance, log_likelihood = [], [], 0.0
        starts: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        for rows, (start, stop) in zip(self.rows, self.spans, strict=True):
            starts.append((x, P, memory.copy()))
            problem = self.lay_out(observations, rows, x, P, start, stop)
            result = run(problem, keep=False, hard=estimates is not None, memory=memory)
            x, P = result.last_state, result.last_covariance
            innovation.append(result.innovation)
            inverse_variance.append(result.inverse_variance)
            log_likelihood += result.log_likelihood
            if estimates is not None:
                _insert(filtered(result), estimates, len(starts) - 1)
        forward = Filtered(
            observations=observations,
            white_scale=self.tuned.white_scale,
            stop=self.signal.stop,
            innovation=np.concatenate(innovation),
            inverse_variance=np.concatenate(inverse_variance),
            log_likelihood=log_likelihood,
            last_state=x,
            last_covariance=P,
            shocks=self.shocks,
        )
        return forward, starts


def _insert(piece: Estimates, whole: Estimates, number: int) -> None:
    """Copy the estimates of one piece into those of the segment."""
    rows = slice(number * PIECE, number * PIECE + len(piece.x))
    whole.x[rows] = piece.x
    whole.covariance[rows] = piece.covariance
    first = number * PIECE // _kernels.SLOW_EVERY
    whole.slow_variance[first : first + len(piece.slow_variance)] = piece.slow_variance


def _sensor_errors(done: list[_Rows]) -> dict[int, str]:
    """Return the sensor errors that were estimated in any segment, by index: a missing sensor has none."""
    known = np.logical_or.reduce([(e.estimates.slow_variance > 0.0).any(axis=0) for e in done])
    return {k: name for k, (name, some) in enumerate(zip(SENSOR_ERROR_COLUMNS, known, strict=True)) if some}


def _states(done: list[_Rows], index: pd.Index, errors: Mapping[int, str]) -> pd.DataFrame:
    """Return the segments' estimates as the states of a `Trajectory`, with the estimated sensor errors."""
    columns = [*STATE_COLUMNS, *errors.values()]
    states = np.empty((len(index), len(columns)))
    first = 0
    for e in done:
        x, rows = e.estimates.x, slice(first, first + len(e.t))
        states[rows, :10] = x[:, :10]
        np.subtract(e.rates, x[:, 10:13], out=states[rows, 10:13])
        np.subtract(e.forces, x[:, 13:16], out=states[rows, 13:16])
        for column, known in enumerate(errors, start=16):
            states[rows, column] = x[:, 10 + known]
        first += len(e.t)
    return pd.DataFrame(states, index=index, columns=columns, copy=False)


def _sigma(done: list[_Rows], index: pd.Index, errors: Mapping[int, str]) -> pd.DataFrame:
    """Return the segments' variances as the standard deviations of a `Trajectory`, as `_states`."""
    columns = [*SIGMA_COLUMNS, *errors.values()]
    sigma = np.empty((len(index), len(columns)), np.float32)
    first = 0
    for e in done:
        rows = slice(first, first + len(e.t))
        sigma[rows, :9] = np.diagonal(e.estimates.covariance, axis1=2, axis2=3).reshape(-1, 9)
        for column, known in enumerate(errors, start=9):
            sigma[rows, column] = between_rows(e.estimates.slow_variance[:, known], len(e.t))
        first += len(e.t)
    np.sqrt(np.maximum(sigma, 0.0, out=sigma), out=sigma)
    return pd.DataFrame(sigma, index=index, columns=columns, copy=False)
