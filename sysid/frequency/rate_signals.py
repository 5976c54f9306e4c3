"""What the rate controllers of a log say, and that of the height: outputs, measurements and targets, as rows.

ArduPilot cuts PWM off to whole microseconds. A closed loop leaves a few of them of a slow chirp, and what is cut off
goes with it: firmware craft seemed to lead by 2 to 5 deg at 0.5 Hz, and by 0 to 2 with what the motors got as input.

Where a log has neither RATE nor the PID messages, or motors and gyros faster, the mixer's patterns of the motor outputs
(RCOU, through the thrust curve) stand for the controller's outputs, and gyros for the rate.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from logparse import FlightLog, GivenLogs, MissingDataError, Vehicle, logs_of
from logparse.craft.log_settings import Need, bit_to_set
from logparse.tables import COLUMNS
from sysid.frequency.axes import Axis, FrequencyError, log_by_log
from sysid.frequency.excitation import Chirp, Within, find_chirps
from sysid.frequency.records import AxisRecord, Logged, below, on_uniform_clock
from sysid.frequency.response import Floats
from sysid.records.mixer import FEWEST, expectation, factors_of, patterns, thrust_commands, voltage_at
from sysid.records.motor_scaling import commands_for, motor_pwm
from sysid.records.resampling import FASTER

#: Time [s] before and after what is needed of the rate controllers that tells of air and battery there.
_AROUND = 30.0


@dataclass(frozen=True, eq=False)
class RateSignals:
    """What the rate controllers of a log said: their outputs, what they measured and what they wanted."""

    t: Floats  #: shape (N,): Times of validity (of the gyro sample), s.
    columns: dict[str, Logged]  #: dict of str to ndarray, shape (N,): By name, as in `Axis`.
    with_chirp: bool  #: Whether the outputs contain a chirp added at the mixer; RATE's do, sums of PID terms do not.
    source: str = ""  #: What they are, where they are not the controllers' own.

    @cached_property
    def step(self) -> float:
        """Return the usual step, s."""
        return float(np.median(np.diff(self.t)))

    def within(self, start: float, stop: float) -> slice:
        """Return which rows lie within a time span."""
        return slice(np.searchsorted(self.t, start), np.searchsorted(self.t, stop, side="right"))

    def knows(self, name: str, rows: slice) -> bool:
        """Return whether a column has values in some rows."""
        return name in self.columns and bool(np.isfinite(self.columns[name][rows]).sum() > 16)

    def evenly(
        self, names: Sequence[str], start: float, stop: float, *further: Callable[[Floats], Floats]
    ) -> tuple[Floats, Logged, NDArray[np.bool_]]:
        """Resample columns of a stretch, and functions of time, to an even clock, as `on_uniform_clock`.

        In the precision in which they are logged.
        """
        rows = self.within(start, stop)
        t, values, usable = on_uniform_clock(self.t[rows], [self.columns[name][rows] for name in names])
        return t, np.column_stack([values, *(at(t).astype(values.dtype) for at in further)]), usable


def rate_signals(
    log: FlightLog, within: Within | None = None, wanted: Collection[str] = tuple(COLUMNS["rates"])
) -> RateSignals:
    """Read what is wanted of the rate controllers of a log: RATE, or the PID messages where it has none."""
    t = log.tables.times("rates")
    if t is None or len(t) < 16:
        raise FrequencyError(
            f"{log.path.name}: no RATE or PID messages; {bit_to_set(Need.FAST_RATES, log)}, "
            "and fly one minute of short stick inputs on each axis"
        )
    rows = slice(None)
    if within is not None:
        rows = slice(*np.searchsorted(t, (within[0] - _AROUND, within[1] + _AROUND)))
    columns = log.tables.columns("rates", wanted)
    # In single precision, as the fast loop is logged: all in double are the largest thing in memory.
    known = {str(column.name): column.to_numpy()[rows].astype(np.float32) for column in columns}
    logged = {name: values for name, values in known.items() if np.isfinite(values).any()}
    return RateSignals(t[rows], logged, "RATE" in log.messages)


#: Outputs by the names of the mixer's patterns.
OUTPUTS = {"thrust": "out_thrust", "roll": "out_roll", "pitch": "out_pitch", "yaw": "out_yaw"}

#: Time [s] over which air and battery stay the same.
_STEADY = 10.0

#: Median distance [us] of outputs from the middle of what would be cut off to them, up to which they are understood;
#: 0.25 where all is understood, half a microsecond where nothing is.
_UNDERSTOOD = 0.35

#: Rows that are worked on at a time.
_PIECE = 1 << 15


def as_motors_got(log: FlightLog, signals: RateSignals) -> RateSignals:
    """Return the controllers' outputs without what was cut off them, where the log's motor outputs can be foretold.

    What the mixer asks of each motor follows from a row of RATE, up to a factor for air and battery that RCOU tells.
    """
    motors, vehicle = log.tables.motors, log.vehicle
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if motors is None or not names or signals.source or not signals.with_chirp:
        return signals
    if not set(names) <= set(motors) or not set(OUTPUTS.values()) <= set(signals.columns):
        return signals
    with suppress(MissingDataError):
        return _without_cut(log, signals, motors[names].dropna(), vehicle)
    return signals


def _without_cut(log: FlightLog, signals: RateSignals, motors: pd.DataFrame, vehicle: Vehicle) -> RateSignals:
    pwm, at = motors.to_numpy(np.float64), motors.index.to_numpy(np.float64)
    outputs = np.column_stack([signals.columns[name] for name in OUTPUTS.values()]).astype(np.float64)
    known = np.isfinite(outputs).all(axis=1)
    if len(at) < FEWEST or np.count_nonzero(known) < FEWEST or np.any(pwm != np.rint(pwm)):
        return signals
    factors = factors_of(vehicle)
    t, outputs = signals.t[known], outputs[known]
    lowest, highest = (motor_pwm(command, vehicle) for command in (0.0, 1.0))
    asked_there = expectation(np.column_stack([np.interp(at, t, column) for column in outputs.T]), factors)
    middle = thrust_commands(motors + 0.5, vehicle, voltage_at(log.tables.battery, at)).to_numpy(np.float64)
    flying = (asked_there.mean(axis=1) > 0.05) & (pwm > lowest + 1.0).all(axis=1) & (pwm < highest - 1.0).all(axis=1)
    flying &= (at >= t[0]) & (at <= t[-1])
    if np.count_nonzero(flying) < FEWEST:
        return signals
    at = at[flying]
    factor = pd.Series(middle[flying].mean(axis=1) / asked_there[flying].mean(axis=1))
    rows = round(_STEADY / float(np.median(np.diff(at)))) | 1
    factor = factor.rolling(rows, center=True, min_periods=1).median()
    gain, voltage = np.interp(t, at, factor)[:, None], voltage_at(log.tables.battery, t)
    # Only some rows tell whether the outputs are understood, and of the others a piece at a time is worked on: with all
    # motors of all rows this would be the largest thing in memory.
    after = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    before, behind = (
        _pwm(expectation(outputs[k], factors) * gain[k], vehicle, None if voltage is None else voltage[k])
        for k in (after - 1, after)
    )
    share = ((at - t[after - 1]) / (t[after] - t[after - 1]))[:, None]
    if _distance(before, behind, share, pwm[flying]) > _UNDERSTOOD:
        return signals
    columns = dict(signals.columns)
    lost = np.empty((len(t), len(OUTPUTS)))
    for first in range(0, len(t), _PIECE):
        piece = slice(first, first + _PIECE)
        there = None if voltage is None else voltage[piece]
        asked = expectation(outputs[piece], factors)
        foretold = _pwm(asked * gain[piece], vehicle, there)
        got = thrust_commands(pd.DataFrame(np.floor(foretold) + 0.5, columns=motors.columns), vehicle, there)
        inside = (foretold > lowest) & (foretold < highest)
        cut = np.where(inside, got.to_numpy(np.float64) / gain[piece] - asked, 0.0)
        commands = patterns(pd.DataFrame(cut, columns=motors.columns), vehicle)
        lost[piece] = commands.reindex(columns=list(OUTPUTS), fill_value=0.0)
    for column, values in zip(OUTPUTS.values(), lost.T, strict=True):
        corrected = columns[column].copy()
        corrected[known] += values
        columns[column] = corrected
    return replace(signals, columns=columns)


def _pwm(thrust: Floats, vehicle: Vehicle, voltage: Floats | None) -> Floats:
    """Return the PWM [us], not yet whole, of thrusts, shape (N, motors), which `thrust_commands` inverts."""
    command = commands_for(np.maximum(thrust, 0.0), vehicle.thrust_expo)
    if voltage is not None and vehicle.battery_voltage_max > 0.0:
        command = command * (vehicle.battery_voltage_max / voltage)[:, None]
    return np.asarray(motor_pwm(command, vehicle))


def _distance(before: Floats, after: Floats, share: Floats, pwm: Floats) -> float:
    """Return the median distance [us] of foretold outputs from the middle of the microsecond that was logged.

    Outputs are foretold by the rows before and after those of the motors, which lie a `share` of their step apart.
    """
    quiet = np.abs(after - before) < 1.0
    there = before + share * (after - before)
    return float(np.median(np.abs(there - pwm - 0.5)[quiet])) if np.count_nonzero(quiet) >= FEWEST else np.inf


#: Rate [Hz] of the controller's rows beyond which nothing else is looked for.
_FAST_ENOUGH = 25.0

#: Lowest rate [Hz] of motors or gyros that is of use.
_LOWEST = 8.0


class LogSignals:
    """The signals of a log's axes, each from the best source that the log has, read once for all of them.

    Of a log of which only the stretch `within` [s] counts, the controllers' rows beyond it are not read. Of what the
    controllers measured and wanted, one axis is held at a time: of a fast log all are half as large as its file.
    """

    def __init__(self, log: FlightLog, within: Within | None = None) -> None:
        self.log, self.within = log, within
        self._whole = within  # What is read; a part shares it.
        self._answers: dict[str, dict[str, Logged]] = {}

    def part(self, start: float, stop: float) -> LogSignals:
        """Return the signals that are read already, of which only a shorter stretch [s] counts."""
        part = copy(self)
        part.within = start, stop
        if "_outputs" not in vars(self):
            part._whole, part._answers = part.within, {}
        return part

    def chirps(self, axis: str) -> list[Chirp]:
        """Return the chirps on an axis that count."""
        return [chirp for chirp in find_chirps(self.log, self.within) if chirp.axis == axis]

    def as_logged(self, axis: Axis) -> RateSignals:
        """Return what the controller of an axis said."""
        return rate_signals(self.log, self.within, (axis.input, axis.output, axis.reference))

    @cached_property
    def _outputs(self) -> RateSignals:
        """Return the controllers' outputs as motors got them."""
        return as_motors_got(self.log, rate_signals(self.log, self._whole, tuple(OUTPUTS.values())))

    def controllers(self, axis: Axis) -> RateSignals:
        """Return the outputs of all controllers as motors got them, with what that of an axis measured and wanted."""
        if axis.name not in self._answers:
            self._answers.clear()
            answer = rate_signals(self.log, self._whole, (axis.output, axis.reference))
            self._answers[axis.name] = answer.columns
        return replace(self._outputs, columns=self._outputs.columns | self._answers[axis.name])

    @cached_property
    def tells_height(self) -> bool:
        """Whether the log has the vertical acceleration as the height controller saw it."""
        felt = self.log.tables.column("rates", "a_up")
        return felt is not None and bool(felt.notna().any())

    @cached_property
    def motors_and_gyros(self) -> RateSignals | None:
        """Return motors and gyros that stand for the controllers; None where they are missing or too slow."""
        driven, imu = motor_patterns(self.log), self.log.tables.imu
        if driven is None or imu is None or len(imu) <= 16:
            return None
        with suppress(FrequencyError):
            gyros = imu[[f"gyro_{axis}" for axis in "xyz"]].dropna().rename(columns=lambda name: f"w_{name[-1]}")
            paired = on_one_clock(driven, gyros)
            if paired.step <= 1.0 / _LOWEST:
                return replace(paired, source="motor outputs to gyros")
        return None

    def of(self, axis: Axis) -> RateSignals:
        """Return the signals of an axis; FrequencyError without any, with what to log."""
        if not axis.attitude:
            return self.controllers(axis)
        controllers, reason = None, ""
        try:
            known = self.controllers(axis)
            if all(known.knows(name, slice(None)) for name in (axis.input, axis.output)):
                controllers = known
        except FrequencyError as error:
            reason = str(error)
        if controllers is not None and 1.0 / controllers.step >= _FAST_ENOUGH:
            return controllers
        other = self.motors_and_gyros
        if controllers is not None and (other is None or controllers.step < FASTER * other.step):
            return controllers
        if other is None:
            raise FrequencyError(
                reason
                or f"{self.log.path.name}: the log has no {axis.input} and no {axis.output} for the {axis.name} axis, "
                f"and no motor outputs with gyros at {_LOWEST:.0f} Hz in their place; "
                f"{bit_to_set(Need.FAST_RATES, self.log)}"
            )
        return other


#: Logs, or their signals where they are read already.
GivenSignals = GivenLogs | LogSignals | Sequence[FlightLog | LogSignals | str | Path]


def sources_of(data: GivenSignals, within: Within | None = None) -> list[LogSignals]:
    """Return the signals of each log, and of each power-up of one, of which the stretch `within` [s] counts."""
    signals: list[LogSignals] = []
    for given in [data] if isinstance(data, FlightLog | LogSignals | str | Path) else data:
        if isinstance(given, LogSignals):
            signals.append(given if within is None else given.part(*within))
        else:
            signals += [LogSignals(log, within) for log in logs_of(given)]
    return signals


def records_of_each(sources: Sequence[LogSignals], cut: Callable[[LogSignals], AxisRecord]) -> list[AxisRecord]:
    """Cut a record of each log that has one; FrequencyError where none has, which says why not, log by log."""
    records, reasons = [], []
    for source in sources:
        try:
            records.append(cut(source))
        except FrequencyError as error:
            reasons.append(str(error))
    if not records:
        raise FrequencyError(log_by_log(reasons) or "no logs given")
    return records


def motor_patterns(log: FlightLog) -> pd.DataFrame | None:
    """Return what the motors got, as outputs of the mixer; None where they or their frame are not known."""
    motors = log.tables.motors
    if motors is None or len(motors) <= 16:
        return None
    with suppress(MissingDataError):
        known = motors.dropna()
        voltage = voltage_at(log.tables.battery, known.index.to_numpy(np.float64))
        return patterns(thrust_commands(known, log.vehicle, voltage), log.vehicle).rename(columns=OUTPUTS)
    return None


def on_one_clock(driven: pd.DataFrame, answer: pd.DataFrame) -> RateSignals:
    """Resample the faster table to the times of the slower, low-passed below half of its rate."""
    slow, fast = (driven, answer) if step_of(driven) >= step_of(answer) else (answer, driven)
    step, at = step_of(slow), slow.index.to_numpy(np.float64)
    if not np.isfinite(step):
        raise FrequencyError("motors or gyros have a single reading")
    brought = below(fast.index.to_numpy(np.float64), fast.to_numpy(np.float64), at, step)
    known = np.isfinite(brought).all(axis=1)
    if np.count_nonzero(known) < 64:
        raise FrequencyError("motors and gyros were not logged at the same time")
    columns = {str(name): slow[name].to_numpy(np.float64)[known] for name in slow}
    columns |= {str(name): brought[known, k] for k, name in enumerate(fast)}
    return RateSignals(at[known], columns, with_chirp=True)


def step_of(table: pd.DataFrame | pd.Series) -> float:
    """Return the usual step between rows, s."""
    return float(np.median(np.diff(table.index.to_numpy(np.float64)))) if len(table) > 1 else np.inf
