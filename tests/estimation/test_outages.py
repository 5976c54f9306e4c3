"""Where GPS stays away errors grow faster than the model of the sensors says, by as much as the flight has shown."""

from dataclasses import replace

import numpy as np
import pytest

from estimation import _kernels, estimate, nees
from estimation.faults.outages import CLASS_EXCESS, excess, outages, widen
from estimation.observations import Observations
from estimation.timing import ACCEL
from tests.estimation.simulated_flight import fly


def receiver(start, stop):
    """Make fixes of velocity at 5 Hz."""
    t = np.arange(start, stop, 0.2)
    return Observations.merge([(_kernels.GPS_VELOCITY, t, np.zeros((len(t), 3)), np.ones((len(t), 3)))])


def test_an_outage_is_where_no_fix_was_believed():
    fixes = receiver(0.0, 60.0)
    refused = replace(fixes, admitted=(fixes.t < 20.0) | (fixes.t > 29.9))
    assert np.array(outages(refused, 0.0, 100.0)) == pytest.approx(np.array([[19.8, 30.0], [59.8, 100.0]]))
    assert outages(fixes, 0.0, 62.0) == []
    assert outages(receiver(0.0, 0.0), 0.0, 100.0) == []


@pytest.mark.parametrize(
    ("length", "shown", "expected"),
    [(560.0, 9.0, 9.0), (560.0, 0.5, 1.0), (4.0, 9.0, CLASS_EXCESS)],
    ids=["a long flight that drifts", "a long flight that does not", "too short to tell"],
)
def test_a_flight_shows_how_fast_it_drifts(length, shown, expected):
    """Only what was held back for a while counts: what was given is as near as it should be."""

    def surprises(observations):
        return np.repeat(np.where(observations.admitted, 0.0, shown), np.diff(observations.start))

    found = excess(surprises, receiver(0.0, length), 0.0)
    assert found == pytest.approx(expected, rel=0.1)


def test_only_what_an_outage_adds_is_widened():
    t = np.arange(0.0, 10.0)
    variance = 1.0 + np.maximum(t - 4.0, 0.0)
    covariance = np.broadcast_to(variance[:, None, None, None] * np.eye(3), (10, 3, 3, 3)).copy()
    widen(covariance, t, [(4.5, 20.0)], np.array([3.0, 3.0, 1.0]))
    expected = np.where(t > 4.5, 1.0 + 3.0 * (t - 4.0), variance)
    assert covariance[:, 1, 0, 0] == pytest.approx(expected)
    assert covariance[:, 1, 2, 2] == pytest.approx(variance)
    assert covariance[:, 2, 2, 2] == pytest.approx(expected)


@pytest.mark.parametrize("seed", [42, 43])
def test_a_craft_whose_accelerometer_errs_as_it_flies_is_as_unknown_as_it_is_without_gps(seed):
    """What vibration rectifies goes with the throttle: no bias that walks foretells it."""
    flight = fly(seed, duration=150.0)
    t = flight.tables.imu.index.to_numpy()[:, None]
    shaken, gps = flight.tables.imu.copy(), flight.tables.gps
    shaken[ACCEL] += 0.5 * np.sin(2.0 * np.pi * t / 25.0 + 6.0 * np.random.default_rng(seed).random(3)) * (t > 8.0)
    lost = estimate(replace(flight.tables, imu=shaken, gps=gps[gps.index < 90.0]), rate=10.0)
    assert nees(lost, flight.truth.loc[91.0:])["velocity"] < 3.0  # 10 and 4 before
    (finding,) = [f for f in lost.findings if f.id == "gps-outage"]
    assert (finding.severity, "to the end" in finding.reason) == ("error", True)
    assert finding.evidence["position_sigma_m"] > 50.0
