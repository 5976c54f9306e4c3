"""Drag as EKF3 wants it to tell the wind: ballistic coefficients and momentum drag, of an identified rigid body.

EKF3 (AP_NavEKF3_AirDataFusion, FuseDragForces) predicts the specific force along body x and y from the velocity u
through the air along that axis, with r its density ratio and rho = 1.225 r::

    f = -rho u |u| / (2 BCOEF) - MCOEF r u

and the rigid body has, with s the density over 1.225 kg/m^3 and L = sqrt(s) in hover (rotors) or s::

    f = -s drag_quadratic u |u| - L drag_linear u

so that at the density flown BCOEF = 1.225 r / (2 s drag_quadratic) and MCOEF = L drag_linear / r. EKF3 has one
MCOEF for both axes; the four coefficients become three by generalised least squares with their covariance.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from core.parameter import Parameter
from sysid.autopilot.values import AutopilotValue, ParameterFile, decided, refused
from sysid.records.experiment import Experiment, Floats
from sysid.records.thrust_curve import REFERENCE_DENSITY, relative_density
from sysid.rigid_body.body_motion import motion
from sysid.rigid_body.model import RigidBodyModel
from sysid.rigid_body.model_record import WIND_HEIGHT, FlightTrim

NAMES = ("EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y", "EK3_DRAG_MCOEF")

#: Part of the wind by which EKF3's may err (sigma) for the coefficients: the simulator's own hint makes it err by a
#: tenth (`drag_octa_hint`). In winds of so many m/s, or at the speed flown where that is more.
_WIND_PART, _IN_WIND = 0.15, 10.0

#: Departure of the wind between the halves of a flight that is another wind, m/s: a wind on `drag_octa_off` that
#: changes by 2.2 m/s shows as 1.0 and bends the drag by a quarter, one that changes by 1 as 0.5 and bends it by 5 %.
_TURNED = 0.6


def drag_values(
    model: RigidBodyModel, records: Sequence[Experiment], version: tuple[int, int], flown: Mapping[str, float]
) -> list[AutopilotValue]:
    """Translate the drag of a rigid body into EKF3's parameters, or say why not."""

    def no(why: str) -> list[AutopilotValue]:
        return refused(NAMES, ParameterFile.WIND, flown, why)

    for record in records:
        if (turned := wind_turned(model.flights[record.name])) > _TURNED:
            return no(
                f"{record.name}: between its halves the wind changed by {turned:.1f} m/s, which drag is not told from"
            )
    drags = [f"drag_{law}_{axis}" for law in ("linear", "quadratic") for axis in "xy"]
    places = [model.estimated.index(name) for name in drags]
    # What is set on a craft is for its other flights.
    others = np.diag([model.parameters[name].transfer ** 2 for name in drags])
    values, covariance, excess = _of_three(
        np.array([model.value(name) for name in drags]), model.covariance[np.ix_(places, places)] + others
    )
    flown_at = np.sqrt(np.mean(np.concatenate([airspeeds(model, record) ** 2 for record in records]), axis=0))
    s = float(np.median(np.concatenate([relative_density(record) for record in records])))
    # Since ArduCopter 4.7 the ratio is that of densities; before it was the root of true over equivalent airspeed.
    ratio = s if version >= (4, 7) else s**-0.25
    linear = values[0] * (np.sqrt(s) if model.rotor_drag else s)
    sigma = np.sqrt(np.diag(covariance))
    parameters: dict[str, Parameter] = {}
    for k, name in enumerate(NAMES[:2]):
        quadratic, speed = values[1 + k], max(float(flown_at[k]), _IN_WIND)
        by = np.array([speed, speed**2])
        force = float(np.sqrt(by @ covariance[np.ix_([0, 1 + k], [0, 1 + k])] @ by))
        error = force / (values[0] + 2.0 * quadratic * speed) if quadratic > 0.0 else np.inf
        if not error <= _WIND_PART * speed:
            why = model.parameters[f"drag_quadratic_{'xy'[k]}"].reason or "fly squares at several speeds, heading held"
            return no(f"in {speed:.0f} m/s EKF3's wind would err by {error:.1f} m/s (sigma): {why}")
        value = float(REFERENCE_DENSITY * ratio / (2.0 * s * quadratic))
        reason = f"mass over drag area along body {'xy'[k]}; flown at {flown_at[k]:.1f} m/s rms through the air"
        parameters[name] = Parameter(value, value * float(sigma[1 + k] / quadratic), "kg/m^2", reason)
    reason = f"momentum drag of the rotors at density {s:.3f} of sea level"
    if excess > 1.0:
        reason += f"; x and y differ by {excess:.1f} times their errors, and EKF3 has one number"
    mcoef = float(linear / ratio)
    # The firmware knows none below zero.
    parameters[NAMES[2]] = Parameter(max(mcoef, 0.0), mcoef * float(sigma[0] / values[0]), "1/s", reason)
    return decided(parameters, ParameterFile.WIND, flown)


def _of_three(values: Floats, covariance: Floats) -> tuple[Floats, Floats, float]:
    """Return one linear coefficient and the two quadratic ones, their covariance, and by how much x and y disagree."""
    design = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    weights = np.linalg.inv(covariance)
    spread = np.linalg.inv(design.T @ weights @ design)
    estimate = spread @ design.T @ weights @ values
    left = values - design @ estimate
    excess = float(np.sqrt(left @ weights @ left))
    return estimate, spread * max(excess, 1.0) ** 2, excess


def airspeeds(model: RigidBodyModel, record: Experiment) -> Floats:
    """Return the speed through the air along body x and y, m/s, (N, 2), with the wind of the flight."""
    flight, trim = motion(record, model.vehicle, model.reference_voltage), model.flights[record.name]
    height = np.maximum(flight.ground - flight.position[:, 2], 0.0)
    wind = trim.wind(flight.t) * (height / WIND_HEIGHT)[:, None] ** trim.wind_exponent
    through = flight.velocity - np.pad(wind, ((0, 0), (0, 1)))
    return np.asarray(np.einsum("nij,ni->nj", flight.rotation, through)[:, :2])


def wind_turned(trim: FlightTrim) -> float:
    """Return by how much the wind differs between the halves of a flight, m/s."""
    parts = np.array([knot[1:] for knot in trim.variation])
    if len(parts) < 2:
        return 0.0
    half = len(parts) // 2
    return float(np.hypot(*(parts[:half].mean(axis=0) - parts[-half:].mean(axis=0))))
