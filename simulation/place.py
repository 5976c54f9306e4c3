"""A place on Earth to fly from: its gravity, its air and its magnetic field."""

import datetime as dt
import math
from dataclasses import dataclass

import numpy as np
from pygeomag import GeoMag

from logparse import Geodetic
from simulation.atmosphere import Atmosphere
from simulation.errors import ParameterError


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """Where the craft takes off; the origin of its NED frame lies where the craft's centre of gravity rests."""

    name: str
    #: WGS84, degrees (as maps print them).
    lat_deg: float
    lon_deg: float
    alt: float  #: Metres above mean sea level; geoid undulation is taken as zero.
    warmer: float = 0.0  #: Air temperature above that of the standard atmosphere, K.

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) < 89.0 and abs(self.lon_deg) <= 180.0):
            raise ParameterError(
                f"place {self.name!r}: latitude {self.lat_deg:g}, longitude {self.lon_deg:g} deg is not a place "
                "below 89 deg of latitude"
            )

    @property
    def geodetic(self) -> Geodetic:
        """The same place in radians."""
        return Geodetic(math.radians(self.lat_deg), math.radians(self.lon_deg), self.alt)

    @property
    def atmosphere(self) -> Atmosphere:
        """Air over this place."""
        return Atmosphere.standard(self.alt, warmer=self.warmer)

    @property
    def gravity(self) -> float:
        """Normal gravity [m/s^2] by Somigliana's formula (WGS84) with the free-air gradient."""
        sin2 = math.sin(math.radians(self.lat_deg)) ** 2
        surface = 9.7803253359 * (1.0 + 0.00193185265241 * sin2) / math.sqrt(1.0 - 0.00669437999014 * sin2)
        return surface - 3.086e-6 * self.alt

    def magnetic_field(self, date: dt.datetime) -> np.ndarray:
        """Magnetic field [T] north, east, down by the World Magnetic Model at `date`; shape (3,)."""
        start = dt.datetime(date.year, 1, 1, tzinfo=date.tzinfo)
        year = date.year + (date - start).total_seconds() / (366.0 * 86400.0)
        model = GeoMag(base_year=dt.datetime(date.year, date.month, date.day))
        field = model.calculate(glat=self.lat_deg, glon=self.lon_deg, alt=self.alt / 1000.0, time=year)
        return np.array([field.x, field.y, field.z]) * 1e-9
