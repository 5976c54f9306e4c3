"""From flights to a rigid body: equation error, filter error, rotation."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from core.units import STANDARD_GRAVITY
from logparse import Finding, Severity, Vehicle
from sysid.records.experiment import Experiment, ExperimentError, Floats, require_alike
from sysid.records.flight_record import POSITION_UNKNOWN
from sysid.records.thrust_curve import REFERENCE_DENSITY
from sysid.rigid_body._rigid_kernels import AXIS_DRAG, ROTOR_DRAG
from sysid.rigid_body.body_motion import SHARED, THETA, BodyMotion, motion
from sysid.rigid_body.body_parameters import (
    drag_apart,
    in_si,
    judge_parameters,
    other_curve,
    thrust_over,
    undetermined,
)
from sysid.rigid_body.filter_error import FilterErrorFit, Prior, fit_best_law
from sysid.rigid_body.model import RigidBodyModel
from sysid.rigid_body.model_record import FlightTrim
from sysid.rigid_body.rotation import RotationFit, fit_rotation
from sysid.rigid_body.systematic import EXPO, with_shared_errors
from sysid.rigid_body.trim import left_open, trim_prior, whole_trim
from sysid.rotors.thrust_regression import conditions_of, mass_unknown, outputs_of
from sysid.transfer_functions.search import Progress

#: What is known of any multirotor before it flies: mean, standard deviation, limits. The spreads are wide, so that they
#: only hold what a flight does not excite. The curve's mean is the autopilot's setting; nothing is known of thrust.
PRIORS: Mapping[str, tuple[float, float, float, float]] = {
    "thrust": (0.0, np.inf, 1e-3, 1e4),
    "thrust_expo": (0.65, 0.1, 0.0, 1.0),
    "drag_linear_x": (0.25, 0.5, 0.0, 5.0),
    "drag_linear_y": (0.25, 0.5, 0.0, 5.0),
    "drag_linear_z": (0.25, 0.5, 0.0, 5.0),
    "drag_quadratic_x": (0.02, 0.1, 0.0, 1.0),
    "drag_quadratic_y": (0.02, 0.1, 0.0, 1.0),
    "drag_quadratic_z": (0.02, 0.1, 0.0, 1.0),
    "climb_loss": (0.0, 0.05, 0.0, 1.0),
    "tilt_x": (0.0, 0.01, -0.1, 0.1),
    "tilt_y": (0.0, 0.01, -0.1, 0.1),
    "motor_lag": (0.03, 0.03, 0.0, 0.3),
}


def fit_rigid_body(
    experiments: Experiment | Sequence[Experiment],
    mass: float | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    *,
    time_limit: float = 60.0,
    progress: Progress | None = None,
) -> RigidBodyModel:
    """Identify thrust, drag, wind and effectiveness of one craft from one or more flights.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        Inputs PWM of the motors, outputs x, y, z, with context; best at 50 samples a second.
    mass : float, optional
        kg; without it everything is per unit of mass.
    priors : mapping of str to (mean, sigma), optional
        What is known beforehand of parameters of `TRANSLATION_UNITS`, in their units, such as the thrust from a bench
        over the mass.
    time_limit : float
        s, for the steps of output error; the best values so far are returned, with a finding.
    progress : callable, optional
        ``progress(stage, fraction)``.

    Raises
    ------
    ExperimentError
        When the records are not alike or not of the kind, or too short, or their position is not known, or a prior is
        none of the parameters'.
    MissingDataError
        Without attitude.
    """
    begun, report = time.monotonic(), progress or (lambda stage, fraction: None)
    records = require_alike(experiments)
    if mass is not None and not mass > 0.0:
        raise ExperimentError(f"mass must be positive, not {mass} kg")
    unknown = set(priors or {}) - set(THETA)
    if unknown:
        raise ExperimentError(f"no such parameter: {', '.join(sorted(unknown))}; there are {', '.join(THETA)}")
    lost = next((f for record in records for f in record.findings if f.id == POSITION_UNKNOWN), None)
    if lost is not None:
        raise ExperimentError(f"{lost.reason.rstrip('.')}; fit_thrust tells the thrust without")
    vehicle, voltage, findings = conditions_of(records)
    if mass is None:
        findings.append(mass_unknown())
    motions = [motion(record, vehicle, voltage, joined=True) for record in records]
    prior, start = _prior(motions, vehicle, priors or {})
    findings += outputs_of(records, vehicle)
    fine, law = fit_best_law(motions, prior, start, begun + time_limit, report)
    fine = with_shared_errors(motions, fine, law, prior)
    if not fine.converged:
        findings.append(
            Finding(
                "fit-not-converged",
                Severity.WARNING,
                "the fit stopped before it settled; its standard errors mean little",
                "give it more time, use longer flights, or leave out flights in which the craft was disturbed",
            )
        )
    report("paths", 0.7)
    shared, craft_covariance = fine.values[:SHARED], left_open(fine.covariance[:SHARED, :SHARED])
    # Points of a varying wind stand nearer to one another than the long gusts last (Dryden: about 100 m at 15 m height,
    # 20 to 50 s in light wind), so that free runs of a fitted flight follow them.
    trims = [whole_trim(flight, shared, law, "fit", 20.0, craft_covariance) for flight in motions]
    if not np.isfinite(prior.sigma[0]):
        fine, trims = _at_level(fine, trims)
    rmse = _window_error(motions, fine.values[:SHARED], trims, law)
    report("rotation", 0.8)
    turning = _rotation(records, vehicle, voltage, float(fine.values[EXPO]))
    parameters, covariance, estimated = judge_parameters(fine, prior, records, vehicle, voltage, turning)
    findings += other_curve(fine, vehicle)
    findings += undetermined(parameters) + drag_apart(parameters, motions, fine, covariance)
    report("fitted", 1.0)

    def over_thrust(name: str) -> float:
        return thrust_over(name, parameters, covariance, estimated)

    return RigidBodyModel(
        name="rigid body, thrust and drag from PWM and attitude",
        parameters={
            name: in_si(parameter, parameters, mass, over_thrust(name)) for name, parameter in parameters.items()
        },
        estimated=estimated,
        covariance=covariance,
        condition=_condition(fine.information[:SHARED, :SHARED]),
        rotor_drag=bool(law & ROTOR_DRAG),
        axis_drag=bool(law & AXIS_DRAG),
        mass=mass,
        vehicle=vehicle,
        reference_density=REFERENCE_DENSITY,
        reference_voltage=voltage,
        flights={flight.name: trim for flight, trim in zip(motions, trims, strict=True)},
        rotation_fit={} if turning is None else {axis: fit.coherent for axis, fit in turning.axes.items()},
        rmse=rmse,
        training=tuple(record.name for record in records),
        findings=tuple(findings),
        contradicted=abs(float(fine.halfway[EXPO])),
    )


def _prior(
    motions: Sequence[BodyMotion], vehicle: Vehicle, given: Mapping[str, tuple[float, float]]
) -> tuple[Prior, Floats]:
    """Prior knowledge and where to start; thrust starts where it carries the weight."""
    shared = np.array([PRIORS[name] for name in THETA])
    shared[THETA.index("thrust_expo"), 0] = np.clip(vehicle.thrust_expo, 0.0, 1.0)
    for name, (mean, sigma) in given.items():
        low, high = PRIORS[name][2:]
        if not (sigma > 0.0 and low <= mean <= high):
            raise ExperimentError(
                f"{name} cannot be {mean} with a standard deviation of {sigma}: it lies between {low} and {high}, and "
                "nobody knows it exactly"
            )
        shared[THETA.index(name), :2] = mean, sigma
    own = np.array(trim_prior()).T
    table = np.vstack([shared, *([own] * len(motions))])
    prior = Prior(*np.ascontiguousarray(table.T))
    start = prior.mean.copy()
    expo = start[1]
    pulls = np.concatenate([m.density * ((1.0 - expo) * m.linear + expo * m.square) for m in motions])
    if not pulls.mean() > 0.0:
        raise ExperimentError("no motor turns in flight: all motor outputs are at or below idle")
    if not start[0] > 0.0:
        start[0] = STANDARD_GRAVITY / pulls.mean()
    return prior, start


def _at_level(fine: FilterErrorFit, trims: Sequence[FlightTrim]) -> tuple[FilterErrorFit, list[FlightTrim]]:
    """Return the fit with the thrust that carries the craft along the paths of its flights, and trims beside that.

    Gusts that last take the level of thrust away from a fit, which then goes by how thrust varies with its commands: on
    real flights to 16 % below what carries the weight.
    """
    level = float(np.exp(np.mean(np.log([trim.thrust_scale for trim in trims]))))
    to_level = np.ones(len(fine.values))
    to_level[0] = level
    return replace(fine, values=to_level * fine.values, covariance=np.outer(to_level, to_level) * fine.covariance), [
        replace(trim, thrust_scale=trim.thrust_scale / level) for trim in trims
    ]


def _window_error(motions: Sequence[BodyMotion], shared: Floats, trims: Sequence[FlightTrim], law: int) -> float:
    """Root mean square error of positions over runs of ten seconds from measured states, m."""
    missed = []
    for flight, trim in zip(motions, trims, strict=True):
        theta, shapes = np.concatenate([shared, trim.own]), np.ascontiguousarray(trim.wind(flight.t))
        size = round(10.0 / flight.dt)
        for start in range(0, len(flight.t) - 1, size):
            stop = min(start + size, len(flight.t))
            run = flight.run(theta, shapes, law, start, stop)
            missed.append((run[:, :3] - flight.position[start:stop]).ravel())
    return float(np.sqrt(np.mean(np.concatenate(missed) ** 2)))


def _rotation(
    records: Sequence[Experiment], vehicle: Vehicle, voltage: float | None, expo: float
) -> RotationFit | None:
    if not vehicle.motors or {f"m{motor.number}" for motor in vehicle.motors} != set(records[0].input_names):
        return None
    return fit_rotation(records, vehicle, voltage, expo)


def _condition(information: Floats) -> float:
    """Condition number of an information matrix with unit diagonal; infinite where a parameter has none."""
    diagonal = np.diag(information)
    if not (diagonal > 0.0).all():
        return float("inf")
    scale = np.sqrt(diagonal)
    return float(np.linalg.cond(information / np.outer(scale, scale)))
