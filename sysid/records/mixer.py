"""What the mixer asked of the motors, from what the motors got: thrust, roll, pitch and yaw.

ArduPilot adds the four commands with the frame's factors and bends the sum by its thrust curve before it becomes PWM
(AP_MotorsMatrix, AP_Motors_Thrust_Linearization)::

    thrust_k = thrust + r_k roll + p_k pitch + y_k yaw        r, p, y: factors of `logparse.Motor`
    thrust_k = (1 - e) c V + e (c V)^2                        c: PWM_k between idle and full spin, 0 .. 1

with e = MOT_THST_EXPO and V the battery's voltage over MOT_BAT_VOLT_MAX (1 where the autopilot does not compensate it).
The four commands are the least-squares solution for the motors' thrusts; what is left over of an octocopter's eight
(four patterns that the mixer never asks for, and rounding) moves nothing.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from logparse import MissingDataError, Vehicle
from sysid.records.arrays import Floats
from sysid.records.motor_scaling import curve, motor_commands

#: Singular values of the factors below this part of the largest mean that a command has no effect of its own.
INDEPENDENT = 1e-6


def factors_of(vehicle: Vehicle) -> Floats:
    """Return the frame's factors of roll, pitch and yaw, shape (motors, 3)."""
    return np.array([[motor.roll, motor.pitch, motor.yaw] for motor in vehicle.motors])


def project(motors: pd.DataFrame, vehicle: Vehicle, voltage: Floats | None) -> pd.DataFrame:
    """Project motor outputs on the commands of the mixer.

    `voltage` (N,): V, on the same index; None when unknown. Returns ``thrust roll pitch yaw`` in parts of a motor's
    full thrust, without those that the frame's motors do not make (the yaw of a tricopter is made by a servo).
    """
    return patterns(thrust_commands(motors, vehicle, voltage), vehicle)


def thrust_commands(motors: pd.DataFrame, vehicle: Vehicle, voltage: Floats | None) -> pd.DataFrame:
    """Return what PWM outputs [us] ask of each motor, in parts of its full thrust.

    `voltage` (N,): V, on the same index; None when unknown.
    """
    command = np.clip(motor_commands(motors.to_numpy(np.float64), vehicle), 0.0, 1.0)
    if voltage is not None and vehicle.battery_voltage_max > 0.0:
        command = command * (voltage / vehicle.battery_voltage_max)[:, None]
    return pd.DataFrame(curve(command, vehicle.thrust_expo), index=motors.index, columns=motors.columns)


def voltage_at(battery: pd.DataFrame | None, t: Floats) -> Floats | None:
    """Interpolate the voltage [V] of a battery's table at the times `t` [s]; None without any."""
    if battery is None:
        return None
    known = battery["voltage"][battery["voltage"] > 1.0]
    return np.interp(t, known.index.to_numpy(np.float64), known.to_numpy(np.float64)) if len(known) > 1 else None


def patterns(thrust: pd.DataFrame, vehicle: Vehicle) -> pd.DataFrame:
    """Project the thrusts of motors, columns ``m1 ...``, on the commands of the mixer, in the unit of the thrusts."""
    names, made, allocation = _allocation(thrust, vehicle)
    projected = thrust[names].to_numpy(np.float64) @ np.linalg.pinv(allocation).T
    return pd.DataFrame(projected, index=thrust.index, columns=made)


def rounding(motors: pd.DataFrame, vehicle: Vehicle) -> dict[str, float]:
    """Return the standard deviation that rounding PWM to 1 us leaves in each command of the mixer.

    In parts of a motor's full thrust; nothing where PWM is not in whole microseconds.
    """
    names, made, allocation = _allocation(motors, vehicle)
    pwm = motors[names].to_numpy(np.float64)
    pwm = pwm[np.isfinite(pwm).all(axis=1)]
    if not len(pwm) or np.any(pwm != np.round(pwm)):
        return {}
    middle = pwm.mean(axis=0)
    slope = curve(motor_commands(middle + 0.5, vehicle), vehicle.thrust_expo) - curve(
        motor_commands(middle - 0.5, vehicle), vehicle.thrust_expo
    )
    # Of a uniform error between -0.5 and 0.5 us.
    noise = np.linalg.norm(np.linalg.pinv(allocation) * slope, axis=1) / np.sqrt(12.0)
    return dict(zip(made, map(float, noise), strict=True))


def _allocation(motors: pd.DataFrame, vehicle: Vehicle) -> tuple[list[str], list[str], Floats]:
    """Motors, commands that they make, and the factors of these commands, (motors, commands)."""
    if not vehicle.motors:
        raise MissingDataError(
            "the frame is unknown, so that motors cannot be projected on thrust, roll, pitch and yaw; "
            "the log needs the parameters (FRAME_CLASS, FRAME_TYPE), which are written when it starts"
        )
    names = [f"m{motor.number}" for motor in vehicle.motors]
    absent = [name for name in names if name not in motors]
    if absent:
        raise MissingDataError(
            f"no output is logged for {', '.join(absent)}, and without it the thrust, roll, pitch and yaw of the "
            "others are unknown; check SERVOn_FUNCTION of these motors"
        )
    factors = {"thrust": np.ones(len(names)), **dict(zip(("roll", "pitch", "yaw"), factors_of(vehicle).T, strict=True))}
    made = [name for name, values in factors.items() if np.max(np.abs(values)) > INDEPENDENT]
    allocation = np.column_stack([factors[name] for name in made])
    if np.linalg.matrix_rank(allocation, tol=INDEPENDENT * np.linalg.norm(allocation)) < len(made):
        raise MissingDataError(
            f"the motors of a {vehicle.frame_class} do not make {', '.join(made)} independently of one another"
        )
    return names, made, allocation


def expectation(outputs: Floats, factors: Floats) -> Floats:
    """Return the thrust that the mixer asks of each motor for given outputs of the controllers.

    `outputs` (N, 4): thrust, roll, pitch and yaw (RATE's AOut, ROut, POut, YOut); `factors` (n, 3): roll, pitch and yaw
    factor of each motor (`logparse.Motor`). Returns (N, n): in parts of a motor's full thrust, before the mixer's
    limits and what the firmware does about voltage and density, which is the same factor for all motors.
    """
    return np.asarray(outputs[:, :1] + outputs[:, 1:] @ factors.T)
