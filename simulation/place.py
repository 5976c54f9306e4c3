"""A place on Earth to fly from: its gravity, its magnetic field and its wind."""

import math
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from pygeomag import GeoMag
from scipy.signal import lfilter

from simulation.atmosphere import Atmosphere
from simulation.errors import ParameterError

_FEET = 0.3048


@dataclass(frozen=True, slots=True, kw_only=True)
class Wind:
    """Mean wind of constant direction, with the turbulence that it carries past the craft."""

    speed: float = 0.0  #: Mean wind speed, m/s.
    from_deg: float = 0.0  #: Direction that the wind comes from, degrees clockwise from north.
    gusts: float = 1.0  #: Factor on the Dryden intensity for this wind speed; 0 is steady wind.
    height: float = 15.0  #: Height above ground for which the spectra are taken, m.

    def __post_init__(self) -> None:
        if not 0.0 <= self.speed <= 40.0:
            raise ParameterError(f"wind speed {self.speed:g} m/s must lie in 0..40 m/s")
        if not 0.0 <= self.gusts <= 5.0:
            raise ParameterError(f"gust factor {self.gusts:g} must lie in 0..5")

    @property
    def mean(self) -> np.ndarray:
        """Mean velocity of the air [m/s] north, east, down; shape (3,)."""
        toward = math.radians(self.from_deg + 180.0)
        return np.array([self.speed * math.cos(toward), self.speed * math.sin(toward), 0.0])

    def scales(self) -> tuple[np.ndarray, np.ndarray]:
        """Return standard deviations [m/s] and lengths [m] of gusts along the wind, across it and down, each (3,)."""
        h = self.height / _FEET
        shape = 0.177 + 0.000823 * h
        sigma_w = 0.1 * self.speed * self.gusts
        sigma_u = sigma_w / shape**0.4
        length_u = h / shape**1.2 * _FEET
        return np.array([sigma_u, sigma_u, sigma_w]), np.array([length_u, length_u, self.height])

    def sample(self, n: int, dt: float, random: np.random.RandomState) -> np.ndarray:
        """Return the velocity of the air at `n` times, NED, m/s, shape (n, 3).

        The gust field is frozen and passes with the mean wind (at least 1 m/s). The component along the wind has the
        first-order Dryden spectrum, the others the second-order one.
        """
        sigma, length = self.scales()
        noise = random.standard_normal((n, 3)) / math.sqrt(dt)
        passage = length / max(self.speed, 1.0)
        along = _first_order(noise[:, 0], sigma[0], passage[0], dt)
        across = _second_order(noise[:, 1], sigma[1], passage[1], dt)
        down = _second_order(noise[:, 2], sigma[2], passage[2], dt)
        toward = math.radians(self.from_deg + 180.0)
        c, s = math.cos(toward), math.sin(toward)
        mean = self.mean
        return np.column_stack((mean[0] + c * along - s * across, mean[1] + s * along + c * across, down))


def _first_order(noise: np.ndarray, sigma: float, T: float, dt: float) -> np.ndarray:
    """Filter unit white noise by ``sigma sqrt(2 T) / (1 + T s)`` (Tustin); variance sigma^2."""
    a = 2.0 * T / dt
    gain = sigma * math.sqrt(2.0 * T) / (1.0 + a)
    filtered: np.ndarray = lfilter([gain, gain], [1.0, (1.0 - a) / (1.0 + a)], noise)
    return filtered


def _second_order(noise: np.ndarray, sigma: float, T: float, dt: float) -> np.ndarray:
    """Filter unit white noise by ``sigma sqrt(T) (1 + sqrt(3) T s) / (1 + T s)^2`` (Tustin); variance sigma^2."""
    a = 2.0 * T / dt
    z = math.sqrt(3.0) * a
    gain = sigma * math.sqrt(T) / (1.0 + a) ** 2
    pole = (1.0 - a) / (1.0 + a)
    numerator = [gain * (1.0 + z), gain * 2.0, gain * (1.0 - z)]
    filtered: np.ndarray = lfilter(numerator, [1.0, 2.0 * pole, pole * pole], noise)
    return filtered


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
    def atmosphere(self) -> Atmosphere:
        """Air over this place."""
        return Atmosphere.standard(self.alt, warmer=self.warmer)

    @property
    def gravity(self) -> float:
        """Normal gravity [m/s^2] by Somigliana's formula (WGS84) with the free-air gradient."""
        sin2 = math.sin(math.radians(self.lat_deg)) ** 2
        surface = 9.7803253359 * (1.0 + 0.00193185265241 * sin2) / math.sqrt(1.0 - 0.00669437999014 * sin2)
        return surface - 3.086e-6 * self.alt

    def magnetic_field(self, date: datetime) -> np.ndarray:
        """Return the magnetic field [T] north, east, down by the World Magnetic Model at `date`; shape (3,)."""
        start = datetime(date.year, 1, 1, tzinfo=date.tzinfo)
        year = date.year + (date - start).total_seconds() / (366.0 * 86400.0)
        model = GeoMag(base_year=datetime(date.year, date.month, date.day))
        field = model.calculate(glat=self.lat_deg, glon=self.lon_deg, alt=self.alt / 1000.0, time=year)
        return np.array([field.x, field.y, field.z]) * 1e-9
