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

from collections.abc import Iterable

import numpy as np
import pandas as pd

from core.cubic_spline import cubic_spline
from logparse import Finding, MissingDataError, Severity, Tables, Vehicle
from logparse.tables import between
from sysid.records import Floats
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


#: Name of the finding; its evidence ``slope`` is the factor.
MIXER_DIFFERS = "parameters-not-flown"

#: Departure of the factor from one that is a finding: firmware keeps 4 % (its limits of yaw, rounding).
DIFFERS = 0.06

#: Coherence (R^2) of outputs with the controller's below which nothing is said: noise would pass for a factor.
_COHERENT = 0.95

#: Fewest rows of outputs, and the time between the controller's rows beyond which nothing is interpolated, s.
FEWEST, GAP = 100, 0.3

#: Commands nearer to the ends of a motor's range than this are left out: there the mixer gives what it can.
MARGIN = 0.02


def mixer_differs(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> list[Finding]:
    """Compare the outputs' movement in roll and pitch with what the controller asked.

    To first order a motor's thrust by the curve in the parameters departs from the mean of all as much as the mixer's
    sum for it departs from the thrust asked. Where it departs by another factor, the parameters in the log are not
    those flown with, and that factor makes torque of outputs. PX4 scales its allocation in ways of its own, so that
    there the factor is none of the parameters' fault.
    """
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if not names or tables.motors is None or not tables.has("rates"):
        return []
    if not set(names) <= set(tables.motors):
        return []
    motors = tables.motors.loc[start:stop, names].dropna()
    t = motors.index.to_numpy(np.float64)
    asked = []
    for column in tables.columns("rates", ["out_thrust", "out_roll", "out_pitch", "out_yaw"]):
        if column.notna().sum() < FEWEST:
            return []
        asked.append(sampled_at(t, between(column, start - 1.0, stop + 1.0).dropna()))
    outputs = np.column_stack(asked)
    command = motor_commands(motors.to_numpy(np.float64), vehicle)
    inside = np.all((command > MARGIN) & (command < 1.0 - MARGIN), axis=1)
    inside &= np.isfinite(outputs).all(axis=1) & (outputs[:, 0] > MARGIN) & (np.abs(outputs) < 1.0).all(axis=1)
    if inside.sum() < FEWEST:
        return []
    factors = factors_of(vehicle)
    to_axes = np.linalg.pinv(factors - factors.mean(axis=0))[:2].T
    given = curve(command[inside], vehicle.thrust_expo)
    wanted = expectation(outputs[inside], factors)
    slope = common_slope(*((part / part.mean(axis=1, keepdims=True)) @ to_axes for part in (wanted, given)))
    if slope is None or abs(slope - 1.0) < DIFFERS:
        return []
    more = f"{100.0 * abs(slope - 1.0):.0f} % {'more' if slope > 1.0 else 'less'}"
    if vehicle.autopilot == "PX4":
        severity, why, advice = Severity.INFO, "than the frame's geometry makes of them", ""
    else:
        severity, advice = Severity.WARNING, "check that the parameters are those of this flight"
        why = (
            "than the parameters say: MOT_THST_EXPO, MOT_SPIN_MIN, MOT_SPIN_MAX or the PWM range in the log are not "
            "those flown with"
        )
    reason = f"motor outputs follow the rate controller {more} {why}; effectiveness is corrected by it"
    return [Finding(MIXER_DIFFERS, severity, reason, advice, {"slope": slope})]


def common_slope(wanted: Floats, given: Floats) -> float | None:
    """Return the slope of what was given over what was wanted, of the axes that agree well enough to tell one.

    `wanted, given` (N, axes).
    """
    x, y = wanted - wanted.mean(axis=0), given - given.mean(axis=0)
    both, own, other = (np.sum(a * b, axis=0) for a, b in ((x, y), (x, x), (y, y)))
    with np.errstate(divide="ignore", invalid="ignore"):
        good = (both > 0.0) & (both**2 > _COHERENT * own * other)
    return float(both[good].sum() / own[good].sum()) if good.any() else None


def known_slope(findings: Iterable[Finding]) -> float:
    """Return the factor that a record's findings state; 1 where its parameters are those flown."""
    return next((float(f.evidence["slope"] or 1.0) for f in findings if f.id == MIXER_DIFFERS), 1.0)


def sampled_at(t: Floats, column: pd.Series) -> Floats:
    """Sample a column at given times by a cubic spline; NaN outside and where its samples lie apart."""
    at = column.index.to_numpy(np.float64)
    if len(at) < 4:
        return np.full(len(t), np.nan)
    after = np.clip(np.searchsorted(at, t), 1, len(at) - 1)
    known = (t >= at[0]) & (t <= at[-1]) & (at[after] - at[after - 1] < GAP)
    return np.where(known, cubic_spline(at, column.to_numpy(np.float64)[:, None], t)[:, 0], np.nan)
