"""Rotors: thrust and torque for a speed and the air they turn in."""

import math
from dataclasses import dataclass

from simulation._kernels import induced_velocity
from simulation._parameters import BladeParameters
from simulation.atmosphere import SEA_LEVEL_DENSITY
from simulation.errors import require_positive


@dataclass(frozen=True, slots=True, kw_only=True)
class QuadraticRotor:
    """Thrust ``k w^2`` and torque ``b w^2`` of Elhesasy 2024 (eq. 12), proportional to air density."""

    thrust_coefficient: float  #: k, N s^2 at `reference_density`.
    torque_coefficient: float  #: b, N m s^2 at `reference_density`.
    reference_density: float = SEA_LEVEL_DENSITY  #: Air density at which k and b hold, kg/m^3.

    def __post_init__(self) -> None:
        require_positive("rotor", self, ("thrust_coefficient", "torque_coefficient", "reference_density"))

    def thrust(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Thrust [N] at `speed` [rad/s] in air of `density` [kg/m^3]."""
        return self.thrust_coefficient * density / self.reference_density * speed * speed

    def torque(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Torque [N m] at `speed` [rad/s] in air of `density` [kg/m^3]."""
        return self.torque_coefficient * density / self.reference_density * speed * speed


@dataclass(frozen=True, slots=True, kw_only=True)
class BladeElementRotor:
    """Blade-element and momentum rotor of Guntur 2019 (after Stevens and Lewis), linear twist of constant pitch.

    With tip speed ``w R``, velocity through the air (U, V) across the rotor and W along it (positive sinking)::

        T = rho a b c R / 4 [(W - v) w R + 2/3 (w R)^2 (th0 + 3/4 th1) + (U^2 + V^2) (th0 + 1/2 th1)]
        T = 2 eta v rho A sqrt(U^2 + V^2 + (W - v)^2)

    are solved for the induced velocity v. The thesis gives the rotor no torque; here it is that of the ideal power
    ``T (v - W)``, a lower bound.
    """

    radius: float  #: m.
    pitch: float  #: Advance per turn of the propeller as its maker states it, m.
    chord: float  #: Mean chord, m.
    blades: int = 2
    lift_slope: float = 5.7  #: Per rad.
    efficiency: float = 1.0  #: eta.

    def __post_init__(self) -> None:
        require_positive("rotor", self, ("radius", "pitch", "chord", "blades", "lift_slope", "efficiency"))

    @property
    def parameters(self) -> BladeParameters:
        """Numbers that the equations of motion read."""
        angle = math.atan2(self.pitch, 2.0 * math.pi * 0.75 * self.radius)
        return BladeParameters(
            radius=float(self.radius),
            area=math.pi * self.radius**2,
            lift=float(self.lift_slope * self.blades * self.chord),
            theta0=2.0 * angle,
            theta1=-4.0 / 3.0 * angle,
            efficiency=float(self.efficiency),
        )

    def induced_velocity(
        self, speed: float, density: float = SEA_LEVEL_DENSITY, across: float = 0.0, sinking: float = 0.0
    ) -> float:
        """Return the induced velocity, m/s."""
        velocity, _ = induced_velocity(speed, across * across, sinking, density, self.parameters)
        return float(velocity)

    def thrust(
        self, speed: float, density: float = SEA_LEVEL_DENSITY, across: float = 0.0, sinking: float = 0.0
    ) -> float:
        """Return the thrust, N."""
        _, thrust = induced_velocity(speed, across * across, sinking, density, self.parameters)
        return float(thrust)

    def torque(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Torque [N m] of the ideal power at rest in the air."""
        return self.thrust(speed, density) * self.induced_velocity(speed, density) / speed if speed > 0.0 else 0.0


Rotor = QuadraticRotor | BladeElementRotor

#: Stands in the equations of motion where rotors follow the quadratic law.
NO_BLADE = BladeParameters(0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
