"""What the equations of motion read of one flight, as plain arrays on its clock."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from logparse import MissingDataError, Vehicle
from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.records.motor_scaling import motor_commands
from sysid.records.resampling import join_rows, logged_rate
from sysid.records.thrust_curve import attitude, column, lagged, relative_density, squared_voltage, velocity_n
from sysid.rigid_body._rigid_kernels import MotionSignals, accelerations, ahead

Samples = NDArray[np.int64]

#: Parameters of the craft in the order of the kernels; those of the flight follow: `OWN`, then the wind.
THETA = (
    "thrust",
    "thrust_expo",
    "drag_linear_x",
    "drag_linear_y",
    "drag_linear_z",
    "drag_quadratic_x",
    "drag_quadratic_y",
    "drag_quadratic_z",
    "climb_loss",
    "tilt_x",
    "tilt_y",
    "motor_lag",
)
SHARED = len(THETA)

#: Parameters of a flight before the coefficients of its wind.
OWN = ("wind_exponent", "thrust_scale")
LAG = THETA.index("motor_lag")

#: Length of a block, s: longer than the motor outputs' sampling, shorter than a gust.
BLOCK_SECONDS = 0.5

#: Step by which the derivative by the lag is taken, s; also the shortest lag.
_LAG_STEP = 1e-3

#: Standard deviation of an attitude whose error nobody stated, rad: a tenth of a degree.
ATTITUDE_SIGMA = np.radians(0.1)


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredMotion:
    """How a craft moved in one record, as plain arrays on its clock; subclasses add what its motors did."""

    name: str
    t: Floats  #: shape (N,): s, uniform.
    #: shape (N, 18): Position NED [m], velocity NED [m/s], rotation body (FRD) to NED by rows, rates [rad/s].
    states: Floats
    density: Floats  #: shape (N,): Of the air over 1.225 kg/m^3.

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def position(self) -> Floats:
        """Position NED, m, (N, 3)."""
        return self.states[:, :3]

    @property
    def velocity(self) -> Floats:
        """Velocity NED, m/s, (N, 3)."""
        return self.states[:, 3:6]

    @property
    def rotation(self) -> Floats:
        """Rotation from body to NED, (N, 3, 3)."""
        return self.states[:, 6:15].reshape(-1, 3, 3)

    def cut(self, start: int, stop: int) -> Self:
        """Return the samples from `start` to before `stop`."""
        held = {field.name: getattr(self, field.name) for field in fields(self)}
        by_sample = {name: values for name, values in held.items() if np.shape(values)[:1] == self.t.shape}
        return replace(self, **{name: values[start:stop] for name, values in by_sample.items()})


def measured_states(record: Experiment) -> Floats:
    """Read the states of a record, (N, 18), see `MeasuredMotion`; NaN where unknown."""
    rates = np.column_stack([column(record, f"w_{axis}") for axis in "xyz"])
    position = record.y[:, :3] * np.array([1.0, 1.0, -1.0])
    rotation = attitude(record).reshape(-1, 9)
    return np.ascontiguousarray(np.hstack([position, velocity_n(record), rotation, rates]))


@dataclass(frozen=True, slots=True, kw_only=True)
class BodyMotion(MeasuredMotion):
    """One flight as the equations of motion see it; positions count from the first sample."""

    #: shape (N,): Sums of c and c^2 over the motors, times the square of the voltage over the reference.
    linear: Floats
    square: Floats
    ground: float  #: Down coordinate of the place of take-off, m.
    #: shape (3,): Standard deviation of the attitude's error about north, east and down, usual over the flight, rad.
    attitude_sigma: Floats
    #: Time between the motor outputs that were logged, s.
    input_interval: float

    def signals(self, lag: float) -> MotionSignals:
        """Return what the equations of motion read, behind a lag [s] of the motors."""
        lag = max(lag, 0.0)
        thrust = np.column_stack([self.linear, self.square])
        now = lagged(thrust, lag, self.dt)
        later = lagged(thrust, lag + _LAG_STEP, self.dt)
        late = np.hstack([now, (later - now) / _LAG_STEP])
        return MotionSignals(self.states, self.density, late, self.ground - self.position[:, 2])

    def run(self, theta: Floats, shapes: Floats, law: int, start: int = 0, stop: int | None = None) -> Floats:
        """Positions and velocities from the measured state at sample `start`, in a wind of `shapes` (N, w)."""
        after = np.arange(1, (len(self.t) if stop is None else stop) - start)
        run = self.ahead(theta[None], shapes[start:], law, np.array([start]), after)[0]
        return np.vstack([self.states[start, :6], run])

    def ahead(self, thetas: Floats, shapes: Floats, law: int, starts: Samples, marks: Samples) -> Floats:
        """Positions and velocities at the marks after each start, (S, M, 6), with its parameters (S, q).

        The wind's `shapes`, (n, w), go with the samples since a start.
        """
        out = np.empty((len(starts), len(marks), 6))
        signals = self.signals(thetas[0, LAG])
        ahead(thetas, signals, shapes, self.dt, self.ground, law, starts, marks, out)
        return out


def motion(record: Experiment, vehicle: Vehicle, voltage: float | None, *, joined: bool = False) -> BodyMotion:
    """Read from a record what the equations of motion read."""
    if any(unit != "us" for unit in (record.units.get(name, "us") for name in record.input_names)):
        raise ExperimentError(
            f"{record.name}: a rigid body reads the motors' PWM; make the record with inputs='motors'"
        )
    if record.output_names != ("x", "y", "z"):
        raise ExperimentError(
            f"{record.name}: a rigid body moves in x, y, z (north, east, up); make the record with these"
        )
    context, states = record.context, measured_states(record)
    if context is None or not np.isfinite(states[:, 6:15]).all():
        raise MissingDataError(f"{record.name}: no attitude, which the rigid body needs as an input; estimate it first")
    interval = min(1.0 / logged_rate(record.u, record.dt), 1.0)
    outputs = record.u
    if joined:
        # What motors have in common is slower than rows come; their differences, which turn the craft, are not.
        common = outputs.mean(axis=1, keepdims=True)
        outputs = outputs + join_rows(common, record.dt, interval) - common
    command = np.clip(motor_commands(outputs, vehicle), 0.0, 1.0)
    ratio = squared_voltage(record, voltage)
    states[:, :3] -= states[0, :3].copy()
    if not np.isfinite(states[:, 3:6]).all():
        states[:, 3:6] = np.gradient(states[:, :3], record.dt, axis=0)
    return BodyMotion(
        name=record.name,
        t=record.t,
        states=states,
        density=relative_density(record),
        linear=ratio * command.sum(axis=1),
        square=ratio * (command**2).sum(axis=1),
        # A record that does not tell begins or ends near the ground.
        ground=float(context["height"].iloc[0] if "height" in context else max(states[0, 2], states[-1, 2])),
        attitude_sigma=_attitude_sigma(context),
        input_interval=interval,
    )


def _attitude_sigma(context: pd.DataFrame) -> Floats:
    """Root mean square of what the estimator states of its attitude, (3,) rad; `ATTITUDE_SIGMA` where it does not."""
    errors = ["phi_n", "phi_e", "phi_d"]
    if not set(errors) <= set(context.columns):
        return np.full(3, ATTITUDE_SIGMA)
    stated = np.sqrt(np.mean(context[errors].to_numpy(np.float64) ** 2, axis=0))
    return np.asarray(np.where(np.isfinite(stated), stated, ATTITUDE_SIGMA))


@dataclass(frozen=True, slots=True, kw_only=True)
class Increments:
    """Changes of velocity over short blocks beside what the equations make of the measured motion.

    They are linear in small changes of the parameters and sum up nothing from block to block.
    """

    edges: np.ndarray  #: shape (K + 1,): Samples at which blocks begin and end.
    seconds: float  #: Length of a block, s.
    missed: Floats  #: shape (K, 3): Measured change of velocity less that of the model, NED, m/s.
    by_craft: Floats  #: shape (K, 3, c): Derivatives of the model's change of velocity by parameters of the craft.
    by_flight: Floats  #: shape (K, 3, 4): By those of the flight: `OWN`, and the wind towards north and east.


def velocity_increments(flight: BodyMotion, theta: Floats, law: int) -> Increments:
    """Compare the changes of velocity of a flight with the model's in a constant wind, over blocks of `BLOCK_SECONDS`.

    Shapes: `theta` (q,).
    """
    count = len(flight.t)
    size = min(max(round(BLOCK_SECONDS / flight.dt), 1), count - 1)
    seconds = size * flight.dt
    model, jacobian = mean_accelerations(flight, theta, np.ones((count, 1)), law, size)
    edges = np.arange(0, count, size)
    missed = np.diff(flight.velocity[edges], axis=0) - seconds * model
    by_craft, by_flight = np.split(seconds * jacobian, [SHARED], axis=2)
    return Increments(edges=edges, seconds=seconds, missed=missed, by_craft=by_craft, by_flight=by_flight)


def mean_accelerations(
    flight: BodyMotion, theta: Floats, shapes: Floats, law: int, stride: int
) -> tuple[Floats, Floats]:
    """Compute the model's accelerations along a flight as it was measured.

    Shapes: `theta` (q,); `shapes` (N, w).
    """
    means = (len(flight.t) - 1) // stride
    model, jacobian = np.empty((means, 3)), np.empty((means, 3, len(theta)))
    accelerations(theta, flight.signals(theta[LAG]), shapes, law, stride, model, jacobian)
    return model, jacobian
