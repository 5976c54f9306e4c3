"""Heights that swing, sink or wash, and errors where GPS stays away."""

import numpy as np
import pytest

from estimation import compare, estimate, nees
from estimation.timing import ACCEL
from tests.estimation.simulated_flight import Sensors, fly


@pytest.fixture(scope="module")
def flight():
    return fly(21, duration=180.0, sensors=Sensors(baro_wander=0.4))


def swinging(flight, metres):
    gps = flight.tables.gps
    return flight.tables.changed(gps=gps.assign(alt=gps["alt"] + metres * np.sin(2.0 * np.pi * gps.index / 70.0)))


def test_heights_that_swing_cost_neither_place_nor_height(flight):
    clean = compare(estimate(flight.tables, rate=10.0), flight.settled())
    result = estimate(swinging(flight, 8.0), rate=10.0)
    swung = compare(result, flight.settled())
    assert swung.horizontal_position < 1.05 * clean.horizontal_position
    assert np.ptp(result.states["p_d"] - np.interp(result.states.index, flight.truth.index, flight.truth["p_d"])) < 2.5
    assert [f.evidence["sensor"] for f in result.findings] == ["gps_height"]


def test_a_receiver_that_sinks_for_minutes_takes_no_height_away(flight):
    """At 0.1 m/s, as on 5-12-2014_218: taken for white noise its velocities are 17 m in three minutes."""
    gps = flight.tables.gps
    result = estimate(flight.tables.changed(gps=gps.assign(v_d=gps["v_d"] + 0.1)), rate=10.0)
    assert compare(result, flight.settled()).vertical_position < 1.5
    gained = -result.states["p_d"] + np.interp(result.states.index, flight.truth.index, flight.truth["p_d"])
    assert np.ptp(gained[result.states.index > 15.0]) < 1.5


def test_a_craft_whose_accelerometer_errs_as_it_flies_is_as_unknown_as_it_is_without_gps():
    """What vibration rectifies goes with the throttle: no bias that walks foretells it."""
    flight = fly(42, duration=150.0)
    t = flight.tables.imu.index.to_numpy()[:, None]
    shaken, gps = flight.tables.imu.copy(), flight.tables.gps
    shaken[ACCEL] += 0.5 * np.sin(2.0 * np.pi * t / 25.0 + 6.0 * np.random.default_rng(42).random(3)) * (t > 8.0)
    lost = estimate(flight.tables.changed(imu=shaken, gps=gps[gps.index < 90.0]), rate=10.0)
    assert nees(lost, flight.truth.loc[91.0:])["velocity"] < 3.0  # 10 before
    (finding,) = [f for f in lost.findings if f.id == "position-unknown"]
    assert (finding.severity, "to the end" in finding.reason) == ("error", True)
    assert finding.evidence["position_sigma_m"] > 50.0
