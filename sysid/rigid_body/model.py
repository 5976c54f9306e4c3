"""The rigid body identified from flight: thrust, drag, wind, and how strongly motors turn the craft.

Translation, with attitude as an input (NED world, FRD body; R from body to world; s = density over 1.225 kg/m^3)::

    v' = (0, 0, g) + R a_b
    t  = thrust * scale * s * (V / V_ref)^2 * sum_k [(1 - e) c_k + e c_k^2]     first-order lag `motor_lag`
    u  = R^T (v - wind(h)),   wind(h) = wind_10 (h / 10 m)^wind_exponent
    a_b = t (tilt_x, tilt_y, -1) - L drag_linear u - s drag_quadratic |u| u + (0, 0, s climb_loss max(0, -u_z)^2)

with c_k the command of motor k between idle and full spin, and L = sqrt(s t / g) where drag is that of the rotors,
which goes with their speed, or L = s where it is not; quadratic drag may go with the speed along its axis, |u_i| for
|u|. Scale, wind and its exponent belong to the flight, all else to the craft.

Rotation, with levers l_k = -sin(angle_k) for roll and cos(angle_k) for pitch, in arms, and l_k = -spin_k for yaw (a
rotor turning clockwise pushes the craft anticlockwise), and T_k = s (V / V_ref)^2 [(1 - e) c_k + e c_k^2]::

    w' = gain sum_k l_k (T_k + lead T_k') - damping w          for each axis, lead in yaw only

so that inertia over arm is ``I_xx / l = m thrust / roll_gain``. Motion alone gives everything per unit of mass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np

from core.quantity import uncertain
from core.serialization import plain, restored
from core.summary import Summarised, listed
from logparse import Finding, Vehicle
from sysid.records.experiment import Experiment, Floats, horizon_steps
from sysid.rigid_body._rigid_kernels import AXIS_DRAG, ROTOR_DRAG
from sysid.rigid_body.body_motion import SHARED, THETA, BodyMotion, motion
from sysid.rigid_body.carried import FIXED, GUST_SECONDS, STATES, Carried, carry_states, drift_sigma
from sysid.rigid_body.model_record import WIND_HEIGHT, BodyParameter, FlightTrim, RigidBodyRecord
from sysid.rigid_body.trim import early_trim, left_open, unusual_thrust, whole_trim

#: From how much of a flight that the model has not seen wind and thrust scale are found, s.
TRIM_SECONDS = 30.0

#: Parameters in the order in which they are estimated, with their units; the first group from translation, the second
#: from rotation.
TRANSLATION_UNITS: Mapping[str, str] = {
    "thrust": "m/s^2, one motor at full command in sea-level air at the reference voltage (k/m)",
    "thrust_expo": "1",
    "drag_linear_x": "1/s, in sea-level air at hover thrust",
    "drag_linear_y": "1/s",
    "drag_linear_z": "1/s",
    "drag_quadratic_x": "1/m, in sea-level air",
    "drag_quadratic_y": "1/m",
    "drag_quadratic_z": "1/m",
    "climb_loss": "1/m, thrust per mass lost with the square of the climb through the air, at sea level",
    "tilt_x": "rad, thrust leans forward",
    "tilt_y": "rad, thrust leans right",
    "motor_lag": "s",
}
ROTATION_UNITS: Mapping[str, str] = {
    "roll_gain": "rad/s^2, one motor at full command on an arm along y in sea-level air (l k/I_xx)",
    "pitch_gain": "rad/s^2 (l k/I_yy)",
    "yaw_gain": "rad/s^2, one motor at full command (b/I_zz)",
    "roll_damping": "1/s",
    "pitch_damping": "1/s",
    "yaw_damping": "1/s",
    "yaw_lead": "s, torque of the rotors' own acceleration over their drag's",
    "torque_lag": "s, first order, between torque command and torque",
    "torque_delay": "s, gyro filters included",
    "cg_x": "1, centre of gravity ahead of where motors pull that are taken to be alike, in arms",
    "cg_y": "1, to the right",
}


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class RigidBodyModel(Summarised):
    """A craft as physics sees it."""

    name: str
    #: By the names of `TRANSLATION_UNITS` and `ROTATION_UNITS`; all are there, determined or not.
    parameters: Mapping[str, BodyParameter]
    estimated: tuple[str, ...]  #: Names of rows and columns of `covariance`.
    covariance: Floats  #: Of the estimated parameters, valid for coloured residuals.
    condition: float  #: Condition number of the information on the translational parameters, scaled to unit diagonal.
    rotor_drag: bool  #: Whether linear drag goes with the rotors' speed; else with the air's density.
    #: Whether quadratic drag along an axis goes with the square of the speed along it; else with the whole speed.
    axis_drag: bool
    mass: float | None  #: As given, kg.
    vehicle: Vehicle  #: Geometry of the motors and the autopilot's output scaling.
    reference_density: float  #: 1.225 kg/m^3.
    reference_voltage: float | None  #: V; None when voltage was not logged.
    flights: Mapping[str, FlightTrim]  #: Wind and thrust scale of the flights that they are known of.
    rotation_fit: Mapping[str, float]  #: R^2 of angular acceleration per axis, where estimated.
    rmse: float  #: Of position over the windows of the fit, m.
    training: tuple[str, ...]
    findings: tuple[Finding, ...]
    #: Half of what lies between the thrust curve found and that of the parameters where the two contradict each other:
    #: a part of the sigma of `thrust_expo`, since one of them is true.
    contradicted: float = 0.0
    #: Flights that have been read already, with wind and thrust scale as they were followed through them.
    followed: Mapping[str, tuple[BodyMotion, Carried]] = field(default_factory=dict, repr=False, compare=False)

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        known = [f"{name} {uncertain(p.value, p.sigma)}" for name, p in self.parameters.items() if p.determined]
        unknown = [name for name, p in self.parameters.items() if not p.determined]
        return {
            "name": self.name,
            "determined": listed(known, 3),
            "not determined": listed(unknown, 5) or "none",
            "mass": "not given" if self.mass is None else f"{self.mass:.4g} kg",
            "training": listed(self.training),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }

    @property
    def law(self) -> int:
        """Law of drag as the kernels number it."""
        return (ROTOR_DRAG if self.rotor_drag else 0) | (AXIS_DRAG if self.axis_drag else 0)

    def value(self, name: str) -> float:
        """Return the number that the model computes with."""
        return self.parameters[name].used

    @property
    def correlation(self) -> Floats:
        """Correlations of the estimated parameters, in the order of `estimated`."""
        sigma: Floats = np.sqrt(np.diag(self.covariance))
        sigma = np.where(sigma > 0.0, sigma, 1.0)
        return np.asarray(self.covariance / np.outer(sigma, sigma))

    def simulate(self, experiment: Experiment) -> Floats:
        """Run freely from the measured initial state by PWM and measured attitude; x, y, z [m], shape (N, 3).

        Wind and thrust scale are those in `flights`; of a flight that is not there they are found from its first 30 s
        (`trim`). What has been looked at need not be foretold: from there on a run starts anew from the measured state.
        """
        flight, trim = self._motion(experiment), self._trim_of(experiment)
        theta, shapes = self.kernel_inputs(flight, trim)
        start = _free_from(flight, trim)
        path = flight.run(theta, shapes, self.law, start)
        if start > 0:
            path = np.concatenate([flight.run(theta, shapes, self.law, 0, start), path])
        return self._outputs(experiment, path[:, :3])

    def drift(self, experiment: Experiment) -> Floats:
        """Return the standard deviation of the free run (`simulate`) by what is not known of wind, thrust and craft.

        Of x, y, z, m, shape (N, 3); NaN where the run is not free, because its trim has looked at the motion.
        """
        flight, trim = self._motion(experiment), self._trim_of(experiment)
        theta, shapes = self.kernel_inputs(flight, trim)
        start = _free_from(flight, trim)
        run = flight.run(theta, shapes, self.law, start)
        mean = np.array([*self._shared, trim.wind_exponent, trim.thrust_scale, trim.wind_n, trim.wind_e])
        looked = flight.cut(0, start + 1) if start > 0 else flight
        states = carry_states(looked, self._shared, self.law, craft_covariance=self._craft_covariance)
        errors = states.covariances[-1].copy()
        if start > 0:
            # The run goes on with its trim and without gusts: what the flight says against them is an error.
            known = np.concatenate(
                [states.own[-1] - mean[SHARED:], states.gust[-1], states.departure[-1:], states.craft[-1]]
            )
            errors += np.outer(known, known)
        else:
            # Another part of the flight was trimmed, which made up for the craft's errors as this one would.
            own, gusts, craft = slice(0, FIXED), slice(FIXED, STATES), slice(STATES, None)
            made_up = errors[own, craft] @ np.linalg.pinv(errors[craft, craft]) @ errors[craft, own]
            begun = states.wander.start(_in_runs(trim))
            errors[gusts], errors[:, gusts] = 0.0, 0.0
            errors[own, own], errors[gusts, gusts] = begun[own, own] + made_up, begun[gusts, gusts]
        free = flight.cut(start, len(flight.t)) if start > 0 else flight
        sigma = np.full((len(flight.t), 3), np.nan)
        highest = max(float(np.max(looked.ground - looked.position[:, 2])), WIND_HEIGHT)
        sigma[start:] = drift_sigma(free, run, mean, self.law, errors, states.wander, highest)
        return sigma

    def predict(
        self, experiment: Experiment, horizon: float = 1.0, every: int = 1, simulated: Floats | None = None
    ) -> Floats:
        """Predict x, y, z [m] of every sample from the state `horizon` seconds before it; shape (N, 3).

        Wind and thrust scale are states that a filter carries forward (`carried`): every prediction
        uses what the flight has told up to its restart, and lets gusts fade as gusts do. How strong gusts and noise
        are comes from the first 30 s. Samples before the first horizon are those of the free run, `simulated` where it
        is
        there already. With `every` it restarts at every so many-th sample only: NaN where no restart leads to.
        """
        flight = self._motion(experiment)
        steps = min(horizon_steps(horizon, flight.dt), len(flight.t) - 1)
        carried = self._carried(experiment, flight)
        restarts = np.arange(0, len(flight.t) - steps, every)
        block = np.searchsorted(carried.edges, restarts, side="right") - 1
        own, shared = carried.own[block], self._shared
        own[:, 1] += carried.departure[block]
        thetas = np.hstack([np.tile(shared, (len(restarts), 1)), own, carried.gust[block]])
        since = np.arange(steps + 1) * flight.dt
        shapes = np.column_stack([np.ones(steps + 1), np.exp(-since / GUST_SECONDS)])
        out = np.full((len(flight.t), 3), np.nan)
        out[restarts + steps] = flight.ahead(thetas, shapes, self.law, restarts, np.array([steps]))[:, 0, :3]
        predicted = self._outputs(experiment, out)
        predicted[: steps + 1] = (self.simulate(experiment) if simulated is None else simulated)[: steps + 1]
        return predicted

    def continued(self, before: Experiment, after: Experiment) -> RigidBodyModel:
        """Return the model with what the first part of a flight has told of its wind and thrust for the part after it.

        The fit's own errors of a single flight's scale hold that of the air's density, which is alike in both parts.
        """
        flight = self._motion(before)
        trim = early_trim(flight, self._shared, self.law, "the flight before", self._craft_covariance)
        return replace(self, flights={**self.flights, after.name: replace(trim, looked_until=None)})

    def with_early_trim(self, experiment: Experiment) -> RigidBodyModel:
        """Return the model with what `simulate` and `predict` find of a flight, so that they need not do so again."""
        flight, name = self._motion(experiment), experiment.name
        return replace(
            self,
            flights={**self.flights, name: self._trim_of(experiment)},
            followed={**self.followed, name: (flight, self._carried(experiment, flight))},
        )

    def initial_seconds(self, experiment: Experiment) -> float:
        """How much of a record's outputs a free run looks at, s: for wind and thrust scale where they are unknown."""
        known = self.flights.get(experiment.name)
        if known is None:
            return TRIM_SECONDS
        return 0.0 if known.looked_until is None else max(known.looked_until - float(experiment.t[0]), 0.0)

    def trim(
        self, experiment: Experiment, seconds: float | None = None, wind_spacing: float | None = None
    ) -> FlightTrim:
        """Find wind and thrust scale of a flight, by which its free run from the initial state fits best.

        With `seconds` of its beginning only, for what comes after it; with `wind_spacing` [s] the wind of a whole
        flight varies, as a broken line with this time between its points.
        """
        flight = self._motion(experiment)
        if seconds is not None and seconds < flight.t[-1] - flight.t[0]:
            beginning = flight.cut(0, max(round(seconds / flight.dt), 2))
            return early_trim(beginning, self._shared, self.law, f"first {seconds:g} s", self._craft_covariance)
        return whole_trim(flight, self._shared, self.law, "whole flight", wind_spacing, self._craft_covariance)

    def trimmed(
        self, experiments: Sequence[Experiment], seconds: float | None = None, wind_spacing: float | None = None
    ) -> RigidBodyModel:
        """Return the model with wind and thrust scale of these flights as `trim` finds them, and say so in its name."""
        flights = {record.name: self.trim(record, seconds, wind_spacing) for record in experiments}
        how = "each whole flight" if seconds is None else f"the first {seconds:g} s of each flight"
        return replace(
            self,
            name=f"{self.name.split(',')[0]}, wind and thrust scale trimmed on {how}",
            flights={**self.flights, **flights},
            findings=(*self.findings, *self.unusual_flights(flights)),
        )

    @staticmethod
    def unusual_flights(flights: Mapping[str, FlightTrim]) -> tuple[Finding, ...]:
        """Return findings about flights whose thrust scale is not what air temperature explains."""
        findings = (unusual_thrust(name, trim) for name, trim in flights.items())
        return tuple(finding for finding in findings if finding is not None)

    def drag(self, axis: str, speed: float) -> tuple[float, float]:
        """Drag [m/s^2] at a speed [m/s] along axis x, y or z in sea-level air at hover, with its sigma on any flight.

        Linear and quadratic drag are often known together much better than apart.
        """
        names = (f"drag_linear_{axis}", f"drag_quadratic_{axis}")
        weights = np.zeros(len(self.estimated))
        for name, part in zip(names, (speed, speed * abs(speed)), strict=True):
            if name in self.estimated:
                weights[self.estimated.index(name)] = part
        total = self.value(names[0]) * speed + self.value(names[1]) * speed * abs(speed)
        beyond = weights * np.array([self.parameters[name].transfer for name in self.estimated])
        return total, float(np.sqrt(max(float(weights @ self.covariance @ weights), 0.0) + float(beyond @ beyond)))

    def record(self) -> RigidBodyRecord:
        """Return what files hold of the model."""
        held = {
            attribute.name: getattr(self, attribute.name)
            for attribute in fields(self)
            if attribute.name not in ("vehicle", "followed")
        }
        return restored(plain({**held, "correlation": self.correlation, "wind_height": WIND_HEIGHT}), RigidBodyRecord)

    @classmethod
    def from_record(cls, record: RigidBodyRecord, vehicle: Vehicle) -> RigidBodyModel:
        """Make the model again for a craft with these motors; wind and thrust scale of flights are found anew."""
        assert record.covariance is not None  # left out in report.json only
        held = {
            attribute.name: getattr(record, attribute.name)
            for attribute in fields(cls)
            if hasattr(record, attribute.name)
        }
        finite = {
            "covariance": np.array(record.covariance, np.float64).reshape(len(record.estimated), -1),
            "condition": np.inf if record.condition is None else record.condition,
            "rotation_fit": restored(plain(record.rotation_fit), Mapping[str, float]),  # type: ignore[type-abstract]
            "rmse": np.nan if record.rmse is None else record.rmse,
        }
        return cls(**held | finite | {"vehicle": vehicle, "flights": {}, "findings": ()})

    def _motion(self, experiment: Experiment) -> BodyMotion:
        followed = self.followed.get(experiment.name)
        return motion(experiment, self.vehicle, self.reference_voltage) if followed is None else followed[0]

    def _trim_of(self, experiment: Experiment) -> FlightTrim:
        known = self.flights.get(experiment.name)
        return known if known is not None else self.trim(experiment, TRIM_SECONDS)

    @property
    def _shared(self) -> Floats:
        """Parameters of translation in the order of the kernels."""
        return np.array([self.value(name) for name in THETA])

    @property
    def _craft_covariance(self) -> Floats:
        """Covariance of `_shared`, but for what a flight's thrust scale makes up for, and the lag, which is small."""
        places = [self.estimated.index(name) for name in THETA]
        beyond = np.diag([self.parameters[name].transfer ** 2 for name in THETA])
        return left_open(self.covariance[np.ix_(places, places)] + beyond)

    def _carried(self, experiment: Experiment, flight: BodyMotion) -> Carried:
        """Follow wind and thrust scale through a flight; a trim found on its beginning is found again on the way."""
        if experiment.name in self.followed:
            return self.followed[experiment.name][1]
        known = self.flights.get(experiment.name)
        if known is None or known.looked_until is not None:
            return carry_states(flight, self._shared, self.law)
        own = np.array([known.wind_exponent, known.thrust_scale, known.wind_n, known.wind_e])
        return carry_states(flight, self._shared, self.law, (own, _in_runs(known)))

    def kernel_inputs(self, flight: BodyMotion, trim: FlightTrim) -> tuple[Floats, Floats]:
        """Return parameters and wind for the kernels: the winds north and east are shapes of their own."""
        return np.concatenate([self._shared, trim.own]), np.ascontiguousarray(trim.wind(flight.t))

    @staticmethod
    def _outputs(experiment: Experiment, position: Floats) -> Floats:
        return np.asarray(position * np.array([1.0, 1.0, -1.0]) + experiment.y[0])


def _in_runs(trim: FlightTrim) -> Floats:
    """Return standard deviations of exponent, thrust scale, wind north and east by which runs with a trim drift."""
    return np.array([*trim.in_runs, trim.in_runs[-1]])


def _free_from(flight: BodyMotion, trim: FlightTrim) -> int:
    """Return the sample from which a free run is free: the last that its trim has looked at."""
    if trim.looked_until is None:
        return 0
    return int(np.clip(np.searchsorted(flight.t, trim.looked_until + 1e-9) - 1, 0, len(flight.t) - 2))
