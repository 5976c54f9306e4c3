"""Vertical axis of logs without RATE: throttle output to what the accelerometer feels, the stick as instrument.

Throttle is logged ten times a second whatever LOG_BITMASK says, and no GPS is needed. What is felt along the thrust is
thrust per mass less drag, whatever the lean; thrust that leans is compensated in the throttle output itself. Motor
outputs stand for the throttle where they come faster.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from logparse import FlightLog
from logparse.canonical.control import throttle_output
from sysid.frequency.axes import FrequencyError
from sysid.frequency.excitation import Within
from sysid.frequency.flight_records import at_rows, flight_span, lift_asked
from sysid.frequency.records import ORDINARY_BAND, AxisRecord, below, on_uniform_clock
from sysid.frequency.sources import FASTER, motor_patterns, step_of

#: Least throttle output [1] of a motor that turns.
_TURNING = 0.02

#: Fewest rows that are a record.
_FEWEST = 64


def throttle_record(log: FlightLog, within: Within | None = None) -> AxisRecord:
    """Cut the record of a flight: throttle output, specific force along the thrust, and what asked for lift.

    What is faster than the throttle's rows is taken below half of their rate, so that vibration does not fold.
    """
    name = log.path.name
    imu = log.tables.imu
    if imu is None or len(imu) < _FEWEST:
        raise FrequencyError(f"{name}: no RATE, and no throttle (CTUN) with an accelerometer (IMU) in its place")
    output, source = _lifting(log, imu)
    start, stop = flight_span(log, float(output.index[0]), float(output.index[-1]), within)
    times = output.index.to_numpy(np.float64)
    step = float(np.median(np.diff(times)))
    rows = times[(times >= start) & (times <= stop)]
    rows = rows[np.concatenate([[True], np.diff(rows) > 0.0])]
    if len(rows) < 64:
        raise FrequencyError(f"{name}: too few rows of throttle in the air")
    asked_t, asked, instrument = lift_asked(log, start, stop)
    felt = below(imu.index.to_numpy(np.float64), -imu[["accel_z"]].to_numpy(np.float64), rows, step)[:, 0]
    columns = [np.interp(rows, times, output.to_numpy(np.float64)), felt, at_rows((asked_t, asked, instrument), rows)]
    clock, values, usable = on_uniform_clock(rows, columns)
    turning = values[:, 0] > _TURNING
    if np.count_nonzero(turning) < 64:
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
        source=source,
        trim=float(np.median(values[turning, 1]) / np.median(values[turning, 0])),
    )


def _lifting(log: FlightLog, imu: pd.DataFrame) -> tuple[pd.Series, str]:
    """Return what lifted the craft, and what it is where it is not the throttle output."""
    throttle, motors = throttle_output(log.messages, log.vehicle), motor_patterns(log)
    found = [] if throttle is None else [(throttle["throttle"].dropna(), "")]
    found += [(thrust.dropna(), "") for thrust in log.tables.columns("rates", ["out_thrust"])]
    found += [] if motors is None else [(motors["out_thrust"].dropna(), "motor outputs to accelerometer")]
    found = [each for each in found if len(each[0]) >= _FEWEST]
    if not found:
        raise FrequencyError(f"{log.path.name}: no {_FEWEST} rows of throttle (CTUN) or motor outputs")
    felt = step_of(imu)
    steps = [max(step_of(each[0]), felt) for each in found]
    return found[-1] if steps[-1] * FASTER <= steps[0] else found[0]
