"""Input sets of a flight: what can be taken for the cause of its motion, and in which frame it is expressed.

==========================  ===========================================================================================
``motors``                  PWM in us by motor number: ``m1 ...``
``rotor_speeds``            speed of the rotors as their ESCs report it, rad/s by motor number: ``m1 ...``
``mixer``                   ``thrust roll pitch yaw`` of the motors' outputs, see `sysid.records.mixer`
``rate_outputs``            ``roll pitch yaw throttle`` as the rate and height controllers gave them to the mixer
``reference``               ``x y z``: where the position controller wanted the craft, m north, east, up of the record's
                            first position, so that reference less position is the controller's error
``velocity_reference``      ``v_x v_y v_z``: velocity asked of the craft, m/s north, east, up
==========================  ===========================================================================================

A craft that turns is one linear system only when cause and effect are expressed in one frame. ``frame="heading"``
does that with the measured yaw:

- ``mixer`` and ``rate_outputs``: roll and pitch are turned into the earth frame and called ``tilt_x`` and ``tilt_y``,
  the commands that tip the thrust towards north and east; outputs stay in the earth frame. The thrust axis obeys
  rolling and pitching wherever the nose points, so this is exact for a craft whose roll and pitch are alike, but for
  the gyroscopic terms of fast turns.
- ``motors`` and ``rotor_speeds``: they are bolted to the craft. Instead, what is measured is turned into its heading:
  ``forward`` and ``right`` are the increments of position along and across the nose, summed
  (`sysid.records.flight_record`). It neglects that turning at speed v by r rad/s shows as an acceleration ``r v``
  without any input.
- ``reference`` and ``velocity_reference``: reference and position are both of the earth, and the position controller
  works there, so nothing is turned.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd
import pymap3d

from core.findings import info, warning
from logparse import Finding, MissingDataError, Severity, Tables, Vehicle
from logparse.tables import framed
from sysid.records import Floats
from sysid.records.context import angles_of
from sysid.records.mixer import project, voltage_at

if TYPE_CHECKING:
    from estimation import Trajectory

#: Sets of inputs by their public names.
INPUT_SETS = ("motors", "rotor_speeds", "mixer", "rate_outputs", "reference", "velocity_reference")

#: A jump this near to a change of mode is a restart of the controller, s.
RESTART = 1.0

#: Modes of ArduCopter and PX4 in which a person or another controller flies, and no position is held.
_WITHOUT_POSITION = frozenset(
    (
        "STABILIZE",
        "STABILIZED",
        "ACRO",
        "ALT_HOLD",
        "SPORT",
        "DRIFT",
        "FLIP",
        "SYSTEMID",
        "AUTOTUNE",
        "MANUAL",
        "ALTITUDE",
    )
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Inputs:
    """Input signals as logged, before they come to the record's clock."""

    #: Index `t`; NaN where the signal has no meaning, such as a position target while nobody holds a position.
    signals: pd.DataFrame
    unit: str
    title: str  #: What they are, for messages.
    #: Times between which the signals may be used in one piece, s.
    restarts: Floats = field(default_factory=lambda: np.empty(0))
    #: shape (K, 2): Times [s] and sizes of jumps within a piece.
    steps: Floats = field(default_factory=lambda: np.empty((0, 2)))
    findings: tuple[Finding, ...] = ()


def read_inputs(tables: Tables, vehicle: Vehicle, trajectory: Trajectory, kind: str, frame: str) -> Inputs:
    """Read one of the `INPUT_SETS` from a log's tables."""
    if kind == "reference":
        return _reference(tables, trajectory)
    if kind == "mixer":
        return _turned(_mixer(tables, vehicle), trajectory, frame)
    if kind == "rate_outputs":
        return _turned(_rate_outputs(tables), trajectory, frame)
    return {"motors": _motors, "rotor_speeds": _rotor_speeds, "velocity_reference": _velocity_reference}[kind](tables)


def _motors(tables: Tables) -> Inputs:
    motors = tables.motors
    if motors is None or motors.empty:
        raise MissingDataError(
            "no motor outputs (RCOU, or SERVO_OUTPUT_RAW in telemetry); log them (rotorid inspect names the setting)"
        )
    return Inputs(signals=motors, unit="us", title="motor outputs")


def _rotor_speeds(tables: Tables) -> Inputs:
    esc = tables.esc
    names = {} if esc is None else {name: f"m{str(name)[1:]}" for name in esc if str(name)[:1] == "w"}
    if esc is None or not any(esc[name].gt(0.0).sum() > 1 for name in names):
        raise MissingDataError("no rotor speeds (ESC messages with RPM; ESCs with telemetry report them)")
    return Inputs(signals=esc[list(names)].rename(columns=names), unit="rad/s", title="rotor speeds")


def _mixer(tables: Tables, vehicle: Vehicle) -> Inputs:
    motors = _motors(tables).signals
    voltage = voltage_at(tables.battery, motors.index.to_numpy(np.float64))
    return Inputs(signals=project(motors, vehicle, voltage), unit="1", title="motor outputs")


def _rate_outputs(tables: Tables) -> Inputs:
    columns = {"out_roll": "roll", "out_pitch": "pitch", "out_yaw": "yaw", "out_thrust": "throttle"}
    table = tables.rates
    if table is None or any(table[name].notna().sum() < 2 for name in ("out_roll", "out_pitch", "out_yaw")):
        raise MissingDataError(
            "no outputs of the rate controller (RATE messages of DataFlash logs; telemetry does not carry them); "
            "log them (rotorid inspect names the setting)"
        )
    signals = table[list(columns)].rename(columns=columns)
    findings: list[Finding] = []
    if signals["throttle"].notna().sum() < 2:
        throttle = tables.column("setpoints", "throttle")
        if throttle is None or len(throttle := throttle.dropna()) < 2:
            raise MissingDataError(
                "the rate controller's outputs have no throttle (RATE.AOut, CTUN.ThO); log one of the two"
            )
        t = signals.index.to_numpy(np.float64)
        inside = (t >= throttle.index[0]) & (t <= throttle.index[-1])
        values = np.interp(t, throttle.index.to_numpy(np.float64), throttle.to_numpy())
        signals = signals.assign(throttle=np.where(inside, values, np.nan))
        findings.append(
            info(
                "not-logged",
                "RATE does not log the throttle; it is taken from CTUN, which is slower",
                "log the rate controller at the rate of the loop (rotorid inspect names the setting)",
            )
        )
    return Inputs(signals=signals, unit="1", title="rate controller outputs", findings=tuple(findings))


def _turned(inputs: Inputs, trajectory: Trajectory, frame: str) -> Inputs:
    """Express roll and pitch commands in the earth frame: pitch up pushes backward, roll right pushes right."""
    if frame == "earth":
        return inputs
    signals = inputs.signals
    states = trajectory.states
    t = signals.index.to_numpy(np.float64)
    yaw = np.interp(t, states.index.to_numpy(np.float64), yaw_of(states))
    forward, right = -signals["pitch"].to_numpy(np.float64), signals["roll"].to_numpy(np.float64)
    turned = {
        "roll": ("tilt_x", np.cos(yaw) * forward - np.sin(yaw) * right),
        "pitch": ("tilt_y", np.sin(yaw) * forward + np.cos(yaw) * right),
    }
    columns: dict[str, Floats] = dict(
        turned.get(str(name), (str(name), signals[name].to_numpy(np.float64))) for name in signals.columns
    )
    return replace(inputs, signals=pd.DataFrame(columns, index=signals.index))


def yaw_of(states: pd.DataFrame) -> Floats:
    """Heading of a trajectory's states, rad, unwrapped."""
    return angles_of(states[["q_w", "q_x", "q_y", "q_z"]].to_numpy(np.float64))["yaw"]


def _reference(tables: Tables, trajectory: Trajectory) -> Inputs:
    names, states = ["p_n", "p_e", "p_d"], trajectory.states
    targets = framed(_no_finer(column, states) for column in tables.columns("setpoints", names))
    if targets is None or len(targets := targets.dropna()) < 2:
        raise MissingDataError(_no_reference(tables, "position", "PSCN, PSCE and PSCD"))
    t = targets.index.to_numpy(np.float64)
    position = np.column_stack(
        [np.interp(t, states.index.to_numpy(np.float64), states[name].to_numpy(np.float64)) for name in names]
    )
    wanted = targets.to_numpy(np.float64) + _between_origins(tables, trajectory)
    findings = []
    offset = np.median(position - wanted, axis=0)
    apart = np.abs(offset) > 1.0
    if apart.any():
        wanted = wanted + np.where(apart, offset, 0.0)
        axes = ", ".join(axis for axis, far in zip(("north", "east", "down"), apart, strict=True) if far)
        findings.append(
            Finding(
                "reference-doubtful",
                Severity.WARNING,
                f"position targets and positions are {float(np.max(np.abs(offset))):.1f} m apart on the whole "
                f"({axes}), as when they count from different origins; the targets are moved by it",
                "",
                dict(zip(("north", "east", "down"), map(float, offset), strict=True)),
            )
        )
    signals = pd.DataFrame(wanted * [1.0, 1.0, -1.0], index=targets.index, columns=["x", "y", "z"])
    restarts, steps = _jumps(t, wanted - position, tables, position)
    return Inputs(
        signals=signals,
        unit="m",
        title="position targets",
        restarts=restarts,
        steps=steps,
        findings=tuple(findings),
    )


def _no_finer(column: pd.Series[float], states: pd.DataFrame) -> pd.Series[float]:
    """Keep rows of a target about as far apart as those of the trajectory: the table has them at its fastest rate."""
    if len(column) < 2 or len(states) < 2:
        return column
    ours, theirs = (float(np.median(np.diff(table.index))) for table in (column, states))
    return column.iloc[:: max(round(theirs / ours), 1)]


def _velocity_reference(tables: Tables) -> Inputs:
    asked, corrected = ["v_n_ref", "v_e_ref", "v_d_ref"], ["v_n", "v_e", "v_d"]
    table = tables.part("setpoints", asked + corrected)
    findings: tuple[Finding, ...] = ()
    targets = None if table is None else table[asked].dropna()
    if (targets is None or len(targets) < 2) and table is not None:
        targets = table[corrected].dropna()
        findings = (
            warning(
                "reference-doubtful",
                "this log has velocity targets only after the position controller added its correction; they contain "
                "the measured position, so that a free run from them is no test of a model",
                "firmware since 4.1 logs the velocity asked for apart (PSCN.DVN)",
            ),
        )
    if targets is None or len(targets) < 2:
        raise MissingDataError(_no_reference(tables, "velocity", "PSCN, PSCE and PSCD"))
    signals = pd.DataFrame(
        targets.to_numpy(np.float64) * [1.0, 1.0, -1.0], index=targets.index, columns=["v_x", "v_y", "v_z"]
    )
    return Inputs(signals=signals, unit="m/s", title="velocity targets", findings=findings)


def _no_reference(tables: Tables, kind: str, messages: str) -> str:
    """Explain why there is no reference: nobody flew by it, or it was not logged."""
    modes = [] if tables.modes is None else list(dict.fromkeys(str(mode) for mode in tables.modes["mode"]))
    if modes and set(modes) <= _WITHOUT_POSITION:
        return (
            f"no {kind} targets: the flight was flown in {', '.join(modes)}, where no position is held; "
            "closed-loop models need LOITER, GUIDED or AUTO"
        )
    return (
        f"no {kind} targets (no {messages}; NTUN of firmware before 4.0, POSITION_TARGET_LOCAL_NED in telemetry); "
        "log the targets of the position controller (navigation tuning); for telemetry request that message"
    )


def _between_origins(tables: Tables, trajectory: Trajectory) -> Floats:
    """Place of the autopilot's origin in the trajectory's frame, NED, m."""
    ours, its = getattr(trajectory, "origin", None), tables.origin
    if ours is None or its is None:
        return np.zeros(3)
    place = pymap3d.geodetic2ned(its.lat, its.lon, its.alt, ours.lat, ours.lon, ours.alt, deg=False)
    return np.array([float(value) for value in place])


def _jumps(t: Floats, error: Floats, tables: Tables, position: Floats) -> tuple[Floats, Floats]:
    """Distinguish targets that jump because the loop was set up anew from targets that are steps asked of it.

    A loop is set up anew at a change of mode, and when the autopilot's own estimate jumps with the target.

    Returns times at which the loop was set up anew [s], and (K, 2) times [s] and sizes [m] of the other jumps.
    """
    limit = 0.5 + 2.0 * np.diff(t)
    size = np.abs(np.diff(error, axis=0)).max(axis=1)
    # Over a gap nothing is known of how the target came to be where it is.
    jumped = (size > limit) & (np.diff(t) < RESTART)
    if not jumped.any():
        return np.empty(0), np.empty((0, 2))
    changes = np.empty(0) if tables.modes is None else tables.modes.index.to_numpy(np.float64)
    middle = 0.5 * (t[1:] + t[:-1])
    near = np.array([bool(len(changes)) and float(np.min(np.abs(changes - at))) < RESTART for at in middle])
    moved = np.zeros(len(middle), dtype=bool)
    own = None if tables.ekf is None else tables.ekf[["p_n", "p_e", "p_d"]].dropna()
    if own is not None and len(own) > 1:
        at = np.column_stack(
            [np.interp(t, own.index.to_numpy(np.float64), own[name].to_numpy(np.float64)) for name in own.columns]
        )
        moved = np.abs(np.diff(at - position, axis=0)).max(axis=1) > limit
    anew = jumped & (near | moved)
    asked = jumped & ~anew
    return middle[anew], np.column_stack([middle[asked], size[asked]])
