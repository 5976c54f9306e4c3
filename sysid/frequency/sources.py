"""Where the signals of an axis come from: the rate controller, or what motors got (or did) and gyros felt.

RATE, or the PID messages, have input and output of an axis in one row. Where a log has neither, or motors and gyros
faster, the mixer's patterns of the motor outputs (RCOU, through the thrust curve) or of the rotor speeds that ESCs
report stand for the controller's outputs, and gyros (IMU, or bursts of the batch sampler) or the attitude for the rate.
The faster of the two is brought to the times of the slower below half of its rate, so that nothing folds that need not.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pandas as pd

from core.cubic_spline import cubic_spline
from logparse import FlightLog, GivenLogs, MissingDataError, logs_of
from logparse.craft.log_settings import Need, bit_to_set
from sysid.frequency.antialias import below, pieces_of
from sysid.frequency.axes import Axis, FrequencyError
from sysid.frequency.excitation import Within
from sysid.frequency.rate_signals import RateSignals, rate_signals, with_vertical
from sysid.frequency.response import Floats
from sysid.frequency.whole_pwm import OUTPUTS, as_motors_got
from sysid.records.mixer import patterns, thrust_commands, voltage_at

#: Rate [Hz] of the controller's rows beyond which nothing else is looked for, and how much faster others must be.
_FAST_ENOUGH, FASTER = 25.0, 1.5

#: Lowest rate [Hz] of motors or gyros that is of use.
_LOWEST = 8.0

#: Name of the rates that are derivatives of the attitude, which no gyro filter is in the way of.
ATTITUDE = "attitude"

#: Name of the batch sampler's gyros, and the rate [Hz] of others below which they are taken.
BURSTS, _WHOLE = "gyro bursts", 20.0

#: Fewest samples that are worth a look.
_FEWEST = 16

#: Thrust command of a motor that turns, and part of its median above which it lifts the craft; correlation of commands
#: and speeds that vary together; powers of the speed with which thrust may rise.
_TURNING, _LIFTING, _TOGETHER, _POWERS = 0.02, 0.5, 0.9, (1.0, 3.0)


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
    def vertical(self) -> RateSignals:
        """Return the same with the vertical axis."""
        return with_vertical(self.log, self.controllers)

    @cached_property
    def pairs(self) -> list[RateSignals]:
        """Return motors and gyros that stand for the controllers, the fastest first."""
        return sorted(_pairs(self.log), key=lambda pair: pair.step)

    def of(self, axis: Axis, *, bursts: bool = True) -> RateSignals:
        """Return the signals of an axis; FrequencyError without any, with what to log."""
        if not axis.attitude:
            return self.vertical
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
        # Bursts last a second: what is slower than a few hertz does not show in them.
        whole = [pair for pair in self.pairs if not pair.source.endswith(BURSTS)]
        enough = not bursts or (whole and whole[0].step <= 1.0 / _WHOLE)
        best = next(iter(whole if enough else self.pairs), None)
        if controllers is not None and (best is None or controllers.step < FASTER * best.step):
            return controllers
        if best is None:
            raise FrequencyError(
                reason
                or f"{self.log.path.name}: the log has no {axis.input} and no {axis.output} for the {axis.name} axis, "
                f"and no motor outputs with gyros at {_LOWEST:.0f} Hz in their place; "
                f"{bit_to_set(Need.FAST_RATES, self.log)}"
            )
        return best


#: Logs, or their signals where they are read already.
GivenSignals = GivenLogs | LogSignals | Sequence[FlightLog | LogSignals | str | Path]


def sources_of(data: GivenSignals, within: Within | None = None) -> list[LogSignals]:
    """Return the signals of each log, and of each power-up of one."""
    found: list[LogSignals] = []
    for each in [data] if isinstance(data, FlightLog | LogSignals | str | Path) else data:
        found += [each] if isinstance(each, LogSignals) else [LogSignals(log, within) for log in logs_of(each)]
    return found


def _pairs(log: FlightLog) -> Iterator[RateSignals]:
    """Yield every pair of driving and answering signals."""
    answers = list(_answers(log))
    for source, driven in driving(log):
        for answer, table, pieces in answers:
            with suppress(FrequencyError):
                paired = on_one_clock(driven, table, pieces)
                if paired.step <= 1.0 / _LOWEST:
                    yield replace(paired, source=f"{source} to {answer}")


def driving(log: FlightLog) -> Iterator[tuple[str, pd.DataFrame]]:
    """Yield what drove the craft: rotor speeds, motor outputs; as outputs of the mixer, with the slowest first."""
    motors, esc, vehicle = log.tables.motors, log.tables.esc, log.vehicle
    commands: pd.DataFrame | None = None
    if motors is not None and len(motors) > _FEWEST:
        with suppress(MissingDataError):
            known = motors.dropna()
            commands = thrust_commands(known, vehicle, voltage_at(log.tables.battery, known.index.to_numpy(np.float64)))
            yield "motor outputs", patterns(commands, vehicle).rename(columns=OUTPUTS)
    if esc is not None and len(esc) > _FEWEST:
        speeds = esc[[name for name in esc if str(name).startswith("w")]].dropna()
        speeds = speeds[(speeds > 0.0).all(axis=1)].rename(columns=lambda name: f"m{str(name)[1:]}")
        if len(speeds) > _FEWEST:
            with suppress(MissingDataError):
                yield "rotor speeds", patterns(_thrust_of(speeds, commands), vehicle).rename(columns=OUTPUTS)


def _thrust_of(speeds: pd.DataFrame, commands: pd.DataFrame | None) -> pd.DataFrame:
    """Return the thrust of rotors in the unit of the controller's outputs.

    It goes with the square of the speed, unless the ESCs report something else (the simulator of the firmware, a
    number that is linear in the command): the power is that with which the commands vary, where they vary together.
    """
    power, mean = 2.0, 1.0
    speed_there = float(np.exp(np.mean(np.log(speeds.median()))))
    if commands is not None:
        t, at = commands.index.to_numpy(np.float64), speeds.index.to_numpy(np.float64)
        lifting = commands > np.maximum(_LIFTING * commands[commands > _TURNING].median(), _TURNING)
        inside = (t >= at[0]) & (t <= at[-1]) & lifting.all(axis=1).to_numpy()
        names = [name for name in speeds if name in commands]
        if np.count_nonzero(inside) > _FEWEST and names:
            log_thrust = np.log(commands.loc[inside, names].to_numpy(np.float64))
            log_speed = np.log(np.column_stack([np.interp(t[inside], at, speeds[name]) for name in names]))
            mean, speed_there = float(np.exp(np.mean(log_thrust))), float(np.exp(np.mean(log_speed)))
            thrust, speed = (each - each.mean(axis=0) for each in (log_thrust, log_speed))
            together = float(np.sum(thrust * speed) / np.sqrt(max(np.sum(thrust**2) * np.sum(speed**2), 1e-300)))
            if together > _TOGETHER:
                # Both scatter: the ratio of their spreads, where regression would be too flat.
                power = float(np.clip(np.sqrt(np.sum(thrust**2) / np.sum(speed**2)), *_POWERS))
    return mean * (speeds / speed_there) ** power


def _answers(log: FlightLog) -> Iterator[tuple[str, pd.DataFrame, Floats]]:
    """Yield what felt the turning: rates [rad/s] about x, y, z, and the number of the burst of every sample."""
    names = {f"gyro_{axis}": f"w_{axis}" for axis in "xyz"}
    imu, attitude = log.tables.imu, log.tables.attitude
    if imu is not None and len(imu) > _FEWEST:
        known = imu[list(names)].dropna().rename(columns=names)
        yield "gyros", known, pieces_of(known.index.to_numpy(np.float64))
    elif attitude is not None and len(attitude) > _FEWEST:
        known = attitude[["roll", "pitch", "yaw"]].dropna()
        yield ATTITUDE, _turning(known), pieces_of(known.index.to_numpy(np.float64))
    bursts = log.tables.further.get("gyro_batch", ())
    if bursts:
        first = max(bursts, key=len)
        yield BURSTS, first[list(names)].rename(columns=names), first["batch"].to_numpy(np.float64)


def _turning(angles: pd.DataFrame) -> pd.DataFrame:
    """Return the body rates of roll, pitch and yaw [rad], by central differences of what is between samples."""
    t = angles.index.to_numpy(np.float64)
    roll, pitch, yaw = np.unwrap(angles.to_numpy(np.float64), axis=0).T
    h = 0.1 * float(np.median(np.diff(t)))
    columns = np.column_stack([roll, pitch, yaw])
    d_roll, d_pitch, d_yaw = ((cubic_spline(t, columns, t + h) - cubic_spline(t, columns, t - h)) / (2.0 * h)).T
    rates = {
        "w_x": d_roll - np.sin(pitch) * d_yaw,
        "w_y": np.cos(roll) * d_pitch + np.sin(roll) * np.cos(pitch) * d_yaw,
        "w_z": -np.sin(roll) * d_pitch + np.cos(roll) * np.cos(pitch) * d_yaw,
    }
    return pd.DataFrame(rates, index=angles.index)


def on_one_clock(driven: pd.DataFrame, answer: pd.DataFrame, pieces: Floats) -> RateSignals:
    """Bring the faster table to the times of the slower, below half of its rate.

    `pieces` (len(answer),): number of the stretch without holes that each row of `answer` is of (`pieces_of`).
    """
    steps = [step_of(driven), step_of(answer, pieces)]
    own = pieces_of(driven.index.to_numpy(np.float64))
    if steps[0] >= steps[1]:
        slow, fast, fast_pieces, step = driven, answer, pieces, steps[0]
    else:
        slow, fast, fast_pieces, step = answer, driven, own, steps[1]
    if not np.isfinite(step):
        raise FrequencyError("motors or gyros have a single reading")
    at = slow.index.to_numpy(np.float64)
    brought = below(fast.index.to_numpy(np.float64), fast.to_numpy(np.float64), at, step, fast_pieces)
    known = np.isfinite(brought).all(axis=1)
    if np.count_nonzero(known) < 64:
        raise FrequencyError("motors and gyros were not logged at the same time")
    columns = {str(name): slow[name].to_numpy(np.float64)[known] for name in slow}
    columns |= {str(name): brought[known, k] for k, name in enumerate(fast)}
    return RateSignals(at[known], columns, with_chirp=True)


def step_of(table: pd.DataFrame | pd.Series, pieces: Floats | None = None) -> float:
    """Return the usual step between rows of a piece, s."""
    t = table.index.to_numpy(np.float64)
    steps = np.diff(t) if pieces is None else np.diff(t)[np.diff(pieces) == 0.0]
    return float(np.median(steps)) if len(steps) else np.inf


def filtered(log: FlightLog, source: str) -> float | None:
    """Return the corner [Hz] of the low-pass in the way of the rates of a source; None without one."""
    after_filter = int(log.parameters_flown.get("INS_LOG_BAT_OPT", 0)) & 2
    bare = source.endswith(ATTITUDE) or (source.endswith(BURSTS) and not after_filter)
    return None if bare else log.parameters_flown.get("INS_GYRO_FILTER")
