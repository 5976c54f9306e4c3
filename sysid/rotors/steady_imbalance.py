"""A motor that is weak from the beginning of a flight, by what the controller steadily asks of all motors.

The controller restores the moments in three ways only (roll, pitch, yaw), and the mixer spreads each over all motors.
With the mixer's factors as orthonormal columns Q (motors, 3) and the motors' mean thrusts s over their mean, the trims
``z = Q^T s`` hold all that it does. A motor k that gives the part d less than it is told leads to ``z = d s_k q_k``,
with q_k the k-th row of Q: to roll, pitch and yaw in one proportion. A centre of gravity beside the middle leads to
roll and pitch only, in any direction; motors twisted about their arms to yaw only. So one motor is named where it
explains all three and neither of the others does. Both together may be in a motor's proportion by chance: trims of 0.1
to 0.3 are ordinary on real craft, of which one in 29 flights is, so that this is no more than a hint, and a motor that
is weak stays weak: where other flights of the craft are known, either all of them together or the change against the
others must name the motor too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from logparse import Finding, MissingDataError, Severity, Tables, Vehicle
from sysid.records.arrays import Floats
from sysid.records.mixer import INDEPENDENT, factors_of
from sysid.records.motor_scaling import curve, motor_commands
from sysid.rotors.steady_trims import SteadyTrims

#: Thrust of motors of one kind at one signal differs by this part (standard deviation).
ALIKE = 0.03

#: Trims of one craft differ by this from flight to flight (standard deviation): loads and batteries lie elsewhere.
AGAIN = 0.015

#: Part of the trims by which a motor's pattern may err: thrust curves, limits of the mixer.
PATTERN = 0.05

#: Time after lift-off and before landing that is left out, and the shortest flight that tells, s.
_LIFT_OFF, _SHORTEST = 4.0, 20.0
#: Rates [rad/s] and specific forces [m/s^2] beyond this were never measured.
_WILD = 1e4

#: Time over which means are taken, s, and number of what else makes moments.
BLOCK, _NUISANCES = 2.0, 5

#: Smallest loss of thrust that is named.
SMALLEST = 0.1

#: Squared distances of what one motor leaves unexplained (two degrees of freedom, 5 %), and of what the others leave
#: (one degree of freedom for the centre of gravity, two for a twist: 0.3 %).
_FITS, _NOT_BALANCE, _NOT_TWIST = 6.0, 9.0, 11.6

#: The first for a change, which is there whatever explains it (0.1 %).
_FITS_CHANGE = 13.8


def steady_trims(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> SteadyTrims | None:
    """Return the trims of a flight; None for a frame that cannot turn about every axis by its motors.

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
    names = tuple(f"m{motor.number}" for motor in vehicle.motors)
    if not names or tables.motors is None or not set(names) <= set(tables.motors):
        raise MissingDataError("what motors steadily give needs the frame and the outputs of all its motors")
    pwm = tables.motors.loc[start + _LIFT_OFF : stop - _LIFT_OFF, list(names)].dropna()
    if len(pwm) < 50 or pwm.index[-1] - pwm.index[0] < _SHORTEST:
        raise MissingDataError("the flight is too short to tell what motors steadily give")
    thrust = curve(np.clip(motor_commands(pwm.to_numpy(np.float64), vehicle), 0.0, 1.0), vehicle.thrust_expo)
    share = thrust / np.maximum(thrust.mean(axis=1, keepdims=True), 1e-9)
    factors = factors_of(vehicle)
    if np.any(np.abs(factors).max(axis=0) < INDEPENDENT):
        return None
    basis = np.linalg.qr(factors - factors.mean(axis=0))[0]
    trims, variance = _steady(share @ basis, pwm.index.to_numpy(np.float64), tables.imu)
    rows = share.mean(axis=0)[:, None] * basis
    return SteadyTrims(names, tuple(trims.tolist()), tuple(variance.tolist()), tuple(map(tuple, rows.tolist())))


def weak_from_start(flight: SteadyTrims, others: Sequence[SteadyTrims] = ()) -> tuple[Finding, ...]:
    """Name the motor whose weakness explains what the controller steadily asks for.

    Parameters
    ----------
    flight : SteadyTrims
    others : sequence of SteadyTrims
        Of other flights of the same craft, in any order.
    """
    found = _weak(np.array(flight.trims), np.array(flight.variance), flight)
    if found is None:
        return ()
    alike = [each for each in others if each.motors == flight.motors]
    if alike:
        whole, rest = _mean([flight, *alike]), _mean(alike)
        change = np.array(flight.trims) - rest[0], np.array(flight.variance) + rest[1]
        if found[0] not in [each[0] for each in (_weak(*whole, flight), _weak(*change, flight)) if each is not None]:
            return ()
    motor, loss, sigma = found
    return (
        Finding(
            "uneven-motor",
            Severity.INFO,
            f"roll, pitch and yaw are steadily trimmed as if motor {motor} gave {100.0 * loss:.0f} ± "
            f"{100.0 * sigma:.0f} % less thrust than the others at the same signal"
            f"{f', and so say {1 + len(alike)} flights' if alike else ''}; a centre of gravity to one side "
            "does not yaw, twisted motors do nothing else, and only both together could look the same",
            "check this motor, its propeller and its ESC; then the centre of gravity and the motors' angles",
            {"motor": motor, "loss": loss, "sigma": sigma, "flights": 1 + len(alike)},
        ),
    )


def changed_motor(flight: SteadyTrims, others: Sequence[SteadyTrims]) -> tuple[str, float, float] | None:
    """Return the motor that alone explains how trims differ from other flights', the part of thrust lost, its sigma.

    Parameters
    ----------
    flight : SteadyTrims
    others : sequence of SteadyTrims
        Of the same craft.

    Returns
    -------
    tuple or None
        The part is negative for a motor that gives more than in the others; None where no motor alone explains it.
    """
    mean, variance = _mean(others, AGAIN)
    change, sampled = np.array(flight.trims) - mean, np.array(flight.variance) + variance
    rows, found = dict(zip(flight.motors, np.array(flight.rows), strict=True)), []
    for sign in (1.0, -1.0):
        weak = _weak(sign * change, sampled, flight, AGAIN, _FITS_CHANGE)
        if weak is not None:
            motor, loss, sigma = weak
            left = float(np.linalg.norm(sign * change - loss * rows[motor]))
            found.append((left, (motor, sign * loss, sigma)))
    return min(found)[1] if found else None


def _weak(
    trims: Floats, sampled: Floats, flight: SteadyTrims, unlike: float = ALIKE, fits: float = _FITS
) -> tuple[str, float, float] | None:
    """Return the motor that explains trims, its loss and the loss's standard error; None where none does alone."""
    variance, rows = sampled + unlike**2 + (PATTERN * np.linalg.norm(trims)) ** 2, np.array(flight.rows)
    information = np.sum(rows**2 / variance, axis=1)
    loss = rows @ (trims / variance) / information
    left = np.sum((trims - loss[:, None] * rows) ** 2 / variance, axis=1)
    k = int(np.argmin(np.where(loss > 0.0, left, np.inf)))
    balance, twist = trims[2] ** 2 / variance[2], float(np.sum(trims[:2] ** 2 / variance[:2]))
    if not (loss[k] > SMALLEST and left[k] < fits and balance > _NOT_BALANCE and twist > _NOT_TWIST):
        return None
    return flight.motors[k], float(loss[k]), float(information[k] ** -0.5)


def _mean(flights: Sequence[SteadyTrims], unlike: float = ALIKE) -> tuple[Floats, Floats]:
    """Return the mean trims of flights, (3,), and their variance, (3,), by what they scatter if that is more."""
    trims = np.array([each.trims for each in flights])
    weights = 1.0 / (np.array([each.variance for each in flights]) + unlike**2)
    total = weights.sum(axis=0)
    mean = (weights * trims).sum(axis=0) / total
    scatter = (weights * (trims - mean) ** 2).sum(axis=0) / max(len(flights) - 1, 1)
    return mean, np.maximum(scatter, 1.0) / total


def _steady(trims: Floats, t: Floats, imu: pd.DataFrame | None) -> tuple[Floats, Floats]:
    """Return trims in steady flight, (3,), and their variance, (3,): without what turning and airspeed take.

    Turning takes moments with the angular acceleration and rate, airspeed with the specific force across the thrust.
    """
    size = max(round(BLOCK / float(np.median(np.diff(t)))), 1)
    count = len(t) // size

    def blocks(values: Floats) -> Floats:
        return np.asarray(values[: count * size].reshape(count, size, -1).mean(axis=1))

    if imu is not None:
        read = imu[["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y"]]
        # Damage leaves numbers that are none, or that no craft survives.
        imu = imu[(read.abs() < _WILD).all(axis=1)]
    means, z, variance = blocks(trims), np.empty(3), np.empty(3)
    for axis in range(3):
        columns = [np.ones(count)]
        if imu is not None and len(imu) > 1 and count > 3 * _NUISANCES:
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
