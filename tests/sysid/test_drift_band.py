"""How far a free run may drift: closed forms, and coverage of flights of known truth."""

from dataclasses import replace

import numpy as np
import pytest

from core.serialization import plain
from simulation.elhesasy2024 import octocopter
from simulation.place import Wind
from sysid import validate
from sysid.rigid_body.body_motion import SHARED
from sysid.rigid_body.carried import FIXED, STATES, Wander, drift_sigma
from tests.sysid.craft_flights import RATE, fitted, flown, level, parameters, record

#: Nothing wanders.
STILL = Wander(0.0, 0.0, 0.0, 0.0)


def test_errors_of_scale_and_wind_drift_as_mechanics_says():
    """An error s of the scale makes g s t^2 / 2; with drag d, an error w of the wind w (t - (1 - exp(-d t)) / d)."""
    flight = level(1501)
    theta = np.concatenate([parameters(lx=0.3, ly=0.3)[:14], np.zeros(2)])
    run = flight.run(theta, np.ones((len(flight.t), 1)), 0)
    t, one = flight.t, np.zeros((STATES + SHARED, STATES + SHARED))
    one[1, 1] = 1e-3**2
    sigma = drift_sigma(flight, run, theta, 0, one, STILL)
    np.testing.assert_allclose(sigma[:, 2], 0.5 * 9.80665 * 1e-3 * t**2, atol=2e-3)
    assert sigma[:, :2].max() == 0.0
    one[1, 1], one[2, 2] = 0.0, 0.5**2
    sigma = drift_sigma(flight, run, theta, 0, one, STILL)
    # Level flight at 10 m: the wind there is that of the reference height.
    profile = (0.5 / 10.0) ** theta[SHARED]
    expected = 0.5 * profile * (t - (1.0 - np.exp(-0.3 * t)) / 0.3)
    np.testing.assert_allclose(sigma[:, 0], expected, rtol=0.01, atol=8e-3)  # straight lines within half a second


def test_wind_above_what_was_looked_at_is_that_of_any_day():
    """An exponent off by 0.15 above 5 m makes the wind at 10 m err by 0.15 ln 2 of itself; below, nothing."""
    flight = level(1501)
    flight = replace(flight, ground=10.0)
    theta = np.concatenate([parameters(lx=0.3, ly=0.3)[:14], [4.0, 0.0]])
    run, none = flight.run(theta, np.ones((len(flight.t), 1)), 0), np.zeros((STATES + SHARED, STATES + SHARED))
    assert drift_sigma(flight, run, theta, 0, none, STILL, 20.0).max() == 0.0
    sigma, t = drift_sigma(flight, run, theta, 0, none, STILL, 5.0), flight.t
    np.testing.assert_allclose(
        sigma[:, 0], 4.0 * 0.15 * np.log(2.0) * (t - (1.0 - np.exp(-0.3 * t)) / 0.3), rtol=0.01, atol=8e-3
    )


def test_white_noise_and_gusts_drift_as_random_walks():
    """White acceleration of density r makes r t^3 / 3; Monte Carlo agrees for gusts that fade."""
    flight = level(1501)
    theta = np.concatenate([parameters(lx=0.3, ly=0.3, n=0.0)[:14], np.zeros(2)])
    run = flight.run(theta, np.ones((len(flight.t), 1)), 0)
    t, none = flight.t, np.zeros((STATES + SHARED, STATES + SHARED))
    sigma = drift_sigma(flight, run, theta, 0, none, replace(STILL, vertical_noise=1e-3))
    np.testing.assert_allclose(sigma[500:, 2], np.sqrt(1e-3 * t[500:] ** 3 / 3.0), rtol=0.005)
    wander = replace(STILL, gust=1.0)
    start = none.copy()
    start[FIXED, FIXED] = 1.0
    sigma = drift_sigma(flight, run, theta, 0, start, wander)
    rng, step, count = np.random.default_rng(1), 0.05, 4000
    decay = np.exp(-step / 20.0)
    gust, velocity, position = rng.standard_normal(count), np.zeros(count), np.zeros(count)
    profile = (0.5 / 10.0) ** theta[SHARED]
    for _ in range(round(t[-1] / step)):
        velocity += step * 0.3 * (profile * gust - velocity)
        position += step * velocity
        gust = decay * gust + np.sqrt(1.0 - decay**2) * rng.standard_normal(count)
    # 4000 runs tell a standard deviation to 1.1 %.
    assert sigma[-1, 0] == pytest.approx(position.std(), rel=0.05)


@pytest.mark.slow
def test_the_band_holds_what_it_says():
    """Nine tenths of the errors of free runs in gusts: 85 to 98 % over five flights, and nothing where it is not free.

    Errors within a flight go together, so that five flights tell the share to a few per cent only.
    """
    model, inside = fitted(), []
    for seed in range(21, 26):
        rng = np.random.default_rng(seed)
        wind = Wind(speed=float(rng.uniform(0.5, 7.0)), from_deg=float(rng.uniform(0.0, 360.0)), gusts=1.0)
        seen = record(
            flown(octocopter(), wind=wind, altitude=float(rng.uniform(0.0, 2500.0)), seed=seed, rate=RATE),
            rng,
            name=f"flight {seed}",
        )
        result = validate(model, [seen], horizons=())
        inside.append(result.inside[seen.name])
        first = round(29.0 / seen.dt)
        assert np.isnan(result.drift[seen.name][:first]).all()
        assert np.isfinite(result.drift[seen.name][round(31.0 / seen.dt) :]).all()
        rows = plain(result.report())["drift"]
        assert [row["output"] for row in rows] == ["x", "y", "z"]
        assert rows[0]["half_width"][0] is None
        assert rows[0]["half_width"][-1] > 0.0
    assert 0.85 < np.mean(inside) < 0.98, np.round(inside, 2)
    short = replace(seen[: round(20.0 / seen.dt)], name="short")  # all of it is looked at, and nothing scored
    assert short.name not in validate(model, [seen, short], horizons=()).inside
