"""Where a log was flown: the local north-east-down frame, gravity, Earth's rotation and magnetic field."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from pygeomag import GeoMag
from pymap3d import rcurve

from logparse import Geodetic
from logparse.craft.vehicle import is_simulated

#: Radius of the sphere on which ArduPilot (and its simulator's world) measures north and east, m
#: (AP_Common/Location: 0.011131884502145034 m per 1e-7 degree).
ARDUPILOT_RADIUS = 0.011131884502145034e7 * 180.0 / np.pi
#: Earth's rotation rate, rad/s (WGS84).
EARTH_RATE = 7.292115e-5


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


@dataclass(frozen=True, slots=True)
class World:
    """Gravity [m/s^2] and Earth's rotation in NED [rad/s], shape (3,)."""

    gravity: float
    earth_rate: np.ndarray


#: First and last decimal year of the field models that pygeomag brings.
_MODEL_YEARS = (2010.0, 2029.9)
#: Year assumed for a log without a date; declination moves by up to 0.2 degrees a year.
_DEFAULT_YEAR = 2020.0
#: Spacing of the autopilot's tables of declination, inclination and intensity, deg, and the year that those of firmware
#: 4.x were made for (AP_Declination).
_TABLE_STEP, _TABLE_YEAR = 10.0, 2023.0


@dataclass(frozen=True, slots=True)
class MagneticField:
    """The field in NED, T, shape (3,), and where its declination came from.

    The source is ``"WMM"``, ``"COMPASS_DEC"`` or, of a simulated flight, ``"autopilot table"``.
    """

    ned: np.ndarray
    declination_source: str


def world_field(place: Geodetic, parameters: Mapping[str, float], date: datetime | None) -> MagneticField:
    """Return the World Magnetic Model's field, with the autopilot's declination where the date is not known.

    The world of the firmware's simulator has the field of the autopilot's tables, which differs from the model's by up
    to 0.5 uT and, where declination changes fast, a degree.
    """
    logged, simulated = parameters.get("COMPASS_DEC", 0.0), is_simulated(parameters)
    if simulated:
        elements, source = _table(place), "autopilot table"
    else:
        year = _DEFAULT_YEAR
        if date is not None:
            year = date.year + (date.timetuple().tm_yday - 1) / 365.25
        year = min(max(year, _MODEL_YEARS[0]), _MODEL_YEARS[1])
        elements, source = _elements(np.degrees(place.lat), np.degrees(place.lon), place.alt, year), "WMM"
    declination, inclination, intensity = elements
    if logged != 0.0 and (date is None or simulated):
        declination, source = logged, "COMPASS_DEC"
    level = intensity * np.cos(inclination)
    ned = np.array([level * np.cos(declination), level * np.sin(declination), intensity * np.sin(inclination)])
    return MagneticField(ned, source)


def _elements(lat: float, lon: float, alt: float, year: float) -> np.ndarray:
    """Return the model's declination and inclination [rad] and intensity [T] at a place [deg, m]."""
    model = GeoMag(base_year=int(year)).calculate(
        glat=lat, glon=lon, alt=alt / 1000.0, time=year, allow_date_outside_lifespan=True
    )
    return np.array([np.radians(model.d), np.radians(model.i), 1e-9 * model.f])


def _table(place: Geodetic) -> np.ndarray:
    """Return the elements as the autopilot looks them up: linear between the corners of a grid of ten degrees."""
    lat, lon = np.degrees(place.lat), np.degrees(place.lon)
    south = min(np.floor(lat / _TABLE_STEP), 90.0 / _TABLE_STEP - 1.0) * _TABLE_STEP
    west = np.floor(lon / _TABLE_STEP) * _TABLE_STEP
    up, right = (lat - south) / _TABLE_STEP, (lon - west) / _TABLE_STEP
    total = np.zeros(3)
    for dlat, row in ((0.0, 1.0 - up), (_TABLE_STEP, up)):
        for dlon, column in ((0.0, 1.0 - right), (_TABLE_STEP, right)):
            corner = _elements(south + dlat, np.mod(west + dlon + 180.0, 360.0) - 180.0, 0.0, _TABLE_YEAR)
            total += row * column * corner
    return total
