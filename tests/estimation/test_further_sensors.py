"""A second GPS receiver and a range finder: what they add when they are there, and that they do no harm."""

import numpy as np
import pytest

from estimation import compare, errors, estimate, nees
from tests.estimation.simulated_flight import Sensors, fly


@pytest.fixture(scope="module")
def flight():
    return fly(8, duration=120.0, sensors=Sensors(second_gps=True, range_finder=0.03))


def without(tables, *, gps=False, ranges=False):
    tables = tables.changed(further={}) if gps else tables
    return tables.changed(rangefinder=None) if ranges else tables


def test_second_receiver_halves_the_noise_of_velocity(flight):
    both = compare(estimate(without(flight.tables, ranges=True)), flight.settled())
    one = compare(estimate(without(flight.tables, gps=True, ranges=True)), flight.settled())
    # sqrt(1/2) of the noise of velocity; the IMU's share stays.
    assert both.horizontal_velocity < 0.9 * one.horizontal_velocity


def test_second_receiver_bridges_an_outage_of_the_first(flight):
    gps = flight.tables.gps
    tables = flight.tables.changed(gps=gps[(gps.index < 50.0) | (gps.index > 80.0)])
    seen = errors(estimate(tables), flight.truth).loc[50.0:80.0]
    blind = errors(estimate(without(tables, gps=True)), flight.truth).loc[50.0:80.0]
    rms = [float(np.sqrt(np.mean(e["v_n"] ** 2 + e["v_e"] ** 2))) for e in (seen, blind)]
    assert rms[0] < 0.06
    assert rms[0] < rms[1]


@pytest.mark.whole
def test_sigmas_stay_honest_with_everything_there():
    """Two receivers whose errors wander alone, ground that is level: the filter expects worse, and little."""
    ratios = []
    for seed in range(60, 66):
        flight = fly(seed, duration=120.0, sensors=Sensors(second_gps=True, range_finder=0.03))
        ratios.append(nees(estimate(flight.tables, rate=10.0), flight.settled()))
    for name, high in (("position", 1.6), ("velocity", 1.3), ("attitude", 1.6)):
        assert 0.4 < np.mean([ratio[name] for ratio in ratios]) < high


def test_range_finder_tells_height_near_the_ground(flight):
    """Height above the ground is known to centimetres where it is in sight, however baro and GPS drift."""
    result = estimate(without(flight.tables, gps=True))
    low = flight.truth[(flight.truth["p_d"] > -9.0) & (flight.truth.index > 1.0)]
    states = result.states.reindex(low.index, method="nearest")
    clearance = -states["p_d"] - states["h_terrain"]
    # The sensor sits 0.1 m above the craft's origin in height.
    assert np.sqrt(np.mean((clearance - (0.1 - low["p_d"])) ** 2)) < 0.06
    assert "h_terrain" not in estimate(without(flight.tables, gps=True, ranges=True)).states


def test_a_roof_under_the_craft_is_not_believed(flight):
    """The range finder sees a roof 3 m high for 5 s: refused, and the height does not follow it."""
    ranges = flight.tables.rangefinder.copy()
    near = ranges[ranges["distance"] < 9.0].index
    start = float(near[near > 20.0][0])
    ranges.loc[start : start + 5.0, "distance"] -= 3.0
    tables = without(flight.tables, gps=True)
    roof = errors(estimate(tables.changed(rangefinder=ranges)), flight.settled())
    level = errors(estimate(tables), flight.settled())
    assert np.abs(roof["p_d"] - level["p_d"]).max() < 0.5
