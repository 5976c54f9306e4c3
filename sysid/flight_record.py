"""From a log and its trajectory to an `Experiment`: the airborne segment on one clock."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from logparse import Finding, MissingDataError, Severity
from sysid.context import flight_context, has_pressure, resample_frame
from sysid.experiment import MIN_SAMPLES, Experiment
from sysid.resampling import resample

if TYPE_CHECKING:
    from estimation import Trajectory
    from logparse import FlightLog

#: A gap in the motor outputs longer than this ends the usable segment, s.
LONGEST_GAP = 1.0


def record_flight(
    log: FlightLog, trajectory: Trajectory, rate: float, inputs: str, outputs: str, name: str | None
) -> Experiment:
    """Do the work of `Experiment.from_flight`."""
    if inputs != "motors":
        raise ValueError(f"inputs must be 'motors', not {inputs!r}")
    if outputs != "position":
        raise ValueError(f"outputs must be 'position', not {outputs!r}")
    label = name or log.path.name
    motors = log.tables.motors
    if motors is None or motors.empty:
        raise MissingDataError(
            f"{label}: no motor outputs (RCOU, or SERVO_OUTPUT_RAW in telemetry); "
            "set LOG_BITMASK to include motor outputs, or SR0_RC_CHAN for telemetry"
        )
    if log.flight is None:
        raise MissingDataError(f"{label}: the craft never left the ground, so that there is nothing to identify")
    states = trajectory.states
    start = max(log.flight.start, float(motors.index[0]), float(states.index[0]))
    stop = min(log.flight.stop, float(motors.index[-1]), float(states.index[-1]))
    start, stop, findings = _without_gaps(motors, start, stop)
    if (stop - start) * rate < MIN_SAMPLES:
        raise MissingDataError(
            f"{label}: motor outputs and trajectory overlap in flight for {max(stop - start, 0.0):.1f} s only"
        )
    t = start + np.arange(int((stop - start) * rate + 1e-9) + 1) / rate
    motors, more = _usable(motors, start, stop)
    u = resample(motors.index.to_numpy(np.float64), motors.to_numpy(np.float64), t)
    context = flight_context(trajectory, log.tables, t)
    if not has_pressure(log.tables) and context["density"].notna().all():
        more.append(
            Finding(
                "density-from-altitude",
                Severity.INFO,
                "without a barometer the air's density is that of the standard atmosphere at the craft's altitude "
                f"({context['density'].mean():.3f} kg/m^3)",
                "log the barometer (BARO, or SCALED_PRESSURE in telemetry)",
                {"density": float(context["density"].mean())},
            )
        )
    position = resample_frame(states[["p_n", "p_e", "p_d"]], t)
    y = (position - position[0]) * np.array([1.0, 1.0, -1.0])
    return Experiment.from_arrays(
        t,
        u,
        y,
        name=label,
        input_names=[str(column) for column in motors.columns],
        output_names=("x", "y", "z"),
        units={**{str(column): "us" for column in motors.columns}, "x": "m", "y": "m", "z": "m"},
        context=context,
        vehicle=log.vehicle,
        findings=(*findings, *more),
    )


def _without_gaps(motors: pd.DataFrame, start: float, stop: float) -> tuple[float, float, list[Finding]]:
    """Keep the longest stretch without a gap in the motor outputs."""
    times = motors.index.to_numpy(np.float64)
    times = times[(times >= start) & (times <= stop)]
    breaks = np.flatnonzero(np.diff(times) > LONGEST_GAP)
    if len(breaks) == 0:
        return start, stop, []
    firsts, lasts = np.concatenate([[0], breaks + 1]), np.concatenate([breaks, [len(times) - 1]])
    longest = int(np.argmax(times[lasts] - times[firsts]))
    kept = float(times[firsts[longest]]), float(times[lasts[longest]])
    return *kept, [
        Finding(
            "motor-output-gaps",
            Severity.WARNING,
            f"motor outputs are missing {len(breaks)} time(s) in flight, for up to {np.diff(times).max():.1f} s; "
            f"{kept[1] - kept[0]:.1f} of {stop - start:.1f} s in one piece are used",
            "",
            {"gaps": len(breaks), "used_seconds": kept[1] - kept[0]},
        )
    ]


def _usable(motors: pd.DataFrame, start: float, stop: float) -> tuple[pd.DataFrame, list[Finding]]:
    """Leave out motors without any value in the segment."""
    inside = motors.loc[start:stop]
    empty = [column for column in motors.columns if inside[column].notna().sum() < 2]
    if not empty:
        return motors, []
    names = ", ".join(str(column) for column in empty)
    if len(empty) == motors.shape[1]:
        raise MissingDataError(
            f"no motor output has a value in flight ({names}); check SERVOn_FUNCTION and LOG_BITMASK"
        )
    return motors.drop(columns=empty), [
        Finding(
            "motor-without-output",
            Severity.WARNING,
            f"no output was logged in flight for {names}; left out",
            "check SERVOn_FUNCTION of these motors",
            {"motors": names},
        )
    ]
