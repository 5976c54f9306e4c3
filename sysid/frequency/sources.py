"""Where the signals of an axis come from: the rate controller, or what motors got and gyros felt.

RATE, or the PID messages, have input and output of an axis in one row. Where a log has neither, or motors and gyros
faster, the mixer's patterns of the motor outputs (RCOU, through the thrust curve) stand for the controller's outputs,
and gyros for the rate. The faster of the two is brought to the times of the slower below half of its rate, so that
nothing folds that need not.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from logparse import FlightLog, GivenLogs, MissingDataError, logs_of
from logparse.craft.log_settings import Need, bit_to_set
from sysid.frequency.axes import Axis, FrequencyError
from sysid.frequency.excitation import Within
from sysid.frequency.rate_signals import OUTPUTS, RateSignals, as_motors_got, rate_signals
from sysid.frequency.records import below
from sysid.records.mixer import patterns, thrust_commands, voltage_at

#: Rate [Hz] of the controller's rows beyond which nothing else is looked for, and how much faster others must be.
_FAST_ENOUGH, FASTER = 25.0, 1.5

#: Lowest rate [Hz] of motors or gyros that is of use.
_LOWEST = 8.0

#: Fewest samples that are worth a look.
_FEWEST = 16


class LogSignals:
    """The signals of a log's axes, each from the best source that the log has, read once for all of them.

    Of a log of which only the stretch `within` [s] is asked for, the controllers' rows beyond it are not read.
    """

    def __init__(self, log: FlightLog, within: Within | None = None) -> None:
        self.log, self._within = log, within

    @cached_property
    def controllers(self) -> RateSignals:
        """Return what the rate controllers said, their outputs as motors got them."""
        return as_motors_got(self.log, rate_signals(self.log, self._within))

    @cached_property
    def tells_height(self) -> bool:
        """Whether the log has the vertical acceleration as the height controller saw it."""
        felt = next(self.log.tables.columns("rates", ["a_up"]), None)
        return felt is not None and bool(felt.notna().any())

    @cached_property
    def motors_and_gyros(self) -> RateSignals | None:
        """Return motors and gyros that stand for the controllers; None where they are missing or too slow."""
        driven, imu = motor_patterns(self.log), self.log.tables.imu
        if driven is None or imu is None or len(imu) <= _FEWEST:
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
            return self.controllers
        controllers, reason = None, ""
        try:
            known = self.controllers.columns
            wanted = [known.get(name) for name in (axis.input, axis.output)]
            if all(values is not None and np.isfinite(values).sum() >= 16 for values in wanted):
                controllers = self.controllers
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
    """Return the signals of each log, and of each power-up of one."""
    found: list[LogSignals] = []
    for each in [data] if isinstance(data, FlightLog | LogSignals | str | Path) else data:
        found += [each] if isinstance(each, LogSignals) else [LogSignals(log, within) for log in logs_of(each)]
    return found


def motor_patterns(log: FlightLog) -> pd.DataFrame | None:
    """Return what the motors got, as outputs of the mixer; None where they or their frame are not known."""
    motors = log.tables.motors
    if motors is None or len(motors) <= _FEWEST:
        return None
    with suppress(MissingDataError):
        known = motors.dropna()
        voltage = voltage_at(log.tables.battery, known.index.to_numpy(np.float64))
        return patterns(thrust_commands(known, log.vehicle, voltage), log.vehicle).rename(columns=OUTPUTS)
    return None


def on_one_clock(driven: pd.DataFrame, answer: pd.DataFrame) -> RateSignals:
    """Bring the faster table to the times of the slower, below half of its rate."""
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
