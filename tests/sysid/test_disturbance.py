"""What carries the unexplained part on: exact for what it is made for, and chosen by prediction."""

import numpy as np
from scipy.signal import lfilter

from core.serialization import as_json, from_json
from sysid.transfer_functions.disturbance import carried_on, fit_disturbance, steady_gains
from sysid.transfer_functions.model_record import Disturbance

DT = 0.1


def test_a_steady_drift_is_carried_on():
    """After the filter has settled, a ramp is followed without lag and carried on with the fading slope."""
    residual = 0.2 * np.arange(600) * DT
    predicted = carried_on(steady_gains(0.1), residual, DT, 10)
    reach = 10.0 * (1.0 - np.exp(-1.0 / 10.0))
    np.testing.assert_allclose(predicted[300:], residual[290:-10] + 0.2 * reach, atol=1e-6)


def test_gains_suit_the_residual():
    """White noise is hardly followed, a random walk much more closely."""
    rng = np.random.default_rng(1)
    noise = rng.standard_normal(2000)
    walk = np.cumsum(rng.standard_normal(2000))
    quiet = fit_disturbance([noise], DT)
    assert quiet.alpha < 0.1
    assert np.abs(carried_on(quiet, noise, DT, 10)).max() < 0.3
    assert fit_disturbance([walk], DT).alpha > 0.8


def test_what_returns_to_the_model_is_predicted_as_theory_says():
    """First-order process with a time constant of 2 s: h ahead the best predictor errs by sqrt(1 - exp(-2 h / 2 s))."""
    decay = np.exp(-DT / 2.0)
    driven = lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], np.random.default_rng(2).standard_normal(40000))
    tracker = fit_disturbance([driven[:20000]], DT)
    assert 1.5 < tracker.memory_seconds < 2.7
    fresh = driven[20000:]
    for steps in (1, 10, 50):
        error = np.sqrt(np.mean((fresh - carried_on(tracker, fresh, DT, steps))[steps:] ** 2))
        np.testing.assert_allclose(error, np.sqrt(1.0 - decay ** (2 * steps)), rtol=0.06)


def test_what_wanders_off_is_not_expected_back():
    walk = np.cumsum(np.random.default_rng(3).standard_normal(4000))
    found = fit_disturbance([walk], DT)
    assert found.memory_seconds is None
    assert from_json(as_json(found), Disturbance) == found
