"""The Earth's magnetic field at a place, as the magnetometer's reference."""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime

import numpy as np
from pygeomag import GeoMag

from estimation.local_frame import is_simulated
from logparse import Geodetic

#: First and last decimal year of the field models that pygeomag brings.
_MODEL_YEARS = (2010.0, 2029.9)
#: Year assumed for a log without a date; declination moves by up to 0.2 degrees a year.
_DEFAULT_YEAR = 2020.0


@dataclass(frozen=True, slots=True)
class MagneticField:
    """The field in NED, T, shape (3,), and where its declination came from: ``"WMM"`` or ``"COMPASS_DEC"``."""

    ned: np.ndarray
    declination_source: str


def world_field(place: Geodetic, parameters: Mapping[str, float], date: datetime | None) -> MagneticField:
    """Give the World Magnetic Model's field, with the autopilot's declination where the date is not known.

    A simulated flight takes the autopilot's declination even if dated: its world is made with the autopilot's tables.
    """
    year = _DEFAULT_YEAR
    if date is not None:
        year = date.year + (date.timetuple().tm_yday - 1) / 365.25
    year = min(max(year, _MODEL_YEARS[0]), _MODEL_YEARS[1])
    model = GeoMag(base_year=int(year)).calculate(
        glat=np.degrees(place.lat),
        glon=np.degrees(place.lon),
        alt=place.alt / 1000.0,
        time=year,
        allow_date_outside_lifespan=True,
    )
    declination, source = np.radians(model.d), "WMM"
    logged = parameters.get("COMPASS_DEC", 0.0)
    if logged != 0.0 and (date is None or is_simulated(parameters)):
        declination, source = logged, "COMPASS_DEC"
    ned = 1e-9 * np.array([model.h * np.cos(declination), model.h * np.sin(declination), model.z])
    return MagneticField(ned, source)
