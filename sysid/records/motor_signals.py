"""Motor signals and rates fast enough for rotation, from what a log has of them.

Attitude control runs at 400 Hz; motor outputs are often logged at 10 Hz and show it in aliases only. Rates and the rate
controller's outputs are logged together and faster (ArduPilot's RATE). Where they are there, the four patterns of the
mixer (thrust, roll, pitch, yaw) are taken from them, scaled by the ratio of the motors' mean thrust to the controller's
thrust output, and from the motor outputs only what the patterns leave over.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from logparse import MissingDataError, Vehicle
from sysid.records.experiment import Experiment, Floats
from sysid.records.mixer import known_slope
from sysid.records.motor_scaling import curve_slope, motor_commands
from sysid.records.resampling import logged_rate
from sysid.records.thrust_curve import Law, column, thrust_signals

#: Rate of motor signals that shows rotation, Hz: ten times the bandwidth of attitude loops.
ENOUGH = 20.0

#: Time over which the scale of the controller's outputs is averaged, s, and the least thrust output to read it from.
SCALE_SECONDS, LEAST_THRUST = 10.0, 0.02

#: Slope of a thrust curve below which nothing is divided by it.
LEAST_SLOPE = 0.05

#: Source of the signals where the rate controller's outputs are not logged.
MOTOR_OUTPUTS = "motor outputs"

#: Part of the power of rates that motors must explain: noise and aliases in their signals bias effectiveness by up to
#: the rest.
EXPLAINED = 0.9


@dataclass(frozen=True, slots=True)
class MotorSignals:
    """Signals of the motors (N, n), rates (N, 3) [rad/s], and whether they show rotation."""

    signals: Floats
    rates: Floats
    fast: bool
    source: str


def motor_signals(record: Experiment, law: Law, vehicle: Vehicle, voltage: float | None, expo: float) -> MotorSignals:
    """Return the fastest signals that the record has.

    Commands do what the curve `expo` makes of them, about which the controller's outputs become commands by the curve
    in the parameters.
    """
    signals = thrust_signals(record, law, vehicle, voltage, expo)
    rates = np.column_stack([column(record, f"w_{axis}") for axis in "xyz"])
    if law is Law.SPEED:
        return MotorSignals(signals, rates, logged_rate(signals, record.dt) >= ENOUGH, "ESC speeds")
    outputs = np.column_stack([column(record, f"out_{name}") for name in ("thrust", "roll", "pitch", "yaw")])
    controller = np.column_stack([column(record, f"rate_{axis}") for axis in "xyz"])
    known = {f"m{motor.number}": motor for motor in vehicle.motors}
    logged = np.isfinite(outputs[:, 1:]).all() and np.isfinite(controller).all()
    if not (logged and set(record.input_names) <= set(known)):
        return MotorSignals(signals, rates, logged_rate(record.u, record.dt) >= ENOUGH, MOTOR_OUTPUTS)
    motors = [known[name] for name in record.input_names]
    factors = np.array([[1.0, motor.roll, motor.pitch, motor.yaw] for motor in motors])
    size = max(min(round(SCALE_SECONDS / record.dt), len(record.t)), 1)
    set_curve = thrust_signals(record, law, vehicle, voltage).mean(axis=1)
    if not np.isfinite(outputs[:, 0]).all():
        outputs[:, 0] = set_curve
    # Where motor outputs follow the controller by another factor than the parameters say, motors do so.
    command = _moving_mean(np.clip(motor_commands(record.u, vehicle), 0.0, 1.0).mean(axis=1), size)
    steeper = curve_slope(command, expo) / np.maximum(curve_slope(command, vehicle.thrust_expo), LEAST_SLOPE)
    outputs[:, 1:] *= known_slope(record.findings) * steeper[:, None]
    mean, asked = _moving_mean(set_curve, size), _moving_mean(outputs[:, 0], size)
    scale = np.where(asked > LEAST_THRUST, mean / np.maximum(asked, LEAST_THRUST), 1.0)
    slow = signals - signals @ np.linalg.pinv(factors).T @ factors.T
    return MotorSignals(
        slow + scale[:, None] * (outputs @ factors.T),
        controller,
        logged_rate(outputs, record.dt) >= ENOUGH,
        "rate controller's outputs",
    )


def unexplained(part: float, what: str) -> str:
    """Explain why an effectiveness is not believed; empty when motors explain enough of what the craft did."""
    if part >= EXPLAINED:
        return ""
    return f"motors explain only {100.0 * max(part, 0.0):.0f} % of the {what}: wind or slow logs do the rest"


def _moving_mean(values: Floats, size: int) -> Floats:
    """Mean over `size` samples centred on each, shorter at the ends."""
    kernel = np.ones(size)
    return np.asarray(np.convolve(values, kernel, "same") / np.convolve(np.ones(len(values)), kernel, "same"))


@dataclass(frozen=True, slots=True)
class MotorGeometry:
    """Directions of the arms and of rotation."""

    #: shape (n,): Position of each motor in arms: cosine and sine of its angle from the nose. Thrust there pitches the
    #: nose up by `forward` and rolls to the left by `right`.
    forward: Floats
    right: Floats
    #: shape (n,): +1 clockwise seen from above (its torque turns the nose to the left), -1 counter-clockwise, 0
    #: unknown.
    spin: Floats
    factors: Floats  #: shape (n, 3): Of the mixer, for roll, pitch and yaw.

    @property
    def levers(self) -> Floats:
        """Lever of every motor about roll and pitch, in arms; for yaw the sense of its torque; shape (3, n)."""
        return np.vstack([-self.right, self.forward, -self.spin])


def motor_geometry(record: Experiment) -> MotorGeometry:
    """Look the record's motors up in its craft."""
    motors = {f"m{motor.number}": motor for motor in (record.vehicle.motors if record.vehicle is not None else ())}
    unknown = [name for name in record.input_names if name not in motors]
    if unknown:
        raise MissingDataError(
            f"{record.name}: where motor {', '.join(unknown)} sits is not known, so that moments cannot be computed; "
            "log parameters (FRAME_CLASS, FRAME_TYPE)"
        )
    used = [motors[name] for name in record.input_names]
    return MotorGeometry(
        forward=np.array([np.cos(motor.angle) for motor in used]),
        right=np.array([np.sin(motor.angle) for motor in used]),
        spin=np.array([float(motor.spin) for motor in used]),
        factors=np.array([[motor.roll, motor.pitch, motor.yaw] for motor in used]),
    )
