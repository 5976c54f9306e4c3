"""Records of chirps, and of ordinary flights, in which pilot, mission or angle loop asked something of the axes.

What asks for lift from outside the loop is the pilot's throttle stick, or the target of the height. The acceleration
target and the throttle that the height controller puts out answer the wind as well: as instruments they made the gain
of a firmware craft in 5 m/s of wind twice too large. ``CTUN.ThI`` is such an output since firmware 3.4, ``ThrIn``
before was the stick.

Without the vertical acceleration among the rates its axis goes from the throttle output to what the accelerometer
feels: throttle is logged ten times a second whatever LOG_BITMASK says, and no GPS is needed. What is felt along the
thrust is thrust per mass less drag, whatever the lean; thrust that leans is compensated in the throttle output itself.
Motor outputs stand for the throttle where they come faster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd

from core.runs import runs
from core.units import quantity
from logparse import FlightLog
from logparse.canonical.control import throttle_output
from sysid.frequency.axes import AXES, HEIGHT_TARGET, PILOTS_THROTTLE, Axis, FrequencyError
from sysid.frequency.excitation import Chirp
from sysid.frequency.rate_signals import LogSignals, RateSignals, motor_patterns, step_of
from sysid.frequency.records import (
    ORDINARY_BAND,
    AxisRecord,
    Logged,
    below,
    lost_one_by_one,
    on_uniform_clock,
    refuse_scattered,
)
from sysid.frequency.response import Floats
from sysid.records.resampling import FASTER

#: Ratio of frequencies that a chirp passes within a hole from which on they are missing.
_SKIPPED = 1.15

#: Variance of what a kick counts for, per part of the rows that is lost one by one: 1 for its own row, twice 0.6
#: squared for its neighbours.
_KICK_VARIANCE = 1.7

#: Shortest flight [s], and the time [s] after take-off and before landing that is left out.
SHORTEST_FLIGHT, _TAKEOFF = 10.0, 1.0

#: Output below which an axis stands still: a ten-thousandth of full.
_STILL = 1e-4

#: Standard deviation of ln |G| of what AutoTune's twitches show, and up to which part of the rate of the rows: beyond,
#: their corners fold (on quad15 they were 5 to 10 % below its chirps up to there, and 25 % at 0.4 of that rate).
_OF_TWITCHES, _TWITCHES_TO = 0.08, 0.15

#: Standard deviation of the stick [1] and of the rate of climb asked [m/s] or height asked [m] below which nothing was.
_STICK, _CLIMB, _HEIGHT = 0.01, 0.05, 0.2


def chirp_record(
    log: FlightLog, signals: RateSignals, axis: Axis, chirp: Chirp, beside: Sequence[Axis] = ()
) -> AxisRecord:
    """Cut the record of one chirp: the axis' controller output, its answer, and the chirp as instrument.

    With the outputs of the axes `beside`, what each command does is told apart; into those that the chirp is not of
    nothing was injected. FrequencyError when the log lacks the signals within the chirp.
    """
    chirp = chirp.below_folding(signals.t)
    rows = signals.within(chirp.start, chirp.stop)
    t = signals.t[rows]
    if len(t) < 16:
        raise FrequencyError(f"{log.path.name}: no RATE or PID rows within the chirp at {chirp.start:.1f} s")
    axes = (*beside, axis)
    _require(log, signals, axis, rows, (*(axis.input for axis in axes), axis.output))
    commands = []
    for input_axis in axes:
        late = chirp.at_mixer and not signals.with_chirp and chirp.axis == input_axis.name
        commands.append(signals.columns[input_axis.input][rows] + (chirp.added(t) if late else 0.0))
    shares = [float(not beside or chirp.axis == axis.name) for axis in axes]
    answer = signals.columns[axis.output][rows]
    record = record_of_chirp(log, chirp, t, commands, answer, lambda at: np.outer(chirp.added(at), shares))
    return replace(record, source=signals.source)


def record_of_chirp(
    log: FlightLog,
    chirp: Chirp,
    t: Floats,
    commands: Sequence[Logged],
    answer: Logged,
    added: Callable[[Floats], Floats],
) -> AxisRecord:
    """Arrange what went in and came out within a chirp, at times t [s], with what the chirp added, (N, inputs).

    The instrument is not taken from the same rows: where some are lost, what that adds to command and answer, at all
    frequencies, must not be in it.
    """
    clock, values, usable = on_uniform_clock(t, [*commands, answer])
    refuse_scattered(log, lost_one_by_one(t, float(clock[1] - clock[0])))
    hz = np.interp(clock, chirp.t, chirp.hz)
    holes = [(float(hz[a]), float(hz[b - 1])) for a, b in runs(~usable)]
    return AxisRecord(
        name=f"{log.path.name} [{chirp.start:.1f}-{chirp.stop:.1f} s]",
        start=float(clock[0]),
        dt=float(clock[1] - clock[0]),
        inputs=values[:, :-1],
        output=values[:, -1],
        instruments=added(clock),
        usable=usable,
        band=(chirp.low, chirp.high),
        instrument=f"chirp of SID_AXIS {chirp.sid_axis}",
        unswept=tuple((low, high) for low, high in holes if high > _SKIPPED * low > 0.0),
    )


def _require(log: FlightLog, signals: RateSignals, axis: Axis, rows: slice, names: Sequence[str]) -> None:
    """Refuse a stretch in which signals are missing."""
    missing = [name for name in names if not signals.knows(name, rows)]
    if missing:
        raise FrequencyError(f"{log.path.name}: the log has no {' and no '.join(missing)} for the {axis.name} axis")


def flight_span(source: LogSignals, first: float, last: float) -> tuple[float, float]:
    """Return when a flight counts: in the air, without take-off and landing; all of a log that never tells.

    Of a stretch within the flight nothing is left out at an end that is neither take-off nor landing.
    """
    flight = source.log.flight
    start, stop = (flight.start, flight.stop) if flight is not None else (first, last)
    start, stop = start + _TAKEOFF, stop - _TAKEOFF
    if source.within is not None:
        start, stop = max(start, source.within[0]), min(stop, source.within[1])
    if not np.isfinite([start, stop]).all() or stop - start < SHORTEST_FLIGHT - 2.0 * _TAKEOFF:
        raise FrequencyError(
            f"{source.log.path.name}: {max(stop - start + 2.0 * _TAKEOFF, 0.0):.1f} s in the air; "
            f"{SHORTEST_FLIGHT:.0f} s are needed"
        )
    return start, stop


def flight_record(source: LogSignals, signals: RateSignals, axis: Axis) -> AxisRecord:
    """Cut the record of an ordinary flight: the attitude target, which comes from outside the loop, is the instrument.

    Without it the rate target is, of which a part comes from the angle loop; and in AutoTune, which turns the craft by
    it past the attitude target.
    """
    log = source.log
    start, stop = flight_span(source, float(signals.t[0]), float(signals.t[-1]))
    rows = signals.within(start, stop)
    t = signals.t[rows]
    _require(log, signals, axis, rows, (axis.input, axis.output))
    twitched = _twitched(log, axis, start, stop)
    target = None if twitched else _outside_target(log, axis, float(t[0]), float(t[-1]))
    beside: list[str] = []
    name = ""
    if target is not None:
        name = target[2]
    elif signals.knows(axis.reference, rows):
        beside, name = [axis.reference], "rate target"
    others = _other_outputs(axis, signals, rows) if stop - start >= 40.0 else []
    # It does not come from the rows that may be lost, as in `record_of_chirp`.
    outside = [] if target is None else [partial(at_rows, target)]
    clock, values, usable = signals.evenly([axis.input, axis.output, *others, *beside], start, stop, *outside)
    lost = lost_one_by_one(t, float(clock[1] - clock[0]))
    refuse_scattered(log, lost)
    command, conditions = values[:, 0], values[:, 2 : 2 + len(others)]
    asked = values[:, -1] if outside or beside else command
    if outside and axis.attitude and np.std(asked) < 0.004:
        # The rate target moves all the same, with the disturbances that the angle loop answers: no instrument.
        raise FrequencyError(
            f"{log.path.name}: the {axis.name} target hardly moved, nothing was asked of this axis; fly a chirp, "
            "or a minute of short stick inputs on it"
        )
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
        band=(ORDINARY_BAND[0], _TWITCHES_TO / float(clock[1] - clock[0])) if twitched else ORDINARY_BAND,
        instrument=name,
        source=signals.source,
        common=float(np.hypot(_of_lost_rows(lost, command), _OF_TWITCHES if twitched else 0.0)),
    )


def _twitched(log: FlightLog, axis: Axis, start: float, stop: float) -> bool:
    """Return whether AutoTune turned a craft in a time span [s]."""
    modes = log.tables.modes
    if modes is None or not axis.attitude:
        return False
    first, last = np.searchsorted(modes.index.to_numpy(np.float64), [start, stop])
    return bool((modes["mode"].iloc[max(int(first) - 1, 0) : int(last)] == "AUTOTUNE").any())


def _of_lost_rows(lost: float, command: Logged) -> float:
    """Return the common error of a response whose command comes in kicks, of which some rows are missing.

    A kick as short as a row counts for nothing where its row is lost, and for about 1.6 times as much where its
    neighbour is, which the spline makes of it; on an average over all kicks that is nothing, but kicks are few.
    """
    moved = command - np.mean(command, dtype=np.float64)
    squared = moved**2
    kicks = float(np.sum(squared) ** 2 / max(np.sum(squared**2), 1e-300))
    return float(np.sqrt(_KICK_VARIANCE * min(lost, 1.0) / max(kicks, 1.0)))


def _other_outputs(axis: Axis, signals: RateSignals, rows: slice) -> list[str]:
    """Return which outputs of the other axes of rotation move, so that what they do does not count as the axis's."""
    if not axis.attitude:
        return []
    outputs = []
    for other in AXES.values():
        values = signals.columns.get(other.input)
        if other.name == axis.name or not other.attitude or values is None:
            continue
        if np.isfinite(values[rows]).all() and np.std(values[rows]) > _STILL:
            outputs.append(other.input)
    return outputs


def _outside_target(log: FlightLog, axis: Axis, first: float, last: float) -> tuple[Floats, Floats, str] | None:
    """Return times, values and name of what asked an axis from outside its loop; None without an attitude target."""
    if not axis.attitude:
        return lift_asked(log, first, last)
    target = log.tables.column("setpoints", axis.attitude)
    if target is None:
        return None
    values = target.to_numpy(np.float64)
    known = np.isfinite(values)
    if np.count_nonzero(known) < 16:
        return None
    return target.index.to_numpy(np.float64)[known], np.unwrap(values[known]), f"{axis.name} target"


def at_rows(target: tuple[Floats, Floats, str], t: Floats) -> Floats:
    """Interpolate a target at the times of evenly spaced rows."""
    times, wanted, _ = target
    # What the target has above half of the rows' rate would fold onto what of the outputs folds.
    smooth = below(times, wanted[:, None], t, float(t[1] - t[0]))[:, 0]
    beyond = ~np.isfinite(smooth)
    smooth[beyond] = np.interp(t[beyond], times, wanted)
    return smooth


def lift_asked(log: FlightLog, start: float, stop: float) -> tuple[Floats, Floats, str]:
    """Return times, values and name of what asked for lift from start to stop [s], positive upwards."""
    known = []
    for t, values, name, least in (*_sticks(log), *_heights(log)):
        finite = np.isfinite(values)
        inside = finite & (t >= start) & (t <= stop)
        if np.count_nonzero(inside) < 16:
            continue
        moved = float(np.std(values[inside]))
        if moved > least:
            # A stick that moves so much is what asks, whatever else moves.
            known.append((moved > 0.03 or name == HEIGHT_TARGET, t[finite], values[finite], name))
    if not known:
        raise FrequencyError(
            f"{log.path.name}: the pilot's throttle hardly moved, nor did the target of the height; climb and sink by "
            "short movements of the throttle for a minute"
        )
    _, t, values, name = next((source for source in known if source[0]), known[0])
    return t, values, name


def _sticks(log: FlightLog) -> Iterator[tuple[Floats, Floats, str, float]]:
    channel = int(log.parameters_flown.get("RCMAP_THROTTLE", 3.0))
    if "RCIN" in log.messages:
        frame = log.messages["RCIN"]
        column = next((name for name in (f"C{channel}", f"Ch{channel}", f"Chan{channel}") if name in frame), None)
        if column is not None:
            yield frame.index.to_numpy(np.float64), 1e-3 * frame[column].to_numpy(np.float64), PILOTS_THROTTLE, _STICK
    if "CTUN" in log.messages and "ThrIn" in log.messages["CTUN"]:
        frame = log.messages["CTUN"]
        values = quantity(frame, "ThrIn", "")
        span = max(float(np.nanmax(np.abs(values), initial=0.0)), 1e-9)
        yield frame.index.to_numpy(np.float64), values / span, PILOTS_THROTTLE, _STICK


def _heights(log: FlightLog) -> Iterator[tuple[Floats, Floats, str, float]]:
    for column, least in (("v_d_ref", _CLIMB), ("p_d", _HEIGHT)):
        target = log.tables.column("setpoints", column)
        if target is not None:
            t, values = target.index.to_numpy(np.float64), np.negative(target.to_numpy(np.float64))
            yield t, values, HEIGHT_TARGET, least


#: Fewest rows of throttle that are a record.
_FEWEST_OF_THROTTLE = 64


def throttle_record(source: LogSignals) -> AxisRecord:
    """Cut the record of a flight: throttle output, specific force along the thrust, and what asked for lift.

    What is faster than the throttle's rows is taken below half of their rate, so that vibration does not fold.
    """
    log, name, imu = source.log, source.log.path.name, source.log.tables.imu
    if imu is None or len(imu) < _FEWEST_OF_THROTTLE:
        raise FrequencyError(f"{name}: no RATE, and no throttle (CTUN) with an accelerometer (IMU) in its place")
    output, what = _lifting(log, imu)
    start, stop = flight_span(source, float(output.index[0]), float(output.index[-1]))
    times = output.index.to_numpy(np.float64)
    step = float(np.median(np.diff(times)))
    rows = times[(times >= start) & (times <= stop)]
    rows = rows[np.concatenate([[True], np.diff(rows) > 0.0])]
    if len(rows) < _FEWEST_OF_THROTTLE:
        raise FrequencyError(f"{name}: too few rows of throttle in the air")
    asked_t, asked, instrument = lift_asked(log, start, stop)
    felt = below(imu.index.to_numpy(np.float64), -imu[["accel_z"]].to_numpy(np.float64), rows, step)[:, 0]
    columns = [np.interp(rows, times, output.to_numpy(np.float64)), felt, at_rows((asked_t, asked, instrument), rows)]
    clock, values, usable = on_uniform_clock(rows, columns)
    turning = values[:, 0] > 0.02
    if np.count_nonzero(turning) < _FEWEST_OF_THROTTLE:
        raise FrequencyError(f"{name}: the throttle output is zero in the air")
    return AxisRecord(
        name=f"{name} [{clock[0]:.1f}-{clock[-1]:.1f} s]",
        start=float(clock[0]),
        dt=float(clock[1] - clock[0]),
        inputs=values[:, :1],
        output=values[:, 1],
        instruments=values[:, 2:],
        usable=usable & turning,
        band=ORDINARY_BAND,
        instrument=instrument,
        source=what,
        trim=float(np.median(values[turning, 1]) / np.median(values[turning, 0])),
    )


def _lifting(log: FlightLog, imu: pd.DataFrame) -> tuple[pd.Series, str]:
    """Return what lifted the craft, and what it is where it is not the throttle output."""
    throttle, motors = throttle_output(log.intact, log.vehicle), motor_patterns(log)
    sources = [] if throttle is None else [(throttle["throttle"].dropna(), "")]
    sources += [(thrust.dropna(), "") for thrust in log.tables.columns("rates", ["out_thrust"])]
    sources += [] if motors is None else [(motors["out_thrust"].dropna(), "motor outputs to accelerometer")]
    sources = [source for source in sources if len(source[0]) >= _FEWEST_OF_THROTTLE]
    if not sources:
        raise FrequencyError(f"{log.path.name}: no {_FEWEST_OF_THROTTLE} rows of throttle (CTUN) or motor outputs")
    felt = step_of(imu)
    steps = [max(step_of(source[0]), felt) for source in sources]
    return sources[-1] if steps[-1] * FASTER <= steps[0] else sources[0]
