"""Where GPS stays away errors grow faster than the model of the sensors says, by as much as the flight has shown."""

from dataclasses import replace

import numpy as np

from estimation import estimate, nees
from estimation.timing import ACCEL
from tests.estimation.simulated_flight import fly


def test_a_craft_whose_accelerometer_errs_as_it_flies_is_as_unknown_as_it_is_without_gps():
    """What vibration rectifies goes with the throttle: no bias that walks foretells it."""
    flight = fly(42, duration=150.0)
    t = flight.tables.imu.index.to_numpy()[:, None]
    shaken, gps = flight.tables.imu.copy(), flight.tables.gps
    shaken[ACCEL] += 0.5 * np.sin(2.0 * np.pi * t / 25.0 + 6.0 * np.random.default_rng(42).random(3)) * (t > 8.0)
    lost = estimate(replace(flight.tables, imu=shaken, gps=gps[gps.index < 90.0]), rate=10.0)
    assert nees(lost, flight.truth.loc[91.0:])["velocity"] < 3.0  # 10 before
    (finding,) = [f for f in lost.findings if f.id == "position-unknown"]
    assert (finding.severity, "to the end" in finding.reason) == ("error", True)
    assert finding.evidence["position_sigma_m"] > 50.0
