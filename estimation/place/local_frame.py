"""The local north-east-down frame: between latitude/longitude and metres, gravity, Earth's rotation."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from pymap3d import rcurve

from logparse import Geodetic

#: Radius of the sphere on which ArduPilot (and its simulator's world) measures north and east, m
#: (AP_Common/Location: 0.011131884502145034 m per 1e-7 degree).
ARDUPILOT_RADIUS = 0.011131884502145034e7 * 180.0 / np.pi
#: Earth's rotation rate, rad/s (WGS84).
EARTH_RATE = 7.292115e-5


def is_simulated(parameters: Mapping[str, float]) -> bool:
    """Return whether a log is of the firmware's own simulator, from the parameters that only such a build has."""
    return any(name.startswith("SIM_") for name in parameters)


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """Curvilinear north-east-down coordinates about an origin.

    North and east are arc lengths at the origin's radii of curvature, down is minus the rise above the origin, so that
    level flight at constant altitude stays at constant `p_d`.
    """

    origin: Geodetic
    #: m per rad of latitude and longitude.
    metres_per_lat: float
    metres_per_lon: float

    @classmethod
    def at(cls, origin: Geodetic, *, spherical: bool = False) -> "LocalFrame":
        """Make the frame on WGS84, or on ArduPilot's sphere for the world of its simulator."""
        if spherical:
            return cls(origin, ARDUPILOT_RADIUS, ARDUPILOT_RADIUS * np.cos(origin.lat))
        meridian = float(rcurve.meridian(origin.lat, deg=False)) + origin.alt
        transverse = float(rcurve.transverse(origin.lat, deg=False)) + origin.alt
        return cls(origin, meridian, transverse * np.cos(origin.lat))

    def to_ned(self, lat: np.ndarray, lon: np.ndarray, alt: np.ndarray) -> np.ndarray:
        """Convert latitude, longitude [rad] and altitude [m] to NED [m], shape (n, 3)."""
        east_angle = np.mod(lon - self.origin.lon + np.pi, 2.0 * np.pi) - np.pi
        return np.column_stack(
            [
                (lat - self.origin.lat) * self.metres_per_lat,
                east_angle * self.metres_per_lon,
                self.origin.alt - alt,
            ]
        )

    @property
    def gravity(self) -> float:
        """Normal gravity at the origin, m/s^2 (Somigliana's formula with the free-air gradient)."""
        sin2 = np.sin(self.origin.lat) ** 2
        surface = 9.7803253359 * (1.0 + 0.00193185265241 * sin2) / np.sqrt(1.0 - 0.00669437999014 * sin2)
        return float(surface - 3.086e-6 * self.origin.alt)

    @property
    def earth_rate(self) -> np.ndarray:
        """Earth's rotation in NED, rad/s, shape (3,)."""
        return EARTH_RATE * np.array([np.cos(self.origin.lat), 0.0, -np.sin(self.origin.lat)])
