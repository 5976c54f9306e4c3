"""The rigid body with six degrees of freedom: position, velocity, attitude and rates from rotor speeds or commands.

With R from body (FRD) to world (NED), u = R^T (v - wind) the speed through the air, s_j the strength of rotor j (the
square of its speed, or the thrust curve of its command; delayed and lagged by its own times; all scaled so that their
sum T is 1 in the mean), w the rates, n the mean rotor speed and H the sum of spin times speed, both over the usual
speed::

    v'  = (0, 0, g) + R f
    f   = P (tilt_x, tilt_y, -1) - (drag_rotor n + drag_quadratic |u|) u          P = thrust T + thrust_offset
    R'  = R [w]
    w_x' = roll_gain  sum_j -sin(angle_j) s_j - roll_damping  w_x + inertia_x w_y w_z - gyroscopic_x H w_y
           + roll_offset  T + roll_by_speed  n u_y
    w_y' = pitch_gain sum_j  cos(angle_j) s_j - pitch_damping w_y + inertia_y w_x w_z + gyroscopic_y H w_x
           + pitch_offset T + pitch_by_speed n u_x
    w_z' = yaw_gain   sum_j      -spin_j  s_j - yaw_damping   w_z + inertia_z w_x w_y - rotor_inertia H' + yaw_offset T

A motor's strength has its share in front: 1 in the mean, more for a motor that gives more than the others from the same
speed or command. For every further input (an elevon, say) there is an acceleration and an
angular acceleration along and about each axis.
Offsets are what a centre of gravity beside the motors' centre, or unlike rotors, do to trim.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from core.summary import Summarised, listed
from logparse import Finding, MissingDataError
from sysid.records.experiment import Experiment, Floats, horizon_steps
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.six_dof._kernels import advance, ahead
from sysid.rigid_body.six_dof.body_record import BodyRecord, InputKinds, InputShape, body_record, drives, input_kinds
from sysid.rigid_body.six_dof.correction import (
    CorrectionRecord,
    HorizonCorrection,
    Observer,
    pushes,
)

#: Units of the shared parameters; T is 1 in the mean of the records fitted.
UNITS: Mapping[str, str] = {
    "thrust": "m/s^2 at the mean strength of the rotors",
    "thrust_offset": "m/s^2",
    "thrust_drift": "1/s, change of thrust over thrust, as the battery runs down",
    "tilt_x": "rad, thrust leans forward",
    "tilt_y": "rad, thrust leans right",
    "drag_rotor_x": "1/s at the usual rotor speed",
    "drag_rotor_y": "1/s",
    "drag_rotor_z": "1/s",
    "drag_quadratic_x": "1/m",
    "drag_quadratic_y": "1/m",
    "drag_quadratic_z": "1/m",
    "roll_gain": "rad/s^2 for the mean strength of all rotors at one arm's length",
    "pitch_gain": "rad/s^2",
    "yaw_gain": "rad/s^2",
    "roll_damping": "1/s",
    "pitch_damping": "1/s",
    "yaw_damping": "1/s",
    "inertia_x": "1, (I_yy - I_zz) / I_xx",
    "inertia_y": "1, (I_zz - I_xx) / I_yy",
    "inertia_z": "1, (I_xx - I_yy) / I_zz",
    "gyroscopic_x": "1/s, momentum of one rotor at the usual speed over I_xx",
    "gyroscopic_y": "1/s, over I_yy",
    "rotor_inertia": "1/s, over I_zz; of a mixer's yaw rad/s^2 for its change per second",
    "roll_offset": "rad/s^2 at the mean strength of the rotors",
    "pitch_offset": "rad/s^2",
    "yaw_offset": "rad/s^2",
    "roll_by_speed": "rad/s^2 per m/s to the right",
    "pitch_by_speed": "rad/s^2 per m/s forward",
}


@dataclass(frozen=True, slots=True)
class UsualErrors:
    """Errors at a horizon [s] on training records."""

    horizon: float
    position: float  #: m.
    velocity: float  #: m/s.
    attitude: float  #: rad.
    rates: float  #: rad/s.


@dataclass(frozen=True, slots=True, kw_only=True)
class SixDofReport:
    """What files hold of a `SixDofModel`."""

    kind: Literal["six_dof"] = "six_dof"
    name: str
    parameters: Mapping[str, BodyParameter]
    estimated: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    winds: Mapping[str, tuple[float, ...]]
    charges: Mapping[str, float]  #: Thrust of the same commands in each record over that of the mean record.
    errors: tuple[UsualErrors, ...]
    mass: float | None
    correction: CorrectionRecord | None
    training: tuple[str, ...]
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class SixDofModel(Summarised):
    """A craft that flies from its inputs alone."""

    name: str
    #: Those of `UNITS`, ``delay_NAME`` and ``lag_NAME`` of every rotor [s] (of rotor speeds ``telemetry_lag_NAME``: how
    #: late they are logged) and its ``share_NAME`` of thrust and torque, and of every further input NAME ``NAME_x``
    #: ... (acceleration, m/s^2) and ``NAME_roll`` ... (rad/s^2) for its usual change.
    parameters: Mapping[str, BodyParameter]
    theta: Floats  #: shape (27 + 6 e,): What the equations compute with.
    shape: InputShape
    kinds: InputKinds
    estimated: tuple[str, ...]  #: Names of rows and columns of `covariance`.
    covariance: Floats
    #: mapping of str to ndarray, shape (2,): Wind of the records, north and east, m/s; zero where it is not there.
    winds: Mapping[str, Floats]
    #: mapping of float to ndarray, shape (4,): Usual error of position [m], velocity [m/s], attitude [rad], rates
    #: [rad/s] by horizon [s] on training records.
    scales: Mapping[float, Floats]
    training: tuple[str, ...]
    observer: Observer | None = None  #: How a start looks back for what pushes the craft; None if it does not.
    #: Learned from what is left; None if not asked for, or if it did not help held-out flights.
    correction: HorizonCorrection | None = None
    findings: tuple[Finding, ...] = ()
    mass: float | None = None  #: kg.
    #: Attitude and rates are inputs, as measured; only position and velocity are predicted.
    attitude_given: bool = False
    #: mapping of str to ndarray, shape (2,): Standard errors of the winds that were estimated, m/s.
    wind_sigma: Mapping[str, Floats] = field(default_factory=dict)

    def summary(self) -> dict[str, str]:
        """Return inputs, what is determined, and usual errors at the longest horizon."""
        determined = [name for name, parameter in self.parameters.items() if parameter.determined]
        horizon, error = max(self.scales.items())
        return {
            "model": self.name,
            "inputs": f"{listed(self.kinds.names)} ({self.kinds.quantity.value})",
            "determined": f"{len(determined)} of {len(self.estimated)}: {listed(determined)}",
            f"{horizon:g} s ahead": f"{error[0]:.3g} m, {error[1]:.3g} m/s, {error[2]:.3g} rad, {error[3]:.3g} rad/s",
            "training": listed(self.training),
        }

    def simulate(self, experiment: Experiment) -> Floats:
        """Run freely from the first measured state; x, y, z (north, east, up, m), shape (N, 3)."""
        return _outputs(self.simulate_states(experiment))

    def simulate_states(self, experiment: Experiment) -> Floats:
        """Run freely from the first measured state; the whole state, shape (N, 18), see `BodyRecord.states`."""
        record = self.record(experiment)
        after = np.arange(1, len(record.t), dtype=np.int64)
        run = self._runs(record, np.zeros(1, dtype=np.int64), after, np.zeros((1, 6)))
        return np.concatenate([record.states[:1], run[0]])

    def fly(
        self, experiment: Experiment, controller: Callable[[float, Floats, Floats], Floats]
    ) -> tuple[Floats, Floats]:
        """Fly from a record's first state with a controller in the loop, or with its inputs changed.

        The record gives the first state, the clock and the wind; each sample takes as long as the record is, so cut it.
        The controller is asked at every time [s], with the state, shape (18,) as in `BodyRecord.states`, and the
        record's
        inputs then, shape (m,), for the inputs that the craft gets instead. Returns states, shape (N, 18), and the
        inputs
        that were given, shape (N, m). ValueError where attitude is an input of the model, which no controller can turn.
        """
        if self.attitude_given:
            raise ValueError("attitude is an input of this model: fit one with attitude='state'")
        given, wind, dt = experiment.u.copy(), self._wind(self.record(experiment)), experiment.dt
        states = self.record(experiment).states.copy()
        for k in range(len(given) - 1):
            given[k:] = controller(float(experiment.t[k]), states[k], experiment.u[k])
            drive = drives(self.record(replace(experiment, u=given)), self.kinds, self.shape)[k]
            states[k + 1] = states[k]
            advance(self.theta, drive, wind[k], np.zeros(6), dt, substeps(dt), states[k + 1])
        return states, given

    def predict(self, experiment: Experiment, horizon: float = 1.0) -> Floats:
        """Predict x, y, z of every sample from the state `horizon` seconds before; shape (N, 3).

        Samples before the first horizon are those of the free run.
        """
        return _outputs(self.predict_states(experiment, horizon))

    def predict_states(self, experiment: Experiment, horizon: float = 1.0) -> Floats:
        """Predict the whole state of every sample from that `horizon` seconds before; shape (N, 18)."""
        record = self.record(experiment)
        steps = min(horizon_steps(horizon, record.dt), len(record.t) - 1)
        starts = np.arange(len(record.t) - steps)
        out = np.empty_like(record.states)
        out[:steps] = self.simulate_states(experiment)[:steps]
        out[steps:] = self.ahead(record, starts, np.array([steps]))[:, 0]
        return out

    def ahead(self, record: BodyRecord, starts: np.ndarray, marks: np.ndarray) -> Floats:
        """States at the marked numbers of samples after each start, (S, M, 18), as in `BodyRecord.states`."""
        push = np.zeros((len(starts), 6))
        missed = None
        if self.observer is not None or (self.correction is not None and self.correction.memory > 0.0):
            missed = self.missed(record)
        if self.observer is not None and missed is not None:
            push = pushes(self.observer, missed, record.dt)[starts]
        predicted = self._runs(record, starts.astype(np.int64), marks.astype(np.int64), push)
        if self.correction is not None:
            predicted = self.correction.corrected(record, starts, marks, predicted, missed, self.attitude_given)
        return predicted

    def _runs(self, record: BodyRecord, starts: np.ndarray, marks: np.ndarray, push: Floats) -> Floats:
        """States of the equations alone at the marks after each start, (S, M, 18), under a push (S, 6) from outside."""
        drive, wind, dt = drives(record, self.kinds, self.shape), self._wind(record), record.dt
        given = self.attitude_given
        return np.asarray(ahead(self.theta, drive, wind, push, record.states, starts, marks, dt, substeps(dt), given))

    def missed(self, record: BodyRecord) -> Floats:
        """Accelerations and angular accelerations that the model missed up to each sample, (N, 6)."""
        starts = np.arange(len(record.t) - 1, dtype=np.int64)
        one = self._runs(record, starts, np.ones(1, dtype=np.int64), np.zeros((len(starts), 6)))[:, 0]
        missed = np.zeros((len(record.t), 6))
        missed[1:, :3] = (record.states[1:, 3:6] - one[:, 3:6]) / record.dt
        missed[1:, 3:] = (record.states[1:, 15:] - one[:, 15:]) / record.dt
        return missed

    def record(self, experiment: Experiment) -> BodyRecord:
        """Convert an experiment to the form of the equations; MissingDataError for other inputs or without motion."""
        if experiment.input_names != self.kinds.names:
            raise MissingDataError(
                f"{experiment.name} has inputs {', '.join(experiment.input_names)}; the model takes "
                f"{', '.join(self.kinds.names)}"
            )
        kinds = input_kinds(experiment)
        if kinds.quantity is not self.kinds.quantity:
            raise MissingDataError(
                f"{experiment.name} has motors in {kinds.quantity.value}, the model takes {self.kinds.quantity.value}"
            )
        return body_record(experiment, self.kinds)

    def value(self, name: str) -> float:
        """Return the number that the model computes with."""
        return self.parameters[name].used

    def with_correction(self, correction: HorizonCorrection | None) -> SixDofModel:
        """Return the model with a learned correction, or without."""
        return replace(self, correction=correction)

    def with_observer(self, observer: Observer | None) -> SixDofModel:
        """Return the model with an observer of outside forces, or without."""
        return replace(self, observer=observer)

    def as_for_a_stranger(self) -> SixDofModel:
        """Return the model as it predicts records that it was not fitted to: it knows neither battery nor wind."""
        given = {name: wind for name, wind in self.winds.items() if name not in self.wind_sigma}
        return replace(self, shape=replace(self.shape, charges={}), winds=given)

    def with_rest(self, first: Experiment, rest: Experiment) -> SixDofModel:
        """Return the model with wind and battery of what follows a record that was fitted, as they were in it."""
        later = 0.5 * float(rest.t[0] + rest.t[-1] - first.t[0] - first.t[-1])
        charge = self.shape.charges.get(first.name, 1.0) * (1.0 + self.shape.values.get("thrust_drift", 0.0) * later)
        shape = replace(self.shape, charges={**self.shape.charges, rest.name: charge})
        return replace(self, shape=shape).with_wind({rest.name: self.winds.get(first.name, np.zeros(2))})

    def with_wind(self, winds: Mapping[str, Floats]) -> SixDofModel:
        """Return the model with the wind of more records, north and east, m/s."""
        sigma = {name: spread for name, spread in self.wind_sigma.items() if name not in winds}
        return replace(self, winds={**self.winds, **winds}, wind_sigma=sigma)

    def _wind(self, record: BodyRecord) -> Floats:
        wind = np.zeros((len(record.t), 3))
        known = np.asarray(self.winds.get(record.name, np.zeros(2)))
        wind[:, :2] = known
        return wind

    def report(self) -> SixDofReport:
        """Return what files hold of the model."""
        return SixDofReport(
            name=self.name,
            parameters=self.parameters,
            estimated=self.estimated,
            covariance=tuple(tuple(row) for row in self.covariance.tolist()),
            winds={name: tuple(wind.tolist()) for name, wind in self.winds.items()},
            charges=self.shape.charges,
            errors=tuple(UsualErrors(horizon, *errors.tolist()) for horizon, errors in self.scales.items()),
            mass=self.mass,
            correction=None if self.correction is None else self.correction.record(),
            training=self.training,
            findings=self.findings,
        )


def substeps(dt: float) -> int:
    """Return the number of integration steps in one sample interval."""
    return max(int(np.ceil(dt / 0.011)), 1)


def _outputs(states: Floats) -> Floats:
    """x, y, z (north, east, up) of states."""
    return np.asarray(states[:, :3] * np.array([1.0, 1.0, -1.0]))
