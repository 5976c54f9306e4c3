"""What carries the unexplained part on: exact for what it is made for, and chosen by prediction."""

import numpy as np

from sysid.disturbance import FADE, fit_disturbance, steady_gains

DT = 0.1


def test_a_steady_drift_is_carried_on():
    """After the filter has settled, a ramp is followed without lag and carried on with the fading slope."""
    residual = 0.2 * np.arange(600) * DT
    predicted = steady_gains(0.1).predict(residual, DT, 10)
    reach = FADE * (1.0 - np.exp(-1.0 / FADE))
    np.testing.assert_allclose(predicted[300:], residual[290:-10] + 0.2 * reach, atol=1e-6)


def test_nothing_is_predicted_from_the_future():
    residual = np.random.default_rng(0).standard_normal(200)
    changed = residual.copy()
    changed[100:] += 50.0
    tracker = steady_gains(0.3)
    np.testing.assert_array_equal(tracker.predict(residual, DT, 10)[:110], tracker.predict(changed, DT, 10)[:110])


def test_gains_suit_the_residual():
    """White noise is hardly followed, a random walk much more closely."""
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(2000)
    walk = np.cumsum(rng.standard_normal(2000))
    assert fit_disturbance([noise], DT).alpha < 0.1
    assert fit_disturbance([walk], DT).alpha > 0.8
