"""The rigid body identified from flight: thrust, drag, wind, and how strongly motors turn the craft.

Translation, with attitude as an input (NED world, FRD body; R from body to world; s = density over 1.225 kg/m^3)::

    v' = (0, 0, g) + R a_b
    t  = thrust * scale * s * (V / V_ref)^2 * sum_k [(1 - e) c_k + e c_k^2]     first-order lag `motor_lag`
    u  = R^T (v - wind(h)),   wind(h) = wind_10 (h / 10 m)^wind_exponent
    a_b = t (tilt_x, tilt_y, -1) - L drag_linear u - s drag_quadratic |u| u + (0, 0, s climb_loss max(0, -u_z)^2)

with c_k the command of motor k between idle and full spin, and L = sqrt(s t / g) where drag is that of the rotors, which
goes with their speed, or L = s where it is not. Rotation, with unit arms s_k = -sin(angle_k), p_k = cos(angle_k), and
y_k = -spin_k (a rotor turning clockwise pushes the craft anticlockwise)::

    w_x' = roll_gain  s sum_k (s_k + cg_y) T_k - roll_damping w_x
    w_y' = pitch_gain s sum_k (p_k - cg_x) T_k - pitch_damping w_y
    w_z' = yaw_gain   s sum_k y_k T_k          - yaw_damping w_z,     T_k = (1 - e) c_k + e c_k^2

so that inertia over arm is ``I_xx / l = m thrust / roll_gain``. Motion alone gives everything per unit of mass.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from logparse import Finding, Vehicle
from sysid.experiment import Floats

#: Height to which winds refer, m (the meteorologists').
WIND_HEIGHT = 10.0

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
    "wind_exponent": "1",
    "motor_lag": "s",
}
ROTATION_UNITS: Mapping[str, str] = {
    "roll_gain": "rad/s^2, one motor at full command on an arm along y in sea-level air (l k/I_xx)",
    "pitch_gain": "rad/s^2 (l k/I_yy)",
    "yaw_gain": "rad/s^2, one motor at full command (b/I_zz)",
    "roll_damping": "1/s",
    "pitch_damping": "1/s",
    "yaw_damping": "1/s",
    "cg_x": "1, centre of gravity ahead of the motors' centre, in arms",
    "cg_y": "1, to the right",
}


@dataclass(frozen=True, slots=True)
class BodyParameter:
    """One parameter and what is known of it.

    Attributes
    ----------
    name, unit : str
    value, sigma : float or None
        Estimate and standard error (for coloured residuals); None when not determined.
    determined : bool
    reason : str
        Why not, empty when determined.
    used : float
        What the model computes with: the estimate, or what stands in for it when not determined.
    si_value, si_sigma : float or None
        The same in SI for the mass given (N, N s/m, ...); None without a mass, or where mass does not enter.
    si_unit : str
    """

    name: str
    unit: str
    value: float | None
    sigma: float | None
    determined: bool
    reason: str
    used: float
    si_value: float | None = None
    si_sigma: float | None = None
    si_unit: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Give numbers and text for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class FlightTrim:
    """What differs between flights of one craft.

    Attributes
    ----------
    wind_n, wind_e : float
        Velocity of the air 10 m above the place of take-off, towards north and east, m/s.
    wind_sigma : float
        Standard error of each, m/s.
    thrust_scale, thrust_scale_sigma : float
        Thrust of this flight over the model's: temperature of the air, battery, mass taken on.
    source : str
        From what: ``"fit"``, ``"whole flight"``, ``"first 30 s"``.
    """

    wind_n: float
    wind_e: float
    wind_sigma: float
    thrust_scale: float
    thrust_scale_sigma: float
    source: str

    def to_dict(self) -> dict[str, Any]:
        """Give numbers for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True)
class RigidBodyModel:
    """A craft as physics sees it.

    Attributes
    ----------
    name : str
    parameters : mapping of str to BodyParameter
        By the names of `TRANSLATION_UNITS` and `ROTATION_UNITS`; all are there, determined or not.
    estimated : tuple of str
        Names of rows and columns of `covariance`.
    covariance : ndarray
        Of the estimated parameters, valid for coloured residuals.
    condition : float
        Condition number of the information on the translational parameters, scaled to unit diagonal.
    rotor_drag : bool
        Whether linear drag goes with the rotors' speed.
    mass : float or None
        As given, kg.
    vehicle : Vehicle
        Geometry of the motors and the autopilot's output scaling.
    reference_density : float
        1.225 kg/m^3.
    reference_voltage : float or None
        V; None when voltage was not logged.
    flights : mapping of str to FlightTrim
        Wind and thrust scale of the flights that they are known of.
    rotation_fit : mapping of str to float
        R^2 of angular acceleration per axis, where estimated.
    rmse : float
        Of position over the windows of the fit, m.
    training : tuple of str
    findings : tuple of Finding
    """

    name: str
    parameters: Mapping[str, BodyParameter]
    estimated: tuple[str, ...]
    covariance: Floats
    condition: float
    rotor_drag: bool
    mass: float | None
    vehicle: Vehicle
    reference_density: float
    reference_voltage: float | None
    flights: Mapping[str, FlightTrim]
    rotation_fit: Mapping[str, float]
    rmse: float
    training: tuple[str, ...]
    findings: tuple[Finding, ...]

    def value(self, name: str) -> float:
        """Give the number that the model computes with."""
        return self.parameters[name].used

    @property
    def correlation(self) -> Floats:
        """Correlations of the estimated parameters, in the order of `estimated`."""
        sigma = np.sqrt(np.diag(self.covariance))
        sigma = np.where(sigma > 0.0, sigma, 1.0)
        return np.asarray(self.covariance / np.outer(sigma, sigma))
