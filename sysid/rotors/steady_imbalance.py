"""A motor that is weak from the beginning of a flight, by what the controller steadily asks of all motors.

The controller restores the moments in three ways only (roll, pitch, yaw), and the mixer spreads each over all motors.
With the mixer's factors as orthonormal columns Q (motors, 3) and the motors' mean thrusts s over their mean, the trims
``z = Q^T s`` hold all that it does. A motor k that gives the part d less than it is told leads to ``z = d s_k q_k``,
with q_k the k-th row of Q: to roll, pitch and yaw in one proportion. A centre of gravity beside the middle leads to
roll and pitch only, in any direction; motors twisted about their arms to yaw only. So one motor is named where it
explains all three and neither of the others does. Both together may be in a motor's proportion by chance: trims of 0.1
to 0.3 are ordinary on real craft, of which one in 29 flights is (of a craft whose other flights are not), so that this
is no more than a hint.
"""

from __future__ import annotations

import numpy as np
import pandas as pd

from logparse import Finding, MissingDataError, Severity, Tables, Vehicle
from sysid.records.arrays import Floats
from sysid.records.mixer import INDEPENDENT
from sysid.records.motor_scaling import curve, motor_commands

#: Thrust of motors of one kind at one signal differs by this part (standard deviation).
ALIKE = 0.03

#: Part of the trims by which a motor's pattern may err: thrust curves, limits of the mixer.
PATTERN = 0.05

#: Time after lift-off and before landing that is left out, and the shortest flight that tells, s.
_LIFT_OFF, _SHORTEST = 4.0, 20.0

#: Time over which means are taken, s, and number of what else makes moments.
BLOCK, _NUISANCES = 2.0, 5

#: Smallest loss of thrust that is named.
SMALLEST = 0.1

#: Squared distances of what one motor leaves unexplained (two degrees of freedom, 5 %), and of what the others leave
#: (one degree of freedom for the centre of gravity, two for a twist: 0.3 %).
_FITS, _NOT_BALANCE, _NOT_TWIST = 6.0, 9.0, 11.6


def weak_from_start(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> tuple[Finding, ...]:
    """Name the motor whose weakness explains what the controller steadily asks for.

    Parameters
    ----------
    tables : Tables
        With the outputs of all motors; the IMU helps.
    vehicle : Vehicle
        Whose frame is known.
    start, stop : float
        Airborne interval, s.

    Raises
    ------
    MissingDataError
        When the frame or a motor's output is missing, or the flight is too short.
    """
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if not names or tables.motors is None or not set(names) <= set(tables.motors):
        raise MissingDataError("what motors steadily give needs the frame and the outputs of all its motors")
    pwm = tables.motors.loc[start + _LIFT_OFF : stop - _LIFT_OFF, names].dropna()
    if len(pwm) < 50 or pwm.index[-1] - pwm.index[0] < _SHORTEST:
        raise MissingDataError("the flight is too short to tell what motors steadily give")
    thrust = curve(np.clip(motor_commands(pwm.to_numpy(np.float64), vehicle), 0.0, 1.0), vehicle.thrust_expo)
    share = thrust / np.maximum(thrust.mean(axis=1, keepdims=True), 1e-9)
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in vehicle.motors])
    if np.any(np.abs(factors).max(axis=0) < INDEPENDENT):
        return ()
    basis = np.linalg.qr(factors - factors.mean(axis=0))[0]
    z, sampled = _steady(share @ basis, pwm.index.to_numpy(np.float64), tables.imu)
    variance, mean = sampled + ALIKE**2 + (PATTERN * np.linalg.norm(z)) ** 2, share.mean(axis=0)
    rows = mean[:, None] * basis
    information = np.sum(rows**2 / variance, axis=1)
    loss = rows @ (z / variance) / information
    left = np.sum((z - loss[:, None] * rows) ** 2 / variance, axis=1)
    k = int(np.argmin(np.where(loss > 0.0, left, np.inf)))
    balance, twist = z[2] ** 2 / variance[2], float(np.sum(z[:2] ** 2 / variance[:2]))
    if not (loss[k] > SMALLEST and left[k] < _FITS and balance > _NOT_BALANCE and twist > _NOT_TWIST):
        return ()
    sigma = float(information[k] ** -0.5)
    return (
        Finding(
            "uneven-motor",
            Severity.INFO,
            f"roll, pitch and yaw are steadily trimmed as if motor {names[k]} gave {100.0 * loss[k]:.0f} ± "
            f"{100.0 * sigma:.0f} % less thrust than the others at the same signal; a centre of gravity to one side "
            "does not yaw, twisted motors do nothing else, and only both together could look the same",
            "check this motor, its propeller and its ESC; then the centre of gravity and the motors' angles",
            {"motor": names[k], "loss": float(loss[k]), "sigma": sigma},
        ),
    )


def _steady(trims: Floats, t: Floats, imu: pd.DataFrame | None) -> tuple[Floats, Floats]:
    """Return trims in steady flight, (3,), and their variance, (3,): without what turning and airspeed take.

    Turning takes moments with the angular acceleration and rate, airspeed with the specific force across the thrust.
    """
    size = max(round(BLOCK / float(np.median(np.diff(t)))), 1)
    count = len(t) // size

    def blocks(values: Floats) -> Floats:
        return np.asarray(values[: count * size].reshape(count, size, -1).mean(axis=1))

    means, z, variance = blocks(trims), np.empty(3), np.empty(3)
    for axis in range(3):
        columns = [np.ones(count)]
        if imu is not None and count > 3 * _NUISANCES:
            at, rate = imu.index.to_numpy(np.float64), imu[f"gyro_{'xyz'[axis]}"].to_numpy(np.float64)
            edges = (
                np.interp(t[: count * size : size], at, rate),
                np.interp(t[size - 1 : count * size : size], at, rate),
            )
            force = [np.interp(t, at, imu[f"accel_{name}"].to_numpy(np.float64)) for name in "xy"]
            columns += [edges[1] - edges[0], *blocks(np.column_stack([np.interp(t, at, rate), *force])).T]
        design = np.column_stack(columns)
        value, *_ = np.linalg.lstsq(design, means[:, axis], rcond=None)
        left = means[:, axis] - design @ value
        z[axis] = value[0]
        # Half of the blocks count: weather lasts longer than one.
        variance[axis] = 2.0 * float(left @ left) / max(count - len(value), 1) * np.linalg.pinv(design.T @ design)[0, 0]
    return z, variance
