"""Denominators from logarithmic sections: always stable, and differentiable."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.transfer_functions.problem import Band, clip, denominators

BAND = Band(1e-3, 30.0)


# No deadline: the first example may compile the kernel.
@settings(deadline=None)
@given(st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=7))
def test_every_parameter_gives_a_stable_denominator(values):
    theta = clip(np.array([values]), BAND)
    a, _ = denominators(theta)
    poles = np.roots(np.concatenate([[1.0], a[0, ::-1]]))
    assert np.all(a > 0.0)
    # Rounding of clustered roots: relative to their size.
    assert np.all(poles.real < 1e-3 * np.abs(poles))


@pytest.mark.parametrize("order", [1, 2, 3, 5, 6])
def test_slopes_equal_differences(order):
    rng = np.random.default_rng(order)
    theta = rng.uniform(-1.0, 0.5, (3, order))
    _, slope = denominators(theta)
    for i in range(order):
        up, down = theta.copy(), theta.copy()
        up[:, i] += 1e-6
        down[:, i] -= 1e-6
        expected = (denominators(up)[0] - denominators(down)[0]) / 2e-6
        np.testing.assert_allclose(slope[:, :, i], expected, atol=1e-7)
