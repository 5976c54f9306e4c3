"""Inputs, outputs and instruments of a flight's axes on one uniform clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from logparse import FlightLog
from logparse.cubic_spline import cubic_spline
from logparse.log_settings import Need, bit_to_set
from logparse.tables import COLUMNS
from logparse.units import quantity
from sysid.frequency.antialias import below
from sysid.frequency.axes import AXES, Axis, FrequencyError
from sysid.frequency.excitation import Chirp, Within
from sysid.frequency.lift_asked import lift_asked
from sysid.frequency.response import Complex, Floats
from sysid.records.experiment import Experiment

#: Samples farther apart than this many usual steps leave a hole that is bridged, but not counted.
_HOLE = 2.5

#: Gaps between rows, in usual ones, up to which rows are missing one by one; variance of what a kick counts for, per
#: part of the rows that is lost: 1 for its own row, twice 0.6 squared for its neighbours.
_SCATTERED, _KICK_VARIANCE = 10.0, 1.7

#: Part of the rows beyond which those lost one by one leave no response: with a third lost, gains that looked good were
#: up to 29 % off.
_MOST_LOST = 0.2

#: Ratio of frequencies that a chirp passes within a hole from which on they are missing.
_SKIPPED = 1.15

#: A record of more than this many times the length of its samples is no record; damaged times may span years.
_EMPTY = 20.0

#: Frequencies [Hz] that are looked at where nobody says what was swept; the coherence tells which count.
ORDINARY_BAND = (0.15, 60.0)

#: Time [s] before and after what is needed of the rate controllers that tells of air and battery there.
_AROUND = 30.0

#: Shortest flight [s], and the time [s] after take-off and before landing that is left out.
_SHORTEST_FLIGHT, _TAKEOFF = 10.0, 1.0

#: Output below which an axis stands still: a ten-thousandth of full.
_STILL = 1e-4

#: Standard deviation of an attitude target [rad] below which nothing was asked of an axis.
_ASKED = 0.004

#: Shortest flight [s] in which the outputs of the other axes can be told apart from that of the axis.
_CONDITIONED = 40.0

#: Names of inputs and outputs of an axis in experiments.
_NAMES = {
    "roll": (("roll", "out_roll", "u_roll"), ("w_x", "p", "gyro_x", "rate")),
    "pitch": (("pitch", "out_pitch", "u_pitch"), ("w_y", "q", "gyro_y", "rate")),
    "yaw": (("yaw", "out_yaw", "u_yaw"), ("w_z", "r", "gyro_z", "rate")),
    "vertical": (("thrust", "throttle", "out_thrust"), ("a_up", "acceleration")),
}


#: Samples in single or double precision.
Logged = NDArray[np.float32] | Floats


@dataclass(frozen=True, slots=True, eq=False)
class AxisRecord:
    """Signals of one stretch of a flight on a uniform clock."""

    name: str  #: Which log and which stretch.
    #: First sample and step, s.
    start: float
    dt: float
    inputs: Floats  #: shape (N, m)
    output: Floats  #: shape (N,)
    instruments: Floats  #: shape (N, m): One for each input; the inputs themselves where nothing was injected.
    usable: NDArray[np.bool_]  #: shape (N,): False in holes of the log.
    band: tuple[float, float]  #: Frequencies that were excited, Hz.
    instrument: str  #: What the instruments are; empty where they are the inputs.
    #: Whether the output is the central difference of what was measured. An integrator remembers everything before a
    #: window, which bends its response at fewer than some twenty cycles per window; its derivative remembers nothing.
    differenced: bool = False
    #: Output per input in steady flight, where both are known as they are (thrust, throttle).
    trim: float | None = None
    source: str = ""  #: What the signals are, where they are not the rate controller's.
    #: Frequencies [Hz], from and to, that a chirp swept while nothing was logged: what leaks there from others is none.
    unswept: tuple[tuple[float, float], ...] = ()
    #: Standard deviation of ln abs(G), common to all frequencies, from rows that are missing one by one.
    common: float = 0.0

    @property
    def duration(self) -> float:
        """Return the length, s."""
        return (len(self.output) - 1) * self.dt

    def alone(self) -> AxisRecord:
        """Return the record without the inputs of other axes."""
        return replace(self, inputs=self.inputs[:, :1], instruments=self.instruments[:, :1])

    def difference(self) -> AxisRecord:
        """Return the record with the central difference of its output, one sample shorter at both ends."""
        inner = slice(1, -1)
        return replace(
            self,
            start=self.start + self.dt,
            inputs=self.inputs[inner],
            output=(self.output[2:] - self.output[:-2]) / (2.0 * self.dt),
            instruments=self.instruments[inner],
            usable=self.usable[2:] & self.usable[1:-1] & self.usable[:-2],
            differenced=True,
        )

    def remainders(self) -> Callable[[Callable[[Floats], Complex]], AxisRecord]:
        """Return what takes the answer of a model to the first input out of the record, for one model after another.

        Models map frequencies above zero, Hz, to the response of what was measured, before any difference.
        """
        size = scipy.fft.next_fast_len(2 * len(self.output))
        hz = np.fft.rfftfreq(size, self.dt).astype(np.float64)
        spectrum = np.fft.rfft(self.inputs[:, 0] - np.mean(self.inputs[:, 0]), size)
        if self.differenced:
            spectrum *= self.difference_response(hz)
        spectrum[0] = 0.0

        def without(model: Callable[[Floats], Complex]) -> AxisRecord:
            answer = spectrum.copy()
            answer[1:] *= model(hz[1:])
            return replace(self, output=self.output - np.fft.irfft(answer, size)[: len(self.output)])

        return without

    def difference_response(self, hz: Floats) -> Complex:
        """Return the frequency response of the central difference, shape (F,)."""
        return np.asarray(1j * np.sin(2.0 * np.pi * hz * self.dt) / self.dt)


@dataclass(frozen=True, slots=True, eq=False)
class RateSignals:
    """What the rate controllers of a log said: their outputs, what they measured and what they wanted."""

    t: Floats  #: shape (N,): Times of validity (of the gyro sample), s.
    columns: dict[str, Logged]  #: dict of str to ndarray, shape (N,): By name, as in `Axis`.
    with_chirp: bool  #: Whether the outputs contain a chirp added at the mixer; RATE's do, sums of PID terms do not.
    source: str = ""  #: What they are, where they are not the controllers' own.

    @property
    def step(self) -> float:
        """Return the usual step, s."""
        return float(np.median(np.diff(self.t)))


def rate_signals(log: FlightLog, within: Within | None = None) -> RateSignals:
    """Read the rate controllers of a log: RATE, or the PID messages where it has none.

    Parameters
    ----------
    log : FlightLog
        The log.
    within : (float, float), optional
        Stretch of time that is needed, s.

    Raises
    ------
    FrequencyError
        Without either.
    """
    t = log.tables.times("rates")
    if t is None or len(t) < 16:
        raise FrequencyError(
            f"{log.path.name}: no RATE or PID messages; {bit_to_set(Need.FAST_RATES, log)}, "
            "and fly one minute of short stick inputs on each axis"
        )
    rows = slice(None)
    if within is not None:
        rows = slice(*np.searchsorted(t, (within[0] - _AROUND, within[1] + _AROUND)))
    columns = log.tables.columns("rates", tuple(COLUMNS["rates"]))
    known = {str(each.name): _as_logged(each.to_numpy()[rows]) for each in columns}
    return RateSignals(t[rows], known, "RATE" in log.messages)


def _as_logged(values: Logged) -> Logged:
    """Return values in single precision, as the fast loop is logged: all in double are the largest thing in memory."""
    return values.astype(np.float32)


def with_vertical(log: FlightLog, signals: RateSignals) -> RateSignals:
    """Return the rate controllers with that of the vertical acceleration, where they are those of RATE."""
    if not signals.with_chirp:
        return signals
    # Not kept: of a long log it would be the largest thing in memory.
    frame = log.messages.once("RATE", ("A", "ADes"))
    times = frame.index.to_numpy(np.float64)
    order = np.argsort(times, kind="stable")
    columns = dict(signals.columns)
    for name, source in (("a_up", "A"), ("a_up_ref", "ADes")):
        if source in frame:
            columns[name] = _as_logged(np.interp(signals.t, times[order], quantity(frame, source, "cm/s/s")[order]))
    return replace(signals, columns=columns)


def chirp_signal(log: FlightLog, t: Floats, chirp: Chirp) -> Floats:
    """Interpolate a chirp as it was added at the times `t`; zero outside it.

    Parameters
    ----------
    log : FlightLog
        A log with SIDD messages.
    t : ndarray, shape (N,)
        s.
    chirp : Chirp
        Which of its chirps.

    Returns
    -------
    ndarray, shape (N,)
        In the unit of `Tables.systemid`.
    """
    table = log.tables.systemid
    assert table is not None
    times = table.index.to_numpy(np.float64)
    inside = (times >= chirp.start) & (times <= chirp.stop)
    return np.asarray(np.interp(t, times[inside], table["target"].to_numpy(np.float64)[inside], 0.0, 0.0))


def below_folding(log: FlightLog, chirp: Chirp, step: float) -> Chirp:
    """Cut a chirp to the time in which it sweeps what rows `step` [s] apart can show; above, it folds onto the rest.

    Parameters
    ----------
    log : FlightLog
        A log with SIDD messages.
    chirp : Chirp
        Which of its chirps.
    step : float
        Time between rows, s.
    """
    table = log.tables.systemid
    assert table is not None
    times = table.index.to_numpy(np.float64)
    hz = table["frequency"].to_numpy(np.float64) / (2.0 * np.pi)
    shown = times[(times >= chirp.start) & (times <= chirp.stop) & (hz <= 0.5 / step)]
    if chirp.high <= 0.5 / step or len(shown) < 8:
        return chirp
    return replace(chirp, start=float(shown[0]), stop=float(shown[-1]), high=0.5 / step)


def record_of_chirp(
    log: FlightLog, chirp: Chirp, t: Floats, command: Logged, answer: Logged, added: Callable[[Floats], Floats]
) -> AxisRecord:
    """Arrange what went in and came out within a chirp, at times t [s], with what the chirp added as instrument.

    The instrument is not taken from the same rows: where some are lost, what that adds to command and answer, at all
    frequencies, must not be in it.

    Parameters
    ----------
    log : FlightLog
        A log with SIDD messages.
    chirp : Chirp
        Which of its chirps.
    t : ndarray, shape (N,)
        Times within the chirp, s.
    command, answer : ndarray, shape (N,)
        Input and output at these times.
    added : callable
        Returns what the chirp added at times, s.
    """
    _refuse_scattered(log, t)
    clock, values, usable = on_uniform_clock(t, [command, answer])
    table = log.tables.systemid
    assert table is not None
    hz = np.interp(clock, table.index.to_numpy(np.float64), table["frequency"].to_numpy(np.float64) / (2.0 * np.pi))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], ~usable, [False]]).astype(int)))
    holes = [(float(hz[a]), float(hz[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return AxisRecord(
        name=f"{log.path.name} [{chirp.start:.1f}-{chirp.stop:.1f} s]",
        start=float(clock[0]),
        dt=float(clock[1] - clock[0]),
        inputs=values[:, :1],
        output=values[:, 1],
        instruments=added(clock)[:, None],
        usable=usable,
        band=(chirp.low, chirp.high),
        instrument=f"chirp of SID_AXIS {chirp.sid_axis}",
        unswept=tuple((low, high) for low, high in holes if high > _SKIPPED * low > 0.0),
    )


def on_uniform_clock(t: Floats, columns: Sequence[Logged]) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Bring samples that are nearly even in time onto an even clock by cubic splines.

    All columns pass through the same interpolation, which therefore cancels in their ratio.

    Returns
    -------
    clock : ndarray, shape (N,)
    values : ndarray, shape (N, len(columns))
    usable : ndarray of bool, shape (N,)
        False in holes, which are bridged by straight lines.
    """
    values = np.column_stack(columns).astype(np.float64, copy=False)
    known = np.logical_and.reduce([np.isfinite(column) for column in columns])
    if not known.all():
        t, values = t[known], values[known]
    if len(t) < 8:
        raise FrequencyError(f"only {len(t)} of {len(columns[0])} samples are numbers: fly and log it again")
    step = float(np.median(np.diff(t)))
    if t[-1] - t[0] > _EMPTY * step * len(t):
        raise FrequencyError(f"{len(t)} samples over {t[-1] - t[0]:.0f} s are no record: it is nearly all holes")
    clock = t[0] + step * np.arange(int((t[-1] - t[0]) / step + 1e-6) + 1)
    holes = np.diff(t) > _HOLE * step
    right = np.clip(np.searchsorted(t, clock), 1, len(t) - 1)
    usable = ~holes[right - 1]
    if holes.any():
        between = [np.interp(clock, t, column) for column in values.T]
        bridged_t = np.union1d(t, clock[~usable])
        bridged = np.column_stack([np.interp(bridged_t, t, column) for column in values.T])
        smooth = cubic_spline(bridged_t, bridged, clock)
        result = np.where(usable[:, None], smooth, np.column_stack(between))
    else:
        result = cubic_spline(t, values, clock)
    return clock, np.asarray(result, dtype=np.float64), usable


def chirp_record(log: FlightLog, signals: RateSignals, axis: Axis, chirp: Chirp) -> AxisRecord:
    """Cut the record of one chirp: the axis' controller output, its answer, and the chirp as instrument.

    Parameters
    ----------
    log : FlightLog
        The log.
    signals : RateSignals
        Of the log's rate controllers.
    axis : Axis
        The axis, which need not be that of the chirp.
    chirp : Chirp
        Which of the log's chirps.

    Raises
    ------
    FrequencyError
        When the log lacks the signals of the axis within the chirp.
    """
    chirp = below_folding(log, chirp, signals.step)
    rows = (signals.t >= chirp.start) & (signals.t <= chirp.stop)
    t = signals.t[rows]
    if len(t) < 16:
        raise FrequencyError(f"{log.path.name}: no RATE or PID rows within the chirp at {chirp.start:.1f} s")
    missing = [n for n in (axis.input, axis.output) if n not in signals.columns]
    if missing:
        raise FrequencyError(f"{log.path.name}: the log has no {' and no '.join(missing)} for the {axis.name} axis")
    command = signals.columns[axis.input][rows]
    if chirp.at_mixer and not signals.with_chirp and chirp.axis == axis.name:
        command = command + chirp_signal(log, t, chirp)
    answer = signals.columns[axis.output][rows]
    record = record_of_chirp(log, chirp, t, command, answer, lambda at: chirp_signal(log, at, chirp))
    return replace(record, source=signals.source)


def flight_span(log: FlightLog, first: float, last: float, within: Within | None = None) -> tuple[float, float]:
    """Return when a flight counts: in the air, without take-off and landing; all of a log that never tells.

    Of a stretch `within` the flight nothing is left out at an end that is neither take-off nor landing.

    Parameters
    ----------
    log : FlightLog
        The log.
    first, last : float
        Times of the first and last row, s, for a log that tells of no flight.
    within : (float, float), optional
        Stretch of time to use, s.

    Returns
    -------
    (float, float)
        s.

    Raises
    ------
    FrequencyError
        When that is shorter than ten seconds.
    """
    flight = log.flight
    start, stop = (flight.start, flight.stop) if flight is not None else (first, last)
    start, stop = start + _TAKEOFF, stop - _TAKEOFF
    if within is not None:
        start, stop = max(start, within[0]), min(stop, within[1])
    if not np.isfinite([start, stop]).all() or stop - start < _SHORTEST_FLIGHT - 2.0 * _TAKEOFF:
        raise FrequencyError(
            f"{log.path.name}: {max(stop - start + 2.0 * _TAKEOFF, 0.0):.1f} s in the air; "
            f"{_SHORTEST_FLIGHT:.0f} s are needed"
        )
    return start, stop


def flight_record(log: FlightLog, signals: RateSignals, axis: Axis, within: Within | None = None) -> AxisRecord:
    """Cut the record of an ordinary flight: the attitude target, which comes from outside the loop, is the instrument.

    Without it the rate target is, of which a part comes from the angle loop.

    Parameters
    ----------
    log : FlightLog
        The log.
    signals : RateSignals
        Of the log's rate controllers.
    axis : Axis
        The axis.
    within : (float, float), optional
        Stretch of time to use, s.

    Raises
    ------
    FrequencyError
        Without a flight, or without the signals of the axis in it.
    """
    start, stop = flight_span(log, float(signals.t[0]), float(signals.t[-1]), within)
    rows = slice(np.searchsorted(signals.t, start), np.searchsorted(signals.t, stop, side="right"))
    t = signals.t[rows]
    wanted = [name for name in (axis.input, axis.output, axis.reference) if name in signals.columns]
    known = {name: signals.columns[name][rows] for name in wanted}
    missing = [n for n in (axis.input, axis.output) if n not in known or not np.isfinite(known[n]).sum() > 16]
    if missing:
        raise FrequencyError(f"{log.path.name}: the log has no {' and no '.join(missing)} of the {axis.name} axis")
    target = _outside_target(log, axis, float(t[0]), float(t[-1]))
    beside: list[Logged] = []
    name = ""
    if target is not None:
        name = target[2]
    elif axis.reference in known and np.isfinite(known[axis.reference]).sum() > 16:
        beside, name = [known[axis.reference]], "rate target"
    _refuse_scattered(log, t)
    others = _other_outputs(axis, signals, rows) if stop - start >= _CONDITIONED else []
    clock, values, usable = on_uniform_clock(t, [known[axis.input], known[axis.output], *others, *beside])
    command, conditions = values[:, 0], values[:, 2 : 2 + len(others)]
    if target is not None:
        # It does not come from the rows that may be lost, as in `record_of_chirp`.
        asked = _at_rows(*target[:2], clock)
        if axis.attitude and np.std(asked) < _ASKED:
            # The rate target moves all the same, with the disturbances that the angle loop answers: no instrument.
            raise FrequencyError(
                f"{log.path.name}: the {axis.name} target hardly moved, nothing was asked of this axis; fly a chirp, "
                "or a minute of short stick inputs on it"
            )
    else:
        asked = values[:, -1] if beside else command
    if np.std(command) < _STILL or np.std(asked) == 0.0:
        raise FrequencyError(f"{log.path.name}: nothing moved the {axis.name} axis; give it short stick inputs")
    return AxisRecord(
        name=f"{log.path.name} [{clock[0]:.1f}-{clock[-1]:.1f} s]",
        start=float(clock[0]),
        dt=float(clock[1] - clock[0]),
        inputs=np.column_stack([command, conditions]),
        output=values[:, 1].copy(),
        instruments=np.column_stack([asked, conditions]),
        usable=usable,
        band=ORDINARY_BAND,
        instrument=name,
        source=signals.source,
        common=_of_lost_rows(t, command),
    )


def _lost_one_by_one(t: Floats) -> float:
    """Return how many rows are missing one by one for each that is there."""
    steps = np.diff(t) / float(np.median(np.diff(t)))
    return float(np.sum(np.rint(steps[(steps > 1.5) & (steps < _SCATTERED)]) - 1.0)) / len(t)


def _refuse_scattered(log: FlightLog, t: Floats) -> None:
    """Refuse rows of which too many are missing one by one.

    Raises
    ------
    FrequencyError
        With the part that is missing.
    """
    lost = _lost_one_by_one(t) if len(t) > 1 else 0.0
    if lost > _MOST_LOST * (1.0 + lost):
        raise FrequencyError(
            f"{log.path.name}: {100.0 * lost / (1.0 + lost):.0f} % of the rows are lost one by one, and what is left "
            "misleads; use a faster card, or log fewer messages (LOG_BITMASK)"
        )


def _of_lost_rows(t: Floats, command: Floats) -> float:
    """Return the common error of a response whose command comes in kicks, of which some rows are missing.

    A kick as short as a row counts for nothing where its row is lost, and for about 1.6 times as much where its
    neighbour is, which the spline makes of it; on an average over all kicks that is nothing, but kicks are few.
    """
    lost = _lost_one_by_one(t)
    moved = command - np.mean(command)
    squared = moved**2
    kicks = float(np.sum(squared) ** 2 / max(np.sum(squared**2), 1e-300))
    return float(np.sqrt(_KICK_VARIANCE * min(lost, 1.0) / max(kicks, 1.0)))


def _other_outputs(axis: Axis, signals: RateSignals, rows: slice) -> list[Logged]:
    """Return the outputs of the other axes of rotation that move, so that what they do does not count as the axis's."""
    if not axis.attitude:
        return []
    found = []
    for other in AXES.values():
        values = signals.columns.get(other.input)
        if other.name == axis.name or not other.attitude or values is None:
            continue
        if np.isfinite(values[rows]).all() and np.std(values[rows]) > _STILL:
            found.append(values[rows])
    return found


def _outside_target(log: FlightLog, axis: Axis, first: float, last: float) -> tuple[Floats, Floats, str] | None:
    """Return times, values and name of what asked an axis from outside its loop; None without an attitude target.

    Raises
    ------
    FrequencyError
        When nothing asked for lift.
    """
    if not axis.attitude:
        return lift_asked(log, first, last)
    table = log.tables.setpoints
    if table is None or axis.attitude not in table:
        return None
    values = table[axis.attitude].to_numpy(np.float64)
    known = np.isfinite(values)
    if np.count_nonzero(known) < 16:
        return None
    return table.index.to_numpy(np.float64)[known], np.unwrap(values[known]), f"{axis.name} target"


def _at_rows(times: Floats, wanted: Floats, t: Floats) -> Floats:
    """Interpolate a target at the times of rows."""
    smooth = below(times, wanted[:, None], t, float(np.median(np.diff(t))))[:, 0]
    # What the target has above half of the rows' rate would fold onto what of the outputs folds.
    return np.asarray(np.where(np.isfinite(smooth), smooth, np.interp(t, times, wanted)))


def experiment_record(experiment: Experiment, axis: Axis) -> AxisRecord:
    """Read the signals of an axis from an experiment; its only input and output, where it has one of each.

    Inputs are found by the name of the axis (``roll``, ``out_roll``; ``thrust`` or ``throttle`` for the vertical one),
    outputs by theirs (``w_x``, ``p``; ``a_up``) or among the rates of the experiment's context. An input named
    ``chirp`` or ``instrument`` is the instrument.

    Raises
    ------
    FrequencyError
        When there is no such signal.
    """
    names_u, names_y = _NAMES[axis.name]
    instruments = [k for k, name in enumerate(experiment.input_names) if name in ("chirp", "instrument")]
    driving = [k for k in range(experiment.u.shape[1]) if k not in instruments]
    column = next((k for k in driving if experiment.input_names[k] in names_u), None)
    if column is None and len(driving) == 1:
        column = driving[0]
    output = next((k for k, name in enumerate(experiment.output_names) if name in names_y), None)
    if output is not None:
        y = experiment.y[:, output]
    elif experiment.context is not None and axis.output in experiment.context:
        y = experiment.context[axis.output].to_numpy(np.float64)
    elif experiment.y.shape[1] == 1:
        y = experiment.y[:, 0]
    else:
        y = np.full(len(experiment.t), np.nan)
    if column is None or not np.isfinite(y).all():
        raise FrequencyError(
            f"{experiment.name} has no signals of the {axis.name} axis: inputs {', '.join(experiment.input_names)}, "
            f"outputs {', '.join(experiment.output_names)}; wanted are {names_u[0]} and {names_y[0]}"
        )
    u = experiment.u[:, column]
    z = experiment.u[:, instruments[0]] if instruments else u
    return AxisRecord(
        name=experiment.name,
        start=float(experiment.t[0]),
        dt=experiment.dt,
        inputs=u[:, None],
        output=y,
        instruments=z[:, None],
        usable=np.ones(len(u), dtype=bool),
        band=ORDINARY_BAND,
        instrument=experiment.input_names[instruments[0]] if instruments else "",
    )
