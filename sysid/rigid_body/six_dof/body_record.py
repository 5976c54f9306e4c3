"""What the equations of motion with six degrees of freedom read of one record, as plain arrays on its clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from logparse import MissingDataError, Motor, Vehicle
from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.records.motor_scaling import curve, motor_commands
from sysid.records.thrust_curve import relative_density
from sysid.rigid_body.body_motion import MeasuredMotion, measured_states
from sysid.rigid_body.six_dof._kernels import DRIVES, shifted_and_lagged

#: Names of inputs that are the commands of a mixer rather than single motors.
MIXER = ("thrust", "roll", "pitch", "yaw")


class BodyQuantity(StrEnum):
    """What the inputs of the motors are."""

    SPEED = "rad/s"
    PWM = "us"
    COMMAND = "1"


@dataclass(frozen=True, slots=True, kw_only=True)
class InputKinds:
    """How the inputs of a record act."""

    motors: tuple[int, ...]  #: Columns of the motors, in the order of `geometry`.
    geometry: tuple[Motor, ...]
    mixer: tuple[tuple[str, int], ...]  #: Commands of a mixer and their columns, instead of motors.
    further: tuple[int, ...]  #: Columns of further inputs, such as elevons.
    quantity: BodyQuantity  #: Of the motors or the mixer.
    names: tuple[str, ...]  #: Of all inputs.

    @property
    def thrusting(self) -> tuple[int, ...]:
        """Columns that thrust or turn the craft through its rotors."""
        return self.motors or tuple(at for _, at in self.mixer)

    @property
    def thrusting_names(self) -> tuple[str, ...]:
        """Names of the inputs that thrust or turn the craft through its rotors."""
        return tuple(self.names[at] for at in self.thrusting)

    @property
    def further_names(self) -> tuple[str, ...]:
        """Names of the further inputs."""
        return tuple(self.names[at] for at in self.further)


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyRecord(MeasuredMotion):
    """One record."""

    #: shape (N, m): Motors in rad/s, or as command 0..1; further inputs in the unit of the record less their trim.
    inputs: Floats
    speeds: bool  #: Motors are rotor speeds.


@dataclass(frozen=True, slots=True, kw_only=True)
class InputShape:
    """Parameters between inputs and drives, which enter the equations of motion nonlinearly."""

    #: Of the fit by name: ``delay_NAME`` [s; below zero of a telemetry that is late] and ``lag_NAME`` [s] of the inputs
    #: that thrust, or ``delay`` and ``lag`` of all; ``share_NAME`` of thrust and torque of each motor over the mean
    #: motor's, at equal speed or command; ``lag_further`` [s] of further inputs; ``expo``, curvature of thrust over
    #: command; ``thrust_drift``, change of thrust over thrust per second about the middle of each record, 1/s, as a
    #: battery runs down.
    values: Mapping[str, float] = field(default_factory=dict)
    #: Thrust of the same commands in each record over that of the mean record: batteries are not equally full.
    charges: Mapping[str, float] = field(default_factory=dict)
    scale: float  #: Strength of a rotor that counts as 1 over the number of rotors.
    reference_speed: float  #: Rotor speed that counts as 1, rad/s; 1 for commands.
    centre: Floats  #: Trim of the further inputs, in their unit.
    width: Floats  #: Change of each further input that counts as 1.

    def of_each(self, kind: str, names: Sequence[str], usual: float = 0.0) -> Floats:
        """Return what each of the named inputs has of a kind, or all have."""
        return np.array([self.values.get(f"{kind}_{name}", self.values.get(kind, usual)) for name in names])


def input_kinds(record: Experiment) -> InputKinds:
    """Sort the inputs of a record into motors, commands of a mixer, and the rest."""
    names = record.input_names
    known = {f"m{motor.number}": motor for motor in (record.vehicle.motors if record.vehicle is not None else ())}
    motors = tuple(k for k, name in enumerate(names) if name in known)
    called = ["thrust" if name == "throttle" else name for name in names]
    mixer = tuple((name, k) for k, name in enumerate(called) if name in MIXER)
    lost = [name for name in names if name.startswith("m") and name[1:].isdigit() and name not in known]
    if lost:
        raise MissingDataError(
            f"{record.name}: where motor {', '.join(lost)} sits is not known, so that torques cannot be computed; "
            "declare the frame or the places of the motors"
        )
    if not motors and len(mixer) < len(MIXER):
        raise MissingDataError(
            f"{record.name}: the inputs {', '.join(names)} are neither motors nor the thrust, roll, pitch and yaw of a "
            "mixer"
        )
    used = motors or tuple(at for _, at in mixer)
    units = {record.units.get(names[k], "") for k in used}
    quantity = (
        BodyQuantity.SPEED if units == {"rad/s"} else BodyQuantity.PWM if units == {"us"} else BodyQuantity.COMMAND
    )
    largest = float(np.nanmax(np.abs(record.u[:, list(motors)]), initial=0.0))
    if quantity is BodyQuantity.COMMAND and largest > 2.0:
        raise ExperimentError(
            f"{record.name}: the unit of the motors is not known, and {names[motors[0]]} ... reach {largest:.4g}, "
            "which no command from 0 to 1 does; give the experiment units, such as units={'m1': 'us', ...} or 'rad/s'"
        )
    return InputKinds(
        motors=motors,
        geometry=tuple(known[names[k]] for k in motors),
        mixer=() if motors else mixer,
        further=tuple(k for k in range(len(names)) if k not in used),
        quantity=quantity,
        names=names,
    )


def body_record(record: Experiment, kinds: InputKinds) -> BodyRecord:
    """Convert an experiment to the form of the equations of motion."""
    if record.context is None or record.output_names[:3] != ("x", "y", "z"):
        raise MissingDataError(f"{record.name}: the motion needs outputs x, y, z and a context with attitude and rates")
    states = measured_states(record)
    for what, columns in (("velocity", slice(3, 6)), ("rates", slice(15, 18)), ("attitude", slice(6, 15))):
        if not np.isfinite(states[:, columns]).all():
            raise MissingDataError(f"{record.name}: {what} is not known at every sample")
    inputs = record.u.astype(np.float64, copy=True)
    if kinds.quantity is BodyQuantity.PWM:
        used = list(kinds.thrusting)
        inputs[:, used] = motor_commands(inputs[:, used], record.vehicle or Vehicle())
    return BodyRecord(
        name=record.name,
        t=record.t,
        states=states,
        inputs=inputs,
        speeds=kinds.quantity is BodyQuantity.SPEED,
        density=relative_density(record),
    )


def drives(record: BodyRecord, kinds: InputKinds, shape: InputShape) -> Floats:
    """Compute what the inputs do in each sample interval, (N, 8 + further inputs), see `_kernels.DRIVES`."""
    n, dt = len(record.t), record.dt
    out = np.zeros((n, len(DRIVES) + len(kinds.further)))
    moved, *ends = (_moved(record, kinds, shape, side) for side in (0.0, -0.5, 0.5))
    charge = battery(record, shape)
    held = record.density * charge
    if kinds.motors:
        # The mean of the squares over the records is that of the strengths, which `scale` makes 1 in all.
        whole = shape.reference_speed**2 / shape.scale if record.speeds else 1.0 / moved.shape[1]
        shares = shape.of_each("share", kinds.thrusting_names, 1.0)
        strengths = moved**2 * whole * (shares - shares.mean() + 1.0) * held[:, None]
        # Rotors that thrust less from the same commands turn as much slower.
        moved, *ends = (signals * np.sqrt(charge)[:, None] for signals in (moved, *ends))
        spin = np.array([float(motor.spin) for motor in kinds.geometry])
        out[:, 0] = strengths.sum(axis=1)
        out[:, 1] = strengths @ np.array([-np.sin(motor.angle) for motor in kinds.geometry])
        out[:, 2] = strengths @ np.array([np.cos(motor.angle) for motor in kinds.geometry])
        out[:, 3] = strengths @ -spin
        out[:, 4] = moved @ spin
        out[:, 5] = (ends[0] - ends[1]) @ spin / dt
        out[:, 6] = moved.mean(axis=1)
    else:
        by_name = {name: moved[:, k] for k, (name, _) in enumerate(kinds.mixer)}
        out[:, 0] = by_name["thrust"] / shape.scale * held
        out[:, 1], out[:, 2], out[:, 3] = (by_name[axis] * held for axis in ("roll", "pitch", "yaw"))
        yaw = next(k for k, (name, _) in enumerate(kinds.mixer) if name == "yaw")
        out[:, 5] = (ends[1][:, yaw] - ends[0][:, yaw]) / dt
        out[:, 6] = np.sqrt(np.maximum(out[:, 0], 0.0))
    out[:, 7] = charge
    lag = shape.values.get("lag_further", 0.0)
    for k, at in enumerate(kinds.further):
        value = (record.inputs[:, at] - shape.centre[k]) / shape.width[k]
        out[:, len(DRIVES) + k] = shifted_and_lagged(value, 0.0, lag / dt)
    return out


def battery(record: BodyRecord, shape: InputShape) -> Floats:
    """Thrust of the same commands over that of the mean record at its middle, (N,); 1 for rotor speeds."""
    if record.speeds:
        return np.ones(len(record.t))
    run_down = 1.0 + shape.values.get("thrust_drift", 0.0) * (record.t - 0.5 * (record.t[0] + record.t[-1]))
    return np.asarray(shape.charges.get(record.name, 1.0) * run_down)


def _moved(record: BodyRecord, kinds: InputKinds, shape: InputShape, later: float) -> Floats:
    """Delay and lag the inputs that thrust, (N, inputs); `later` samples after the middle of the interval.

    Rotors come as their speed, which is what lags; a mixer's commands as they are.
    """
    inputs, dt = record.inputs[:, list(kinds.thrusting)], record.dt
    if kinds.motors and not record.speeds:
        inputs = np.sqrt(np.maximum(curve(inputs, shape.values["expo"]) / shape.scale * inputs.shape[1], 0.0))
    elif kinds.motors:
        inputs = inputs / shape.reference_speed
    times = [shape.of_each(kind, kinds.thrusting_names) / dt for kind in ("delay", "lag")]
    return np.column_stack(
        [
            shifted_and_lagged(np.ascontiguousarray(column), delay - later, lag)
            for column, delay, lag in zip(inputs.T, *times, strict=True)
        ]
    )
