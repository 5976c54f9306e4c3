"""Standard atmosphere, shifted to the weather of a place.

ISO 2533 (the same numbers as GOST 4401-81 and ICAO Doc 7488 in this range), troposphere only.
"""

from dataclasses import dataclass
from typing import Self

from simulation._parameters import AirParameters
from simulation.errors import ParameterError

GRAVITY = 9.80665  # m/s^2, standard
GAS_CONSTANT = 287.05287  # J/(kg K), dry air
LAPSE_RATE = 0.0065  # K/m
SEA_LEVEL_TEMPERATURE = 288.15  # K
SEA_LEVEL_PRESSURE = 101325.0  # Pa
SEA_LEVEL_DENSITY = 1.225  # kg/m^3
#: p ~ T^n in a layer of constant lapse rate.
PRESSURE_EXPONENT = GRAVITY / (GAS_CONSTANT * LAPSE_RATE)


@dataclass(frozen=True, slots=True)
class Atmosphere:
    """Air over a place: its state on the ground; above it temperature falls by the standard lapse rate."""

    temperature: float  #: On the ground, K.
    pressure: float  #: On the ground, Pa.

    def __post_init__(self) -> None:
        if not 180.0 < self.temperature < 340.0:
            raise ParameterError(f"air temperature {self.temperature:g} K is not one to fly in (180 to 340 K)")
        if not 15e3 < self.pressure < 115e3:
            raise ParameterError(f"air pressure {self.pressure:g} Pa is outside the troposphere (15 to 115 kPa)")

    @classmethod
    def standard(cls, altitude: float, *, warmer: float = 0.0) -> Self:
        """Return the standard atmosphere, `warmer` [K] than standard, its ground at `altitude` [m above sea level]."""
        if not -500.0 <= altitude <= 11000.0:  # m: the tropopause
            raise ParameterError(f"altitude {altitude:g} m is outside the standard troposphere (-500 to 11000 m)")
        temperature = SEA_LEVEL_TEMPERATURE - LAPSE_RATE * altitude
        pressure = SEA_LEVEL_PRESSURE * (temperature / SEA_LEVEL_TEMPERATURE) ** PRESSURE_EXPONENT
        return cls(temperature + warmer, pressure)

    def temperature_at(self, height: float) -> float:
        """Temperature [K] at `height` [m] above the ground."""
        return self.temperature - LAPSE_RATE * height

    def pressure_at(self, height: float) -> float:
        """Pressure [Pa] at `height` [m] above the ground."""
        return float(self.pressure * (self.temperature_at(height) / self.temperature) ** PRESSURE_EXPONENT)

    def density_at(self, height: float) -> float:
        """Density [kg/m^3] at `height` [m] above the ground."""
        return self.pressure_at(height) / (GAS_CONSTANT * self.temperature_at(height))

    def kernel_parameters(self) -> AirParameters:
        """Return the numbers that the equations of motion read."""
        return AirParameters(self.density_at(0.0), self.temperature, LAPSE_RATE, PRESSURE_EXPONENT - 1.0)
