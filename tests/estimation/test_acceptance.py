"""Acceptance: accuracy and honesty on simulated flights of ten minutes, pooled over seeds that nothing was tuned on."""

from dataclasses import astuple

import numpy as np
import pytest

from estimation import compare, estimate, nees
from tests.estimation.simulated_flight import fly

#: The errors of GPS position and of heading are a few throws of the dice per flight, so it takes many flights.
SEEDS = range(300, 320)
SETTLED = 15.0

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def judged():
    """RMS errors in the order of `Comparison`, and mean NEES per degree of freedom by group."""
    squares, honesty = [], []
    for seed in SEEDS:
        flight = fly(seed, duration=600.0)
        truth = flight.truth[flight.truth.index > SETTLED].iloc[::5]
        trajectory = estimate(flight.tables, rate=10.0)
        squares.append(np.square(astuple(compare(trajectory, truth))))
        honesty.append(nees(trajectory, truth))
    rms = np.sqrt(np.mean(squares, axis=0))
    return rms, {name: float(np.mean([n[name] for n in honesty])) for name in honesty[0]}


def test_velocity_and_attitude(judged):
    _, _, horizontal_velocity, vertical_velocity, tilt, yaw = judged[0]
    assert horizontal_velocity < 0.065
    assert vertical_velocity < 0.03
    assert np.degrees(tilt) < 0.085
    # Half of it is what GPS leaves open of the declination, the same all through a flight (docs/estimation.md).
    # Told the true noise the filter reaches 0.105: twenty flights land on either side of it. Since lags are believed in
    # part it is 0.1051 here, 0.1049 before, and 0.1012 on seeds 2000-2029, 0.1016 before.
    assert np.degrees(yaw) < 0.106


@pytest.mark.parametrize("group", ["position", "velocity", "attitude"])
def test_errors_are_as_large_as_the_covariance_says(judged, group):
    assert 0.8 < judged[1][group] < 1.2
