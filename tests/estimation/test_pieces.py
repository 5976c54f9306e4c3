"""Long segments are filtered and smoothed in pieces: the pieces must not show."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from estimation import estimate, strapdown
from estimation._splines import along_spline
from tests.estimation.simulated_flight import Sensors, fly


@pytest.mark.parametrize("smooth", [True, False])
def test_pieces_do_not_show(monkeypatch, smooth):
    """Six pieces give what one gives, but for the nodes that their edges add (transitions are of first order)."""
    flight = fly(7, duration=40.0, sensors=Sensors(second_gps=True, range_finder=0.05))
    whole = estimate(flight.tables, rate=10.0, smooth=smooth)
    monkeypatch.setattr(strapdown, "PIECE", 64)
    pieces = estimate(flight.tables, rate=10.0, smooth=smooth)
    assert len(pieces.states) > 5 * 64
    apart = np.abs(pieces.states - whole.states)[whole.sigma.columns.intersection(whole.states.columns)]
    assert (apart / whole.sigma[apart.columns]).to_numpy().max() < 0.01
    np.testing.assert_allclose(pieces.sigma, whole.sigma, rtol=0.01)
    np.testing.assert_allclose(
        pieces.diagnostics["log_likelihood"], whole.diagnostics["log_likelihood"], rtol=0.0, atol=0.5
    )
    found, known = pieces.diagnostics["innovations"], whole.diagnostics["innovations"]
    assert {name: row["count"] for name, row in found.items()} == {name: row["count"] for name, row in known.items()}


def test_spline_is_scipys():
    """Values and integrals of uneven samples, and of a window of them far enough from its ends."""
    rng = np.random.default_rng(0)
    t, y = np.cumsum(rng.uniform(0.001, 0.004, 600)), rng.normal(size=(600, 3))
    at = np.sort(rng.uniform(t[0] - 0.001, t[-1] + 0.001, 900))
    spline = CubicSpline(t, y, bc_type="natural")
    np.testing.assert_allclose(along_spline(t, y, at, False), spline(at), rtol=0.0, atol=1e-12)
    areas = np.diff(spline.antiderivative()(at), axis=0)
    np.testing.assert_allclose(along_spline(t, y, at, True), areas, rtol=0.0, atol=1e-14)
    window, inside = slice(200, 400), at[(at > t[240]) & (at < t[359])]
    np.testing.assert_allclose(along_spline(t[window], y[window], inside, False), spline(inside), rtol=0.0, atol=1e-12)
