"""When a motor begins to give less thrust than it is asked for: which one, since when, and how much.

A rate controller keeps the moments of all motors in balance, so the moments that the *outputs* would make show what it
must add. With outputs turned into thrust q_k by the autopilot's curve and f_ak the mixer's factor of motor k about axis
a (roll, pitch, yaw), a craft whose motor j loses the part x of its thrust at the time tau obeys::

    sum_k f_ak q_k = x f_aj q_j [t >= tau] + a Q + b Q t + c dw_a/dt + d w_a + e f_x + f f_y + g + noise

where Q is the mean thrust, w the angular rate, and f_x, f_y the specific force across the thrust axis, which goes with
airspeed and so takes up what wind and drag do to the moments. Position of the centre of gravity, its drift and the
inertia are nuisances, fitted with everything else; only x, j and tau matter, and x has the same value on all axes. The
time and motor with the largest likelihood ratio are those named (Page 1955; Basseville and Nikiforov 1993, section
2.4.3, generalised likelihood ratio for a change of known shape and unknown size). Noise is not white: its variance is
the long-run one, with Bartlett weights over three seconds (Newey and West 1987).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from logparse import MissingDataError, Tables, Vehicle
from sysid.records.experiment import Floats
from sysid.records.mixer import factors_of
from sysid.records.motor_scaling import curve, motor_commands

#: Slowest motor outputs and rates [Hz] in which a change is looked for.
_SLOWEST = 4.0
#: Time after lift-off and before landing that is left out [s]: the ground pushes there.
_LIFT_OFF, _LANDING = 2.0, 2.0
#: Shortest time before and after a change [s].
_BEFORE, _AFTER = 3.0, 0.4
#: Time over which noise may be correlated, s.
_MEMORY = 3.0

#: Smallest loss of thrust that is named, and its size in standard deviations.
SMALLEST, SURE = 0.10, 8.0
#: Chance that noise makes as large a score by itself. Shortly after the take-off noise is hardly known: its variance
#: then comes from as many independent pieces as there were times `_MEMORY` before the change, and Student's
#: distribution asks for more than `SURE` in the first 18 s.
_BY_CHANCE = 1e-4
#: The same score with the change itself still in the noise.
LIKELY = 3.0
#: Part of the best change of all three moments that one motor must explain: another cause changes them elsewhere.
_ONE_MOTOR = 0.8
#: Motors whose explanation is this good beside the best cannot be ruled out.
_ALIKE = 0.85
#: Part of the change's pattern that must not look like the nuisances.
_VISIBLE = 0.02
#: Time around the change in which it must show by itself [s], with this score and this part of the whole loss: wind,
#: heat and batteries change moments slowly, motors fail at once.
_AROUND, _SHARP, _SHARE = 8.0, 5.0, 0.5
#: Standard deviations by which the size of a loss must differ from zero.
_SIGMAS = 4.0
#: Part of a loss found before below which the next is what its subtraction left over.
_ECHO = 0.7
#: Most losses that are looked for, one after the other.
_MOST = 3

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorLoss:
    """A lasting loss of one motor's thrust."""

    motor: int  #: Number in the autopilot's frame.
    alternatives: tuple[int, ...]  #: Other motors that explain the change nearly as well; usually none.
    t: float  #: When it began, s.
    end: float  #: Last time looked at, s: the loss lasts until then.
    #: Part of the thrust that is missing, 0 to 1, and its standard deviation.
    loss: float
    sigma: float
    #: Part of the output above the lowest PWM that would give the thrust that is left: 0.8 of the output gives about
    #: 0.64 of the thrust.
    output: float
    score: float  #: Loss over its standard deviation in the search, which chooses time and motor.


@dataclass(frozen=True, slots=True)
class Moments:
    """Outputs and motion at the times of the motors' outputs."""

    t: Floats  #: shape (n,)
    thrust: Floats  #: shape (n, motors): Parts of a motor's full thrust.
    pwm: Floats  #: shape (n, motors): us.
    factors: Floats  #: shape (axes, motors)
    nuisances: list[Floats]  #: list of ndarray, shape (n, p): Orthonormal, of each axis.


def find_motor_losses(moments: Moments | None, vehicle: Vehicle) -> tuple[MotorLoss, ...]:
    """Find lasting losses of single motors in one flight.

    Parameters
    ----------
    moments : Moments or None
        Of `read_moments`, up to a crash.
    vehicle : Vehicle
        Whose frame is known.

    Returns
    -------
    tuple of MotorLoss
        In the order of time; empty where there is none, or where outputs or rates are too slow or too short to tell.
    """
    if moments is None:
        return ()
    numbers = [motor.number for motor in vehicle.motors]
    found: list[tuple[int, int]] = []
    losses: list[MotorLoss] = []
    for _ in range(_MOST):
        best = _search(moments, found)
        if best is None:
            break
        row, column, loss, score, alike = best
        if not _sharp(moments, found, row, column, loss) or _echo(losses, loss):
            break
        size = _size(moments, found, row, column, vehicle)
        if size.loss < _SIGMAS * size.sigma:
            break
        found.append((row, column))
        losses.append(
            MotorLoss(
                motor=numbers[column],
                alternatives=tuple(numbers[k] for k in alike),
                t=float(moments.t[row]),
                end=float(moments.t[-1]),
                loss=size.loss,
                sigma=size.sigma,
                output=size.output,
                score=score,
            )
        )
    return tuple(sorted(losses, key=lambda one: one.t))


def read_moments(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> Moments | None:
    """Read the moments that motor outputs make, and what else explains them; None where rows are few or slow.

    Parameters
    ----------
    tables : Tables
        With motors and IMU.
    vehicle : Vehicle
        Whose frame is known.
    start, stop : float
        Airborne interval, s.

    Raises
    ------
    MissingDataError
        Without the frame, the outputs of all its motors, or the IMU.
    """
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if not names:
        raise MissingDataError("the frame is unknown, so that no motor can be told from another; log parameters")
    if tables.motors is None or any(name not in tables.motors for name in names):
        raise MissingDataError("outputs of all motors of the frame are needed to find one that fails")
    if tables.imu is None:
        raise MissingDataError("angular rates and specific force (IMU) are needed to find a motor that fails")
    outputs = tables.motors.loc[start + _LIFT_OFF : stop, names].dropna()
    motion = tables.imu.loc[start : stop + 0.5]
    if motion.isna().to_numpy().any():  # a copy of a long log's IMU is half as large as the log
        motion = motion.dropna()
    t, at = outputs.index.to_numpy(np.float64), motion.index.to_numpy(np.float64)
    if len(t) < 30 or len(at) < 30:
        return None
    if min(len(t) / (t[-1] - t[0]), len(at) / (at[-1] - at[0])) < _SLOWEST:
        return None
    inside = (t > at[0]) & (t < at[-1])
    t, pwm = t[inside], outputs.to_numpy(np.float64)[inside]
    width = 0.5 * float(np.median(np.diff(t)))
    ends = _Ends.of(at, t - width), _Ends.of(at, t + width)
    names = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y"]
    moved, step = [motion[name].to_numpy(np.float64) for name in names], np.diff(at)
    felt = np.column_stack([_integral(step, column, ends) for column in moved]) / (2.0 * width)
    gyro, force = felt[:, :3], felt[:, 3:]
    # Change of the rate over the interval around each output.
    acceleration = np.column_stack([ends[1].of_signal(one) - ends[0].of_signal(one) for one in moved[:3]])
    acceleration /= 2.0 * width
    thrust = curve(np.clip(motor_commands(pwm, vehicle), 0.0, 1.0), vehicle.thrust_expo)
    factors = factors_of(vehicle).T
    axes = [axis for axis in range(3) if np.max(np.abs(factors[axis])) > 1e-6]
    mean = thrust.mean(axis=1)
    elapsed = (t - t.mean()) / max(t[-1] - t[0], 1e-9)
    nuisances = []
    for axis in axes:
        columns = np.column_stack(
            [np.ones(len(t)), mean, elapsed * mean, acceleration[:, axis], gyro[:, axis], force[:, 0], force[:, 1]]
        )
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
        nuisances.append(np.asarray(np.linalg.qr(columns)[0]))
    return Moments(t=t, thrust=thrust, pwm=pwm, factors=factors[axes], nuisances=nuisances)


@dataclass(frozen=True, slots=True, eq=False)
class _Ends:
    """Where times lie between the rows of a table."""

    before: NDArray[np.intp]  #: shape (n,): Row before each.
    part: Floats  #: shape (n,): Time since that row in parts of the step to the next.

    @classmethod
    def of(cls, at: Floats, t: Floats) -> _Ends:
        """Find times t [s] between those of rows [s]; beyond them the first or last row counts."""
        before = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
        return cls(before, np.clip((t - at[before]) / (at[before + 1] - at[before]), 0.0, 1.0))

    def of_signal(self, values: Floats) -> Floats:
        """Interpolate by straight lines."""
        first = values[self.before]
        return first + self.part * (values[self.before + 1] - first)


def _integral(step: Floats, values: Floats, ends: tuple[_Ends, _Ends]) -> Floats:
    """Integrate a signal of rows that lie steps [s] apart from one time to another."""
    integral = np.zeros(len(values))
    np.cumsum(0.5 * step * (values[1:] + values[:-1]), out=integral[1:])
    return np.asarray(ends[1].of_signal(integral) - ends[0].of_signal(integral))


def _search(moments: Moments, found: Sequence[tuple[int, int]]) -> tuple[int, int, float, float, list[int]] | None:
    """Find the motor and the time that explain most, with losses found before taken as given.

    Returns
    -------
    tuple or None
        Row, motor, loss, its score, and motors that explain the change nearly as well; None where no change
        is sure.
    """
    residuals, bases = _without(moments, found)
    variances = [_long_run_variance(residual, moments.t) for residual in residuals]
    # Noise before a change is known contains the change itself: what is likely is looked for first, then judged by
    # what is left of the noise without it. It is looked for among losses that can be named, or else a loss of a
    # hundredth about an axis in which nothing moved takes its place.
    one = 0.5 * _ONE_MOTOR
    likely = _best_step(moments, residuals, bases, variances, found, sure=LIKELY, one_motor=one, smallest=SMALLEST)
    if likely is None:
        return None
    row, column, loss = likely[:3]
    after = []
    for axis, (residual, basis) in enumerate(zip(residuals, bases, strict=True)):
        step = moments.factors[axis, column] * moments.thrust[:, column]
        step = np.where(np.arange(len(step)) >= row, step, 0.0)
        after.append(residual - loss * (step - basis @ (basis.T @ step)))
    variances = [_long_run_variance(residual, moments.t) for residual in after]
    best = _best_step(moments, residuals, bases, variances, found, sure=SURE, one_motor=_ONE_MOTOR)
    if best is None or best[3] < scipy.stats.t.isf(_BY_CHANCE, (moments.t[best[0]] - moments.t[0]) / _MEMORY):
        return None
    return best


def _without(moments: Moments, found: Sequence[tuple[int, int]]) -> tuple[list[Floats], list[Floats]]:
    """Moments of the outputs and bases of what else explains them, by axis; earlier losses are among the latter."""
    residuals, bases = [], []
    rows = np.arange(len(moments.t))
    for axis, basis in enumerate(moments.nuisances):
        steps = [
            np.where(rows >= row, moments.factors[axis, column] * moments.thrust[:, column], 0.0)
            for row, column in found
        ]
        whole = np.linalg.qr(np.column_stack([basis, *steps]))[0] if steps else basis
        moment = moments.thrust @ moments.factors[axis]
        residuals.append(np.asarray(moment - whole @ (whole.T @ moment)))
        bases.append(np.asarray(whole))
    return residuals, bases


def _best_step(
    moments: Moments,
    residuals: Sequence[Floats],
    bases: Sequence[Floats],
    variances: Sequence[float],
    found: Sequence[tuple[int, int]],
    *,
    sure: float,
    one_motor: float,
    smallest: float = 0.0,
) -> tuple[int, int, float, float, list[int]] | None:
    """Find the largest likelihood ratio over all motors and times; None where it is too small, or no single motor's."""
    shape = moments.thrust.shape
    numerator, denominator, power, free = (np.zeros(shape) for _ in range(4))
    for axis, (residual, basis, variance) in enumerate(zip(residuals, bases, variances, strict=True)):
        step = moments.factors[axis] * moments.thrust
        hits = _tail(step * residual[:, None])
        squares = _tail(step**2)
        # What the nuisances take of each step: the sums of their products from each row on.
        taken = sum(_tail(step * basis[:, [k]]) ** 2 for k in range(basis.shape[1]))
        left = np.maximum(squares - taken, 1e-12)
        numerator += hits / variance
        denominator += left / variance
        power += squares / variance
        alone = _tail(moments.thrust * residual[:, None])
        taken = sum(_tail(moments.thrust * basis[:, [k]]) ** 2 for k in range(basis.shape[1]))
        free += alone**2 / np.maximum(_tail(moments.thrust**2) - taken, 1e-12) / variance
    loss = numerator / denominator
    gain = numerator**2 / denominator
    t = moments.t
    allowed = (t >= t[0] + _BEFORE) & (t <= t[-1] - _AFTER)
    usable = allowed[:, None] & (loss > smallest) & (denominator > _VISIBLE * power)
    for _, column in found:
        usable[:, column] = False
    if not usable.any():
        return None
    ranked = np.where(usable, gain, 0.0)
    row, column = (int(k) for k in np.unravel_index(int(np.argmax(ranked)), shape))
    score = float(np.sqrt(ranked[row, column]))
    # A maximum at the first time that is allowed belongs to something before it, such as the take-off.
    inner = bool(allowed[max(row - 2, 0)])
    enough = inner and score >= sure and SMALLEST <= loss[row, column] <= 1.5
    if not enough or ranked[row, column] < one_motor * free[row, column]:
        return None
    alike = [k for k in range(shape[1]) if k != column and ranked[row, k] > _ALIKE * ranked[row, column]]
    return row, column, float(loss[row, column]), score, alike


def _echo(losses: Sequence[MotorLoss], loss: float) -> bool:
    """Return whether a change is small beside one found before it."""
    return any(loss < _ECHO * one.loss for one in losses)


def _sharp(moments: Moments, found: Sequence[tuple[int, int]], row: int, column: int, loss: float) -> bool:
    """Return whether a change shows in the seconds around it, for the same motor before all others."""
    t = moments.t
    near = np.abs(t - t[row]) <= _AROUND
    first = int(np.argmax(near))
    part = Moments(
        t=t[near],
        thrust=moments.thrust[near],
        pwm=moments.pwm[near],
        factors=moments.factors,
        nuisances=[np.asarray(np.linalg.qr(basis[near])[0]) for basis in moments.nuisances],
    )
    before = [(max(k - first, 0), motor) for k, motor in found if k - first < len(part.t)]
    residuals, bases = _without(part, before)
    later = np.arange(len(part.t)) >= row - first
    hits, squares = np.zeros(len(part.thrust[0])), np.zeros(len(part.thrust[0]))
    for axis, (residual, basis) in enumerate(zip(residuals, bases, strict=True)):
        steps = np.where(later[:, None], part.factors[axis] * part.thrust, 0.0)
        steps = steps - basis @ (basis.T @ steps)
        rest = residual
        own = float(steps[:, column] @ steps[:, column])
        if own > 0.0:
            rest = residual - steps[:, column] * float(steps[:, column] @ residual) / own
        variance = _long_run_variance(rest, part.t)
        hits += steps.T @ residual / variance
        squares += np.sum(steps**2, axis=0) / variance
    scores = np.where(hits > 0.0, hits / np.sqrt(np.maximum(squares, 1e-12)), 0.0)
    local = hits[column] / max(squares[column], 1e-12)
    return bool(scores[column] >= _SHARP and scores[column] >= 0.99 * scores.max() and local >= _SHARE * loss)


def _tail(values: Floats) -> Floats:
    """Sum from each row to the end."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def _long_run_variance(residual: Floats, t: Floats) -> float:
    """Variance of a correlated residual's mean, times the number of samples (Newey and West 1987)."""
    count = len(residual)
    lags = int(min(count // 4, np.ceil(_MEMORY / float(np.median(np.diff(t))))))
    own = float(residual @ residual) / count
    weights = 1.0 - np.arange(1, lags) / max(lags, 1)
    covariances = np.array([float(residual[lag:] @ residual[:-lag]) / count for lag in range(1, lags)])
    return max(own + 2.0 * float(weights @ covariances), 0.2 * own, 1e-12)


@dataclass(frozen=True, slots=True)
class _Size:
    """How much one motor lost: thrust, its standard deviation, and the part of the output that is left."""

    loss: float
    sigma: float
    output: float


def _size(moments: Moments, before: Sequence[tuple[int, int]], row: int, column: int, vehicle: Vehicle) -> _Size:
    """Estimate the size of a loss whose time and motor are known.

    The motor's output answers to the same gusts that disturb the moments, so that regressing on it is biased; the step
    in time does not, and serves as instrument (Wooldridge 2010, section 5.1).
    """
    residuals, bases = _without(moments, before)
    later = np.where(np.arange(len(moments.t)) >= row, 1.0, 0.0)
    above = moments.pwm[:, column] - vehicle.pwm_min
    asked = moments.thrust[:, column]
    instruments, rests = [], []
    for axis, (residual, basis) in enumerate(zip(residuals, bases, strict=True)):
        factor = moments.factors[axis, column]
        instrument = later - basis @ (basis.T @ later)
        instruments.append(instrument)
        through = factor * float(instrument @ (asked * later))
        rest = residual
        if abs(through) > 1e-12:
            step = factor * asked * later
            rest = residual - float(instrument @ residual) / through * (step - basis @ (basis.T @ step))
        rests.append(rest)
    variances = [_long_run_variance(rest, moments.t) for rest in rests]
    weights = [moments.factors[axis, column] / variance for axis, variance in enumerate(variances)]
    target = sum(w * float(i @ r) for w, i, r in zip(weights, instruments, residuals, strict=True))

    def explained(missing: Floats) -> float:
        return sum(
            float(w * moments.factors[axis, column] * (i @ (missing * later)))
            for axis, (w, i) in enumerate(zip(weights, instruments, strict=True))
        )

    def left(part: float) -> Floats:
        return curve(np.clip(motor_commands(vehicle.pwm_min + part * above, vehicle), 0.0, 1.0), vehicle.thrust_expo)

    whole = explained(asked)
    noise = sum(w**2 * v * float(i @ i) for w, v, i in zip(weights, variances, instruments, strict=True))
    part = 1.0
    if target > 0.0:
        lowest, highest = (explained(asked - left(end)) - target for end in (0.0, 1.0))
        part = 0.0
        if lowest > 0.0 > highest:
            part = float(scipy.optimize.brentq(lambda x: explained(asked - left(x)) - target, 0.0, 1.0))
    return _Size(loss=float(np.clip(target / whole, 0.0, 1.0)), sigma=float(np.sqrt(noise) / abs(whole)), output=part)
