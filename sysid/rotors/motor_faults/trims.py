"""A motor that is weak from the beginning of a flight, by what the controller steadily asks of all motors.

Of the moments of `sysid.rotors.motor_faults.moments` this is what neither turning nor airspeed explain: a motor k that
gives the part d less than it is told leads to ``z_a = d f_ak s_k`` about each axis a, with s_k its thrust over the mean
of all. A centre of gravity beside the middle leads to roll and pitch only, in any direction; motors twisted about their
arms to yaw only. So one motor is named where it explains all three and neither of the others does. Both together may be
in a motor's proportion by chance: trims of 0.1 to 0.3 are ordinary on real craft, of which one in 29 flights is
(peterbarker 1.BIN, seventh flight). A motor that is weak stays weak, so that one flight alone names none: all flights
of the craft together, or the change against the others, must name the same motor.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from logparse import Finding, MissingDataError, Severity, Tables, Vehicle
from sysid.records import Floats
from sysid.records.mixer import INDEPENDENT, factors_of
from sysid.rotors.motor_faults.moments import MEMORY, read_moments
from sysid.rotors.steady_trims import SteadyTrims
from sysid.statistics.covariance import long_run_variance

#: Thrust of motors of one kind at one signal differs by this part (standard deviation).
ALIKE = 0.03
#: Trims of one craft differ by this from flight to flight (standard deviation): loads and batteries lie elsewhere.
AGAIN = 0.015
#: Part of the trims by which a motor's pattern may err: thrust curves, limits of the mixer.
PATTERN = 0.05
#: Time after lift-off and before landing that is left out, and the shortest flight that tells, s.
_ASIDE, _SHORTEST = 4.0, 20.0
#: Columns of the moments without their drift, which the mean of a flight holds.
_STEADY = slice(0, 6)
#: Smallest loss of thrust that is named.
SMALLEST = 0.1
#: Squared distances of what one motor leaves unexplained (two degrees of freedom, 5 %), and of what the others leave
#: (one degree of freedom for the centre of gravity, two for a twist: 0.3 %).
_FITS, _NOT_BALANCE, _NOT_TWIST = 6.0, 9.0, 11.6
#: The first for a change, which is there whatever explains it (0.1 %).
_FITS_CHANGE = 13.8


def steady_trims(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> SteadyTrims | None:
    """Return the trims of a flight between start and stop [s]; None where its motors do not turn it about every axis.

    MissingDataError when the frame, a motor's output or the IMU is missing, or the flight is too short or logged
    slowly.
    """
    moments = read_moments(tables, vehicle, start + _ASIDE, stop - _ASIDE)
    if moments is None or moments.t[-1] - moments.t[0] < _SHORTEST:
        raise MissingDataError("the flight is too short to tell what motors steadily give")
    factors = factors_of(vehicle)
    if np.any(np.abs(factors).max(axis=0) < INDEPENDENT):
        return None
    length, trims, variance = np.linalg.norm(factors, axis=0), [], []
    level = moments.thrust.mean()
    for asked, columns, size in zip(moments.asked, moments.columns, length, strict=True):
        steady = columns[:, _STEADY]
        value = np.linalg.lstsq(steady, asked, rcond=None)[0]
        # At the mean thrust, without any turn or airspeed.
        still = np.array([1.0, level, 0.0, 0.0, 0.0, 0.0]) / (level * size)
        spread = long_run_variance(asked - steady @ value, MEMORY / moments.step)
        trims.append(float(still @ value))
        variance.append(spread * float(still @ np.linalg.pinv(steady.T @ steady) @ still))
    rows = (moments.thrust.mean(axis=0) / level)[:, None] * factors / length
    names = tuple(f"m{motor.number}" for motor in vehicle.motors)
    return SteadyTrims(names, tuple(trims), tuple(variance), tuple(map(tuple, rows.tolist())))


def weak_from_start(flight: SteadyTrims, others: Sequence[SteadyTrims]) -> tuple[Finding, ...]:
    """Name the motor whose weakness explains what the controller steadily asks for in this flight and in others."""
    alike = [other for other in others if other.motors == flight.motors]
    weak = _weak(np.array(flight.trims), np.array(flight.variance), flight)
    if weak is None or not alike:
        return ()
    whole, rest = _mean([flight, *alike]), _mean(alike)
    change = np.array(flight.trims) - rest[0], np.array(flight.variance) + rest[1]
    if weak[0] not in [named[0] for named in (_weak(*whole, flight), _weak(*change, flight)) if named is not None]:
        return ()
    motor, loss, sigma = weak
    return (
        Finding(
            "uneven-motor",
            Severity.INFO,
            f"roll, pitch and yaw are steadily trimmed as if motor {motor} gave {100.0 * loss:.0f} ± "
            f"{100.0 * sigma:.0f} % less thrust than the others at the same signal, and so say {1 + len(alike)} "
            "flights; a centre of gravity to one side does not yaw, twisted motors do nothing else, and only both "
            "together could look the same",
            "check this motor, its propeller and its ESC; then the centre of gravity and the motors' angles",
            {"motor": motor, "loss": loss, "sigma": sigma, "flights": 1 + len(alike)},
        ),
    )


def changed_motor(flight: SteadyTrims, others: Sequence[SteadyTrims]) -> tuple[str, float, float] | None:
    """Return the motor that alone explains how trims differ from other flights', the part of thrust lost, its sigma.

    The part is negative for a motor that gives more than in the others; None where no motor alone explains it.
    """
    mean, variance = _mean(others, AGAIN)
    change, sampled = np.array(flight.trims) - mean, np.array(flight.variance) + variance
    rows, candidates = dict(zip(flight.motors, np.array(flight.rows), strict=True)), []
    for sign in (1.0, -1.0):
        weak = _weak(sign * change, sampled, flight, AGAIN, _FITS_CHANGE)
        if weak is not None:
            motor, loss, sigma = weak
            left = float(np.linalg.norm(sign * change - loss * rows[motor]))
            candidates.append((left, (motor, sign * loss, sigma)))
    return min(candidates)[1] if candidates else None


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
    trims = np.array([flight.trims for flight in flights])
    weights = 1.0 / (np.array([flight.variance for flight in flights]) + unlike**2)
    total = weights.sum(axis=0)
    mean = (weights * trims).sum(axis=0) / total
    scatter = (weights * (trims - mean) ** 2).sum(axis=0) / max(len(flights) - 1, 1)
    return mean, np.maximum(scatter, 1.0) / total
