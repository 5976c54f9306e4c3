"""What the rate controllers of a log say, and that of the height: outputs, measurements and targets, as rows.

ArduPilot cuts PWM off to whole microseconds. A closed loop leaves a few of them of a slow chirp, and what is cut off
goes with it: firmware craft seemed to lead by 2 to 5 deg at 0.5 Hz, and by 0 to 2 with what the motors got as input.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from logparse import FlightLog, MissingDataError, Vehicle
from logparse.craft.log_settings import Need, bit_to_set
from logparse.tables import COLUMNS
from sysid.frequency.axes import FrequencyError
from sysid.frequency.excitation import Within
from sysid.frequency.records import Logged, on_uniform_clock
from sysid.frequency.response import Floats
from sysid.records.mixer import expectation, factors_of, patterns, thrust_commands, voltage_at
from sysid.records.motor_scaling import commands_for, motor_pwm

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
        """Return which rows lie within a stretch of time."""
        return slice(np.searchsorted(self.t, start), np.searchsorted(self.t, stop, side="right"))

    def evenly(
        self, names: Sequence[str], start: float, stop: float, *further: Callable[[Floats], Floats]
    ) -> tuple[Floats, Logged, NDArray[np.bool_]]:
        """Bring columns of a stretch, and functions of time beside them, to an even clock, as `on_uniform_clock` does.

        In the precision in which they are logged.
        """
        rows = self.within(start, stop)
        t, values, usable = on_uniform_clock(self.t[rows], [self.columns[name][rows] for name in names])
        values = np.column_stack([values, *(at(t) for at in further)])
        return t, values.astype(self.columns[names[0]].dtype, copy=False), usable


def rate_signals(log: FlightLog, within: Within | None = None) -> RateSignals:
    """Read the rate controllers of a log: RATE, or the PID messages where it has none."""
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
    # In single precision, as the fast loop is logged: all in double are the largest thing in memory.
    known = {str(each.name): each.to_numpy()[rows].astype(np.float32) for each in columns}
    log.tables.release(keep="imu")  # what the columns were made of is as large as they are
    told = {name: values for name, values in known.items() if np.isfinite(values).any()}
    return RateSignals(t[rows], told, "RATE" in log.messages)


#: Outputs by the names of the mixer's patterns.
OUTPUTS = {"thrust": "out_thrust", "roll": "out_roll", "pitch": "out_pitch", "yaw": "out_yaw"}

#: Fewest rows of motors that lift, and the time [s] over which air and battery stay the same.
_FEWEST, _STEADY = 100, 10.0

#: Mean thrust of a craft that flies, and the change [us] between rows of the controller up to which a row of the motors
#: in between is known.
_FLYING, _QUIET = 0.05, 1.0

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
    if motors is None or signals.source or not signals.with_chirp or not vehicle.motors:
        return signals
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if any(name not in motors for name in names) or any(name not in signals.columns for name in OUTPUTS.values()):
        return signals
    with suppress(MissingDataError):
        return _without_cut(log, signals, motors[names].dropna(), vehicle)
    return signals


def _without_cut(log: FlightLog, signals: RateSignals, motors: pd.DataFrame, vehicle: Vehicle) -> RateSignals:
    pwm, at = motors.to_numpy(np.float64), motors.index.to_numpy(np.float64)
    outputs = np.column_stack([signals.columns[name] for name in OUTPUTS.values()]).astype(np.float64)
    known = np.isfinite(outputs).all(axis=1)
    if len(at) < _FEWEST or np.count_nonzero(known) < _FEWEST or np.any(pwm != np.rint(pwm)):
        return signals
    factors = factors_of(vehicle)
    t, outputs = signals.t[known], outputs[known]
    lowest, highest = (motor_pwm(command, vehicle) for command in (0.0, 1.0))
    asked_there = expectation(np.column_stack([np.interp(at, t, column) for column in outputs.T]), factors)
    middle = thrust_commands(motors + 0.5, vehicle, voltage_at(log.tables.battery, at)).to_numpy(np.float64)
    flying = (asked_there.mean(axis=1) > _FLYING) & (pwm > lowest + 1.0).all(axis=1) & (pwm < highest - 1.0).all(axis=1)
    flying &= (at >= t[0]) & (at <= t[-1])
    if np.count_nonzero(flying) < _FEWEST:
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
    quiet = np.abs(after - before) < _QUIET
    there = before + share * (after - before)
    return float(np.median(np.abs(there - pwm - 0.5)[quiet])) if np.count_nonzero(quiet) >= _FEWEST else np.inf
