"""From a log and its trajectory to the airborne segment on one clock, of which an `Experiment` is made."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
import pandas as pd

from core.findings import info, warning
from logparse import Finding, MissingDataError, Severity, Vehicle
from logparse.tables import between
from sysid.records import MIN_SAMPLES, Floats
from sysid.records.context import has_pressure, resample_frame, shared_context
from sysid.records.inputs import INPUT_SETS, Inputs, read_inputs, yaw_of
from sysid.records.mixer import mixer_differs, project, rounding
from sysid.records.resampling import resample

if TYPE_CHECKING:
    from estimation import Trajectory
    from logparse import FlightLog
    from logparse.flights import Flight

#: A gap in the inputs longer than this ends the usable segment, s.
LONGEST_GAP = 1.0

#: Times from take-off or landing [s] between which a craft rests, and by how much its height then changes at most, m.
REST, STILL = (1.5, 5.0), 0.2

#: Height [m] below which the ground carries a part of a craft, and the time [s] in which one takes off or lands.
_CLEAR, _LIFTING = 0.3, 2.0

#: Input sets that are the sums of several signals: one of them missing is all missing.
_WHOLE = ("mixer", "rate_outputs", "reference", "velocity_reference")

#: Finding of a record whose horizontal motion was not measured.
POSITION_UNKNOWN = "position-unknown"

#: Finding of motor outputs whose rounding hides what was asked.
BELOW_ROUNDING = "constant-input"

Record = TypeVar("Record")

OUTPUTS = ("position", "velocity")
FRAMES = ("earth", "heading")


def record_flight(
    make: Callable[..., Record],
    log: FlightLog,
    trajectory: Trajectory,
    rate: float,
    inputs: str,
    outputs: str,
    frame: str,
    name: str | None,
    contexts: Iterable[pd.DataFrame | None] = (),
    within: tuple[float, float] | None = None,
) -> Record:
    """Cut the piece and make a record of it as `Experiment.from_arrays` does; errors as in `Experiment.from_flight`."""
    for kind, value, known in (("inputs", inputs, INPUT_SETS), ("outputs", outputs, OUTPUTS), ("frame", frame, FRAMES)):
        if value not in known:
            raise ValueError(f"{kind} must be one of {', '.join(known)}, not {value!r}")
    label = name or log.path.name
    if log.flight is None:
        raise MissingDataError(f"{label}: the craft never left the ground, so that there is nothing to identify")
    if trajectory.inconsistency:
        raise MissingDataError(f"{label}: {trajectory.inconsistency}")
    try:
        source = read_inputs(log.tables, log.vehicle, trajectory, inputs, frame)
        states = trajectory.states
        earliest, latest = within or (log.flight.start, log.flight.stop)
        first = max(log.flight.start, earliest, float(states.index[0]))
        last = min(log.flight.stop, latest, float(states.index[-1]))
        first, last = _clear_of_the_ground(states["p_d"], first, last)
        if last <= first:
            raise MissingDataError(f"nothing of the flight lies between {earliest:.1f} and {latest:.1f} s")
        signals, more = _usable(source, inputs, first, last)
        piece, start, stop, findings = _longest_piece(source, signals, first, last)
    except MissingDataError as error:
        raise MissingDataError(f"{label}: {error}") from None
    if (stop - start) * rate < MIN_SAMPLES:
        raise MissingDataError(
            f"{label}: {source.title} and trajectory overlap in flight for {max(stop - start, 0.0):.1f} s only"
        )
    t = start + np.arange(int((stop - start) * rate + 1e-9) + 1) / rate
    u = resample(piece.index.to_numpy(np.float64), piece.to_numpy(np.float64), t)
    context = shared_context(contexts, trajectory, log.tables, t)
    if "height" not in context and (ground := _ground(states["p_d"], log.flight)) is not None:
        context = context.assign(height=ground - resample_frame(states[["p_d"]], t)[:, 0])
    if not has_pressure(log.tables) and context["density"].notna().all():
        more.append(
            info(
                "conditions-assumed",
                "without a barometer the air's density is that of the standard atmosphere at the craft's altitude "
                f"({context['density'].mean():.3f} kg/m^3)",
                "log the barometer (BARO, or SCALED_PRESSURE in telemetry)",
                density=float(context["density"].mean()),
            )
        )
    unknown = trajectory.unknown_position(start, stop)
    if unknown:
        more.append(
            warning(
                POSITION_UNKNOWN,
                f"{unknown}.",
                "Wait for a 3-D fix before take-off, and log GPS; height, attitude and rates are known without.",
            )
        )
    if inputs in ("motors", "mixer") and log.tables.motors is not None:
        more += _rounded(log.tables.motors, log.vehicle, start, stop)
        more += mixer_differs(log.tables, log.vehicle, start, stop)
    more += _steps(source, start, stop)
    motion, unit = _motion(states, outputs, turned=frame == "heading" and inputs in ("motors", "rotor_speeds"))
    y = resample_frame(motion, t)
    if outputs == "position":
        if inputs == "reference":
            # Counted from where the craft was, as positions are, so that their difference is the loop's error.
            u = u - y[0]
        y = y - y[0]
    names_u, names_y = (tuple(map(str, table.columns)) for table in (piece, motion))
    return make(
        t,
        u,
        y,
        name=label,
        input_names=names_u,
        output_names=names_y,
        units={**dict.fromkeys(names_u, source.unit), **dict.fromkeys(names_y, unit)},
        context=context,
        vehicle=log.vehicle,
        findings=(*source.findings, *findings, *more),
    )


def _clear_of_the_ground(down: pd.Series[float], first: float, last: float) -> tuple[float, float]:
    """Return when a craft has left the ground, and when it comes back to it: within 0.3 m it carries a part of it.

    A record that begins or ends in the air changes its height by less within `_LIFTING` seconds, and stays whole.
    """
    inside = down.loc[first:last]
    t, height = inside.index.to_numpy(np.float64), -inside.to_numpy(np.float64)
    if len(t) < 2:
        return first, last
    up, back = t[height > height[0] + _CLEAR], t[height > height[-1] + _CLEAR]
    begin = float(up[0]) if len(up) and up[0] - first < _LIFTING else first
    end = float(back[-1]) if len(back) and last - back[-1] < _LIFTING else last
    return (begin, end) if end > begin else (first, last)


def _ground(down: pd.Series, flight: Flight) -> float | None:
    """Return the down coordinate at rest before take-off, else after landing; None where neither was logged.

    A flight begins when the craft has risen by a few decimetres: in wind that grows with height these bend its profile.
    """
    for first, last in (
        (flight.start - REST[1], flight.start - REST[0]),
        (flight.stop + REST[0], flight.stop + REST[1]),
    ):
        rest = down.loc[first:last]
        if len(rest) > 1 and rest.index[-1] - rest.index[0] > 0.5 and float(np.ptp(rest)) < STILL:
            return float(rest.median())
    return None


def _steps(source: Inputs, start: float, stop: float) -> list[Finding]:
    """Report that targets jump, as those of telemetry do."""
    inside = source.steps[(source.steps[:, 0] > start) & (source.steps[:, 0] < stop), 1]
    if not len(inside):
        return []
    return [
        warning(
            "reference-doubtful",
            f"{source.title} jump {len(inside)} time(s), by up to {float(inside.max()):.1f} m, as waypoints do: "
            "between them the autopilot shapes a path that this log does not have, and a linear model takes its "
            "limits of speed and acceleration for slowness",
            "use the DataFlash log of the flight; its PSCN, PSCE and PSCD have the path",
            steps=len(inside),
            largest=float(inside.max()),
        )
    ]


def _rounded(motors: pd.DataFrame, vehicle: Vehicle, start: float, stop: float) -> list[Finding]:
    """Report which commands of the mixer drown in the rounding of PWM to whole microseconds."""
    flown = motors.loc[start:stop].dropna(how="any")
    try:
        noise = rounding(flown, vehicle)
        moved = project(flown, vehicle, None).std(ddof=0)
    except MissingDataError:  # no frame, or motors without an output, which is told elsewhere
        return []
    drowned = [name for name, sigma in noise.items() if 0.0 < float(moved[name]) < 2.0 * sigma]
    if not drowned:
        return []
    return [
        Finding(
            BELOW_ROUNDING,
            Severity.WARNING,
            f"motor outputs hardly show what was asked in {', '.join(drowned)}: "
            + ", ".join(f"{100.0 * float(moved[name]):.2g}" for name in drowned)
            + " % of full thrust (standard deviation), of which rounding PWM to 1 us alone makes "
            + ", ".join(f"{100.0 * noise[name]:.2g}" for name in drowned)
            + " %; their effect on the craft cannot be told from motor outputs",
            "fly with more roll and pitch, or use the rate controller's outputs (RATE messages)",
            {f"moved_{name}": float(moved[name]) for name in drowned}
            | {f"rounding_{name}": noise[name] for name in drowned},
        )
    ]


def _motion(states: pd.DataFrame, outputs: str, *, turned: bool) -> tuple[pd.DataFrame, str]:
    """Return position or velocity, z up, along north and east or, turned, along and across the nose; and its unit."""
    kind, unit = ("p", "m") if outputs == "position" else ("v", "m/s")
    values = states[[f"{kind}_n", f"{kind}_e", f"{kind}_d"]].to_numpy(np.float64) * [1.0, 1.0, -1.0]
    names = ["x", "y", "z"]
    if turned:
        names = ["forward", "right", "z"]
        yaw = yaw_of(states)
        if outputs == "position":
            middle, steps = 0.5 * (yaw[1:] + yaw[:-1]), np.diff(values[:, :2], axis=0)
            values[:, :2] = np.vstack([np.zeros(2), np.cumsum(_to_heading(steps, middle), axis=0)])
        else:
            values[:, :2] = _to_heading(values[:, :2], yaw)
    columns = names if outputs == "position" else [f"v_{name}" for name in names]
    return pd.DataFrame(values, index=states.index, columns=columns), unit


def _to_heading(north_east: Floats, yaw: Floats) -> Floats:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.column_stack([c * north_east[:, 0] + s * north_east[:, 1], c * north_east[:, 1] - s * north_east[:, 0]])


def _usable(source: Inputs, kind: str, start: float, stop: float) -> tuple[pd.DataFrame, list[Finding]]:
    """Leave out motors without values in the flight; other sets need all of theirs."""
    signals = source.signals
    inside = between(signals, start, stop)
    known = inside.notna().to_numpy()
    needed = max(2, 0.5 * int(known.any(axis=1).sum()))
    empty = [column for k, column in enumerate(signals.columns) if known[:, k].sum() < needed]
    names = ", ".join(str(column) for column in empty)
    if len(empty) == signals.shape[1] or (empty and kind in _WHOLE and not known.all(axis=1).any()):
        if kind in ("motors", "rotor_speeds", "mixer"):
            raise MissingDataError(f"no motor output has a value in flight ({names}); check which outputs drive motors")
        raise MissingDataError(f"there are no {source.title} in flight: its controller was not active then")
    if not empty or kind in _WHOLE:
        return signals, []
    return signals.drop(columns=empty), [
        warning(
            "not-logged",
            f"no output was logged in flight for {names}; left out",
            "check SERVOn_FUNCTION of these motors",
            motors=names,
        )
    ]


def _longest_piece(
    source: Inputs, signals: pd.DataFrame, first: float, last: float
) -> tuple[pd.DataFrame, float, float, list[Finding]]:
    """Keep the longest stretch in flight without a gap in any input and without a restart of its controller."""
    signals = signals[signals.notna().all(axis=1)]
    t = signals.index.to_numpy(np.float64)
    if len(t) < 2:
        raise MissingDataError(f"the {source.title} are never known all together")
    gaps = np.diff(t) > LONGEST_GAP
    broken = gaps | (np.searchsorted(source.restarts, t[1:]) > np.searchsorted(source.restarts, t[:-1]))
    at = np.flatnonzero(broken)
    begins, ends = np.concatenate([[0], at + 1]), np.concatenate([at, [len(t) - 1]])
    starts, stops = np.maximum(t[begins], first), np.minimum(t[ends], last)
    k = int(np.argmax(stops - starts))
    start, stop = float(starts[k]), float(stops[k])
    piece = signals.iloc[begins[k] : ends[k] + 1]
    inside = np.flatnonzero(broken & (t[1:] > first) & (t[:-1] < last))
    whole = min(last, float(t[-1])) - max(first, float(t[0]))
    if len(inside) == 0 or len(piece) < 2:
        return piece, start, stop, []
    restarts = int(np.sum(~gaps[inside]))
    longest = float(np.diff(t)[inside].max())
    if restarts == len(inside):
        what = f"the controller of the {source.title} starts anew {restarts} time(s) in flight"
    else:
        what = f"{source.title} are missing {len(inside) - restarts} time(s) in flight, for up to {longest:.1f} s"
    return (
        piece,
        start,
        stop,
        [
            warning(
                "log-gaps",
                f"{what}; {stop - start:.1f} of {whole:.1f} s in one piece are used",
                gaps=len(inside),
                restarts=restarts,
                used_seconds=stop - start,
            )
        ],
    )
