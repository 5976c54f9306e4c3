"""Residual tests: right models fail as rarely as promised, wrong ones are caught."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid.statistics.residuals import examine_residuals


def inputs(rng, samples=600, count=2):
    return lfilter([1.0], [1.0, -0.8], rng.standard_normal((samples, count)), axis=0)


def rates(error_of, runs=300):
    """Part of the runs in which whiteness and independence are rejected."""
    rejected = np.zeros(2)
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        u = [inputs(rng), inputs(rng)]
        result = examine_residuals("x", [error_of(rng, part) for part in u], u, ["m1", "m2"])
        rejected += [not result.white, bool(result.dependent)]
    return rejected / runs


def test_news_is_rejected_once_in_a_hundred():
    white, independent = rates(lambda rng, u: rng.standard_normal(len(u)))
    # Binomial: of 300 runs at 1 %, more than 9 are rejected with probability 0.1 %.
    assert white <= 9 / 300
    assert independent <= 9 / 300


def test_coloured_errors_are_not_white_but_may_be_independent():
    """The colour of the errors must not be taken for a dependence on inputs that are just as slow."""
    white, independent = rates(lambda rng, u: lfilter([1.0], [1.0, -0.7], rng.standard_normal(len(u))))
    assert white == 1.0
    # The colour is estimated from the same errors, which costs a little of the level.
    assert independent < 0.06


def test_an_input_that_was_forgotten_is_named():
    rng = np.random.default_rng(1)
    u = inputs(rng)
    error = rng.standard_normal(len(u)) + 0.3 * np.roll(u[:, 1], 3)
    result = examine_residuals("x", [error], [u], ["m1", "m2"])
    assert result.dependent == ("m2",)
    assert np.argmax(np.abs(result.crosscorrelation["m2"])) == 2
    assert "inputs before them would improve it (m2)" in result.sentence


def test_feedback_is_no_fault_of_the_model():
    """An autopilot answers to the error after it happened; only inputs before an error can explain it."""
    rng = np.random.default_rng(2)
    error = rng.standard_normal(3000)
    u = lfilter([0.0, 0.5], [1.0, -0.8], error)[:, None] + 0.2 * rng.standard_normal((3000, 1))
    assert not examine_residuals("x", [error], [u], ["m1"]).dependent


def test_statistics_in_closed_form():
    error = np.tile([1.0, -1.0], 100)
    result = examine_residuals("x", [error], [np.zeros((200, 1))], ["m1"])
    lags = np.arange(1, result.lags + 1)
    assert result.autocorrelation == pytest.approx((-1.0) ** lags * (200 - lags) / 200)
    assert result.whiteness == pytest.approx(200 * np.sum(((200 - lags) / 200) ** 2 * 200 / (200 - lags)))
    assert result.band == pytest.approx(2.5758 / np.sqrt(200), rel=1e-4)
    assert result.independence == {}  # the input never moved


def test_nothing_to_test():
    assert examine_residuals("x", [np.ones(6)], [np.ones((6, 1))], ["m1"]) is None
    assert examine_residuals("x", [np.ones(200)], [np.ones((200, 1))], ["m1"]) is None
    assert examine_residuals("x", [], [], ["m1"]) is None
