"""Rotors: thrust and torque for a speed and the air they turn in."""

import math
from dataclasses import dataclass

from simulation.atmosphere import SEA_LEVEL_DENSITY
from simulation.errors import ParameterError


@dataclass(frozen=True, slots=True, kw_only=True)
class QuadraticRotor:
    """Thrust ``k w^2`` and torque ``b w^2`` of Elhesasy 2024 (eq. 12), proportional to air density.

    Attributes
    ----------
    thrust_coefficient : float
        k, N s^2 at `reference_density`.
    torque_coefficient : float
        b, N m s^2 at `reference_density`.
    reference_density : float
        Air density at which k and b hold, kg/m^3.
    """

    thrust_coefficient: float
    torque_coefficient: float
    reference_density: float = SEA_LEVEL_DENSITY

    def __post_init__(self) -> None:
        for name in ("thrust_coefficient", "torque_coefficient", "reference_density"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ParameterError(f"rotor: {name} must be positive, not {value:g}")

    def thrust(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Thrust [N] at `speed` [rad/s] in air of `density` [kg/m^3]."""
        return self.thrust_coefficient * density / self.reference_density * speed * speed

    def torque(self, speed: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Torque [N m] at `speed` [rad/s] in air of `density` [kg/m^3]."""
        return self.torque_coefficient * density / self.reference_density * speed * speed

    def speed_for(self, thrust: float, density: float = SEA_LEVEL_DENSITY) -> float:
        """Speed [rad/s] that gives `thrust` [N] in air of `density` [kg/m^3]."""
        return math.sqrt(thrust * self.reference_density / (self.thrust_coefficient * density))
