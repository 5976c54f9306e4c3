"""Splines against those of scipy, which take long to import."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from core.cubic_spline import cubic_spline


@pytest.mark.parametrize("samples", [2, 3, 4, 5, 400])
def test_it_is_the_spline_of_scipy_within_and_beyond_the_samples(samples: int) -> None:
    rng = np.random.default_rng(samples)
    t = np.cumsum(rng.uniform(0.005, 0.03, samples)) + 100.0
    values = rng.standard_normal((samples, 3))
    at = np.sort(np.concatenate([t, rng.uniform(t[0] - 0.02, t[-1] + 0.02, 300)]))
    expected = CubicSpline(t, values)(at)
    assert cubic_spline(t, values, at) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
