"""Residuals, their covariance and what carries them on; bands and ellipses against repetition."""

import numpy as np
import pytest
from scipy.signal import lfilter

from core.serialization import as_json, from_json
from sysid import TransferFunction, frequency_response, poles, zeros
from sysid.statistics.covariance import coloured_information, lagged_information, wander
from sysid.statistics.residuals import examine_residuals
from sysid.transfer_functions.model_record import NoiseModel
from sysid.transfer_functions.response import carried_on, fit_disturbance, steady_gains


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


def spectrum_of(slope: float, rng: np.random.Generator) -> np.ndarray:
    """Make 240 values whose power goes with frequency to this slope."""
    hz = np.fft.rfftfreq(960)
    hz[0] = 1.0
    return np.fft.irfft(np.fft.rfft(rng.standard_normal(960)) * hz ** (0.5 * slope))[:240]


@pytest.mark.parametrize("slope", [0.0, -1.0, -2.0])
def test_halves_of_what_wanders_differ_by_what_each_states(slope: float) -> None:
    rng = np.random.default_rng(5)
    apart = []
    for _ in range(150):
        one, other = np.split(spectrum_of(slope, rng), 2)
        apart.append((one.mean() - other.mean()) / np.hypot(wander(one), wander(other)))
    assert 0.5 < np.sqrt(np.mean(np.square(apart))) < 1.3
    # What stands still does not wander.
    assert wander(np.zeros(40)) == pytest.approx(0.0, abs=1e-12)


def test_lagged_signals_need_not_stand_beside_each_other() -> None:
    rng = np.random.default_rng(7)
    lags, colour = 6, np.exp(-0.2 * np.arange(24)) * (1.0 - np.arange(24) / 24)
    signals = [np.cumsum(rng.normal(size=size)) for size in (25, 300)]  # the first is shorter than the colour
    beside = [np.column_stack([u[lags - lag : len(u) - lag] for lag in range(1, lags + 1)]) for u in signals]

    information = lagged_information(signals, lags, colour)

    np.testing.assert_allclose(information, coloured_information(beside, colour), rtol=1e-12)


DT = 0.1


def test_a_steady_drift_is_carried_on():
    """After the filter has settled, a ramp is followed without lag and carried on with the fading slope."""
    residual = 0.2 * np.arange(600) * DT
    predicted = carried_on(steady_gains(0.1), residual, DT, 10)
    reach = 10.0 * (1.0 - np.exp(-1.0 / 10.0))
    np.testing.assert_allclose(predicted[300:], residual[290:-10] + 0.2 * reach, atol=1e-6)


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
    disturbance = fit_disturbance([walk], DT)
    assert disturbance.memory_seconds is None
    assert from_json(as_json(disturbance), NoiseModel) == disturbance


OMEGA = np.logspace(-1.5, 1.0, 40)


def scattered(seed=0, runs=4000):
    """Return a transfer function with a covariance, and draws from it."""
    rng = np.random.default_rng(seed)
    num, den = np.array([0.4, 2.0]), np.array([1.0, 1.6, 4.0, 1.2])
    size = 0.01 * np.concatenate([num, den[1:]])
    mix = rng.standard_normal((5, 5)) / np.sqrt(5.0)
    covariance = (mix @ mix.T) * size * size[:, None]
    draws = rng.multivariate_normal(np.concatenate([num, den[1:]]), covariance, runs)
    return TransferFunction(num, den, covariance), draws


def test_the_bands_are_what_draws_scatter():
    function, draws = scattered()
    result = frequency_response(function, OMEGA)
    s = 1j * OMEGA
    g = np.array([np.polyval(d[:2], s) / np.polyval([1.0, *d[2:]], s) for d in draws])
    ratio = np.log(g / result.response)
    assert result.sigma_gain == pytest.approx(ratio.real.std(axis=0), rel=0.06)
    assert result.sigma_phase == pytest.approx(ratio.imag.std(axis=0), rel=0.06)
    assert result.determined.all()
    low, high = result.band(0.95)
    inside = np.mean((np.abs(g) > low) & (np.abs(g) < high), axis=0)
    assert np.all(np.abs(inside - 0.95) < 0.015)


def test_ellipses_hold_the_roots_of_draws():
    function, draws = scattered(1)
    pole = next(root for root in poles(function) if root.value.imag > 0)
    near = np.array([min(np.roots([1.0, *d[2:]]), key=lambda r: abs(r - pole.value)) for d in draws])
    away = np.array([(near - pole.value).real, (near - pole.value).imag])
    distance = np.einsum("ik,ij,jk->k", away, np.linalg.inv(pole.covariance), away)
    assert np.mean(distance < 5.991) == pytest.approx(0.95, abs=0.015)
    line = pole.ellipse(0.95) - pole.value
    border = np.array([line.real, line.imag])
    assert np.einsum("ik,ij,jk->k", border, np.linalg.inv(pole.covariance), border) == pytest.approx(5.991, rel=1e-3)
    (zero,) = zeros(function)
    values = -draws[:, 1] / draws[:, 0]
    assert zero.value.real == pytest.approx(-5.0)
    assert zero.sigma == pytest.approx(values.std(), rel=0.05)
    assert zero.determined
