"""Moments that motor outputs make, beside all else that explains them: the one equation of every motor fault.

A rate controller keeps the moments of all motors in balance, so that those which the *outputs* would make show what it
must add. With outputs turned into thrust q_k by the autopilot's curve, and f_ak the mixer's factor of motor k about
axis a (roll, pitch, yaw), a craft whose motor j lacks the part x of its thrust from the time tau until e obeys::

    sum_k f_ak q_k = x f_aj q_j [tau <= t < e] + a + b Q + c w_a + d dw_a/dt + e f_x + f f_y + g Q t + noise

where Q is the mean thrust, w the angular rate, and f_x, f_y the specific force across the thrust axis, which goes with
airspeed and so takes up what wind and drag do. Position of the centre of gravity, its drift and the inertia are
nuisances; x has the same value about all axes. A lasting loss is a window until the end of the flight, a dropout a
short one, and a motor that is weak from the beginning hides in a, b (`sysid.rotors.motor_faults.trims`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core.robust import robust_sigma
from logparse import MissingDataError, Tables, Vehicle
from logparse.tables import between
from sysid.records.experiment import Floats
from sysid.records.mixer import factors_of
from sysid.records.motor_scaling import curve, motor_commands
from sysid.statistics.covariance import long_run_variance

#: Slowest motor outputs and rates [Hz] that tell a change: outputs of 2 Hz name the motors of `faults` as those of 10
#: do, to the tenth of a second; rates of 3 Hz feign losses for moments (00000081). Fewest rows, and fastest outputs
#: that tell more.
_SLOWEST, _SLOWEST_RATES, FEWEST, _FASTEST = 1.5, 4.0, 30, 25.0
#: Columns of `Moments.columns` that a craft out of control keeps: its airspeed is unlike any before.
OF_A_FALL = (0, 1, 2, 3)

#: Time over which noise may be correlated, s.
MEMORY = 3.0

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Moments:
    """Outputs and motion at the times of the motors' outputs."""

    t: Floats  #: shape (n,)
    thrust: Floats  #: shape (n, motors): Parts of a motor's full thrust.
    pwm: Floats  #: shape (n, motors): us.
    limited: Flags  #: shape (n, motors): At the upper limit.
    factors: Floats  #: shape (axes, motors)
    columns: list[Floats]  #: list of ndarray, shape (n, 7): What else makes moments about each axis; as in the module.

    @property
    def step(self) -> float:
        """Median interval of the outputs, s."""
        return float(np.median(np.diff(self.t)))

    def part(self, rows: Flags | slice) -> Moments:
        """Return some of the rows."""
        return Moments(
            t=self.t[rows],
            thrust=self.thrust[rows],
            pwm=self.pwm[rows],
            limited=self.limited[rows],
            factors=self.factors,
            columns=[column[rows] for column in self.columns],
        )

    @property
    def asked(self) -> list[Floats]:
        """Moment that the outputs make about each axis, shape (n,)."""
        return [self.thrust @ factors for factors in self.factors]


def too_slow(tables: Tables, start: float, stop: float) -> bool:
    """Return whether motor outputs or the IMU come too seldom between start and stop [s] to tell a motor that fails."""
    for table, slowest in ((tables.motors, _SLOWEST), (tables.imu, _SLOWEST_RATES)):
        t = np.empty(0) if table is None else between(table, start, stop).index.to_numpy(np.float64)
        if len(t) > 1 and len(t) < slowest * (t[-1] - t[0]):
            return True
    return False


def read_moments(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> Moments | None:
    """Read outputs and motion of a flight between start and stop [s]; None where rows are few or slow.

    MissingDataError without the frame, the outputs of all its motors, or the IMU.
    """
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if not names:
        raise MissingDataError("the frame is unknown, so that no motor can be told from another; log parameters")
    if tables.motors is None or any(name not in tables.motors for name in names):
        raise MissingDataError("outputs of all motors of the frame are needed to find one that fails")
    if tables.imu is None:
        raise MissingDataError("angular rates and specific force (IMU) are needed to find a motor that fails")
    # Before a view of the IMU's table is held, which might have to be built again beside it.
    if too_slow(tables, start, stop):
        return None
    # The ground pushes for two seconds.
    outputs = tables.motors.loc[start + 2.0 : stop, names].dropna()
    if len(outputs) > FEWEST:
        outputs = outputs.iloc[:: max(round(1.0 / (_FASTEST * np.median(np.diff(outputs.index)))), 1)]
    # One column at a time: a copy of a long log's IMU is half as large as the log.
    imu = between(tables.imu, start, stop + 0.5)
    motion = [imu[name].to_numpy(np.float64) for name in ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y")]
    t, at = outputs.index.to_numpy(np.float64), imu.index.to_numpy(np.float64)
    # Rates [rad/s] and specific forces [m/s^2] beyond this were never measured: damage.
    measured = np.logical_and.reduce([np.abs(values) < 1e4 for values in motion])
    if not measured.all():
        at, motion = at[measured], [values[measured] for values in motion]
    if min(len(t), len(at)) < FEWEST:
        return None
    inside = (t > at[0]) & (t < at[-1])
    t, pwm = t[inside], outputs.to_numpy(np.float64)[inside]
    # Means over the interval around each output, and what rates change by within it.
    width = 0.5 * float(np.median(np.diff(t)))

    def change(of: Floats) -> Floats:
        return np.asarray(np.interp(t + width, at, of) - np.interp(t - width, at, of)) / (2.0 * width)

    def mean(of: Floats) -> Floats:
        integral = np.zeros_like(of)
        np.cumsum(0.5 * np.diff(at) * (of[1:] + of[:-1]), out=integral[1:])
        return change(integral)

    felt, turned = [mean(values) for values in motion], [change(values) for values in motion[:3]]
    command = motor_commands(pwm, vehicle)
    thrust = curve(np.clip(command, 0.0, 1.0), vehicle.thrust_expo)
    factors = factors_of(vehicle).T
    axes = [axis for axis in range(3) if np.max(np.abs(factors[axis])) > 1e-6]
    usual, elapsed = thrust.mean(axis=1), (t - t.mean()) / max(t[-1] - t[0], 1e-9)
    return Moments(
        t=t,
        thrust=thrust,
        pwm=pwm,
        limited=command >= 1.0 - 0.01 / (vehicle.spin_max - vehicle.spin_min),
        factors=factors[axes],
        columns=[
            np.column_stack([np.ones(len(t)), usual, felt[a], turned[a], felt[3], felt[4], elapsed * usual])
            for a in axes
        ],
    )


#: Part of the best change of all moments that one motor must explain, and of its own explanation that none of the
#: others may reach if it is to be named alone.
ONE_MOTOR, ALIKE = 0.8, 0.85

Rows = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class WindowFits:
    """What each motor explains by itself in each of several windows, all shape (windows, motors)."""

    loss: Floats
    gain: Floats  #: Squared loss in standard deviations.
    part: Floats  #: Part of the best change of all moments that it explains.

    def alone(self, sign: float) -> Flags:
        """Return where a motor that gives less (1) or more (-1) explains what is seen, and no other as well."""
        gain = np.where(sign * self.loss > 0.0, self.gain, 0.0)
        others = np.sort(gain, axis=1)[:, -2:-1]
        best = gain == gain.max(axis=1, keepdims=True)
        return np.asarray(best & (gain > 0.0) & (self.part >= ONE_MOTOR) & (others < ALIKE * gain))


@dataclass(frozen=True, slots=True, eq=False)
class Remainder:
    """Moments that motion does not explain, and what does, by axis."""

    moments: Moments
    bases: list[Floats]  #: list of ndarray, shape (n, p): Orthonormal.
    residuals: list[Floats]  #: list of ndarray, shape (n,)

    @classmethod
    def of(cls, moments: Moments, *, lag: bool = False) -> Remainder:
        """Fit what else makes moments; with `lag` the motors' own lag too, which hides what lasts."""
        bases, residuals = [], []
        for asked, columns in zip(moments.asked, moments.columns, strict=True):
            regressors = np.column_stack([columns, np.gradient(asked, moments.t)]) if lag else columns
            basis = np.linalg.qr(regressors / np.maximum(np.linalg.norm(regressors, axis=0), 1e-12))[0]
            bases.append(np.asarray(basis))
            residuals.append(np.asarray(asked - basis @ (basis.T @ asked)))
        return cls(moments, bases, residuals)

    def fits(self, variances: Sequence[float], first: Rows, last: Rows) -> WindowFits:
        """Explain the windows of rows from `first` to before `last` by each motor, given each axis's noise."""
        thrust = self.moments.thrust
        hits, squares, free = (np.zeros((len(first), thrust.shape[1])) for _ in range(3))

        def total(values: Floats) -> Floats:
            sums = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
            return np.asarray(sums[last] - sums[first])

        for residual, basis, variance, factors in zip(
            self.residuals, self.bases, variances, self.moments.factors, strict=True
        ):
            seen, power = total(thrust * residual[:, None]), total(thrust**2)
            # What else moves takes of each window: the part of the motor's thrust that lies along it.
            left = power - sum(total(thrust * column[:, None]) ** 2 for column in basis.T)
            left = np.maximum(left, 1e-12)
            hits += factors * seen / variance
            squares += factors**2 * left / variance
            free += seen**2 / left / variance
        squares = np.maximum(squares, 1e-12)
        gain = hits**2 / squares
        return WindowFits(hits / squares, gain, gain / np.maximum(free, 1e-12))

    def without(self, row: int, column: int, loss: float) -> list[Floats]:
        """Return the residuals without a loss of one motor from a row on."""
        step = np.where(np.arange(len(self.moments.t)) >= row, self.moments.thrust[:, column], 0.0)
        return [
            residual - loss * factors[column] * (step - basis @ (basis.T @ step))
            for residual, basis, factors in zip(self.residuals, self.bases, self.moments.factors, strict=True)
        ]


def variances_of(residuals: Sequence[Floats], moments: Moments) -> list[float]:
    """Return the long-run variance of the residual of each axis."""
    return [long_run_variance(residual, MEMORY / moments.step) for residual in residuals]


def spread(values: Floats) -> float:
    """Estimate the standard deviation of values about zero from their bulk."""
    return max(robust_sigma(values), 1e-6)
