"""Acceptance: accuracy and honesty on simulated flights, pooled over seeds that nothing was tuned on."""

from dataclasses import astuple

import numpy as np
import pytest

from estimation import compare, estimate, nees
from tests.estimation.simulated_flight import fly

pytestmark = pytest.mark.slow

#: Of NEES per degree of freedom. Over twelve flights means are 0.89 +- 0.19, 0.87 +- 0.02 and 0.83 +- 0.05: the error
#: of GPS positions is a few throws of the dice per flight.
RANGES = {"position": (0.4, 1.5), "velocity": (0.8, 1.05), "attitude": (0.65, 1.05)}


def test_errors_are_small_and_as_large_as_the_covariance_says():
    squares, honesty = [], []
    for seed in range(300, 312):
        flight = fly(seed, duration=200.0)
        truth = flight.settled().iloc[::5]
        trajectory = estimate(flight.tables, rate=10.0)
        squares.append(np.square(astuple(compare(trajectory, truth))))
        honesty.append(nees(trajectory, truth))
    _, _, horizontal_velocity, vertical_velocity, tilt, yaw = np.sqrt(np.mean(squares, axis=0))
    assert horizontal_velocity < 0.045
    assert vertical_velocity < 0.022
    assert np.degrees(tilt) < 0.085
    # Half of the yaw is what GPS leaves open of the declination, the same all through a flight (docs/estimation.md).
    assert np.degrees(yaw) < 0.14
    for group, (least, most) in RANGES.items():
        assert least < np.mean([ratios[group] for ratios in honesty]) < most, group
