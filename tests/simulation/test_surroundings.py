"""Air, gravity, magnetic field and wind against published numbers."""

import datetime as dt
import math

import numpy as np
import pytest

from simulation.atmosphere import Atmosphere
from simulation.place import Place, Wind


@pytest.mark.parametrize(
    ("altitude", "temperature", "pressure", "density"),
    # ISO 2533 / US Standard Atmosphere 1976, geopotential altitude.
    [(0, 288.15, 101325.0, 1.2250), (1000, 281.65, 89874.6, 1.11164), (5000, 255.65, 54019.9, 0.736116)],
)
def test_standard_atmosphere(altitude, temperature, pressure, density):
    for air, height in ((Atmosphere.standard(altitude), 0.0), (Atmosphere.standard(0.0), altitude)):
        assert air.temperature_at(height) == pytest.approx(temperature, rel=1e-6)
        assert air.pressure_at(height) == pytest.approx(pressure, rel=1e-5)
        assert air.density_at(height) == pytest.approx(density, rel=1e-5)


@pytest.mark.parametrize(("lat", "gravity"), [(0.0, 9.780325), (45.0, 9.806198), (80.0, 9.830617)])
def test_gravity_is_that_of_the_ellipsoid(lat, gravity):
    assert Place(name="x", lat_deg=lat, lon_deg=0.0, alt=0.0).gravity == pytest.approx(gravity, abs=5e-6)


def test_magnetic_field_of_zurich():
    """About 48.4 uT, dip 63.6 deg, declination 3.6 deg east in 2025 by the World Magnetic Model."""
    field = Place(name="Zurich", lat_deg=47.4, lon_deg=8.55, alt=488.0).magnetic_field(
        dt.datetime(2025, 3, 1, tzinfo=dt.UTC)
    )
    assert np.linalg.norm(field) == pytest.approx(48.4e-6, rel=0.01)
    assert math.degrees(math.atan2(field[1], field[0])) == pytest.approx(3.6, abs=0.4)
    assert math.degrees(math.atan2(field[2], np.hypot(field[0], field[1]))) == pytest.approx(63.6, abs=0.7)


def test_gusts_have_the_dryden_intensity_and_memory():
    """Long record: variance and, for the along-wind component, a correlation of 1/e after one time scale."""
    wind = Wind(speed=4.0, from_deg=180.0, height=20.0)
    sigma, length = wind.scales()
    dt = 0.05
    gusts = wind.sample(1_000_000, dt, np.random.RandomState(1)) - wind.mean
    # 50 000 s hold about 3000 independent spans of L/V = 15 s: standard deviations come out to 2 %.
    assert gusts.std(axis=0) == pytest.approx(sigma, rel=0.06)
    lag = round(length[0] / 4.0 / dt)
    along = gusts[:, 0]
    assert np.mean(along[lag:] * along[:-lag]) / along.var() == pytest.approx(math.exp(-1.0), abs=0.06)
