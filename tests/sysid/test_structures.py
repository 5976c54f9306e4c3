"""Delays, integrators, and poles and zeros of every channel: known truth, and the fit's own covariance."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter, lsim

from sysid import Experiment, fit_transfer_functions

DT, SAMPLES, FINE = 0.1, 1200, 20


def inputs(rng, channels):
    u = lfilter([1.0], [1.0, -0.8], rng.standard_normal((SAMPLES, channels)), axis=0)
    return u - u.mean(axis=0)


def response(num, den, u, delay=0.0, hold="zoh"):
    """Simulate with SciPy, with a delay on a grid so fine that it is a whole number of steps."""
    if delay == 0.0:
        return lsim((num, den), u, np.arange(len(u)) * DT, interp=hold == "foh")[1]
    steps, t = round(delay * FINE / DT), np.arange(len(u) * FINE) * DT / FINE
    fine = np.repeat(u, FINE) if hold == "zoh" else np.interp(t, np.arange(len(u)) * DT, u)
    fine = np.concatenate([np.full(steps, u[0]), fine])[: len(t)]
    b, a, _ = cont2discrete((num, den), DT / FINE, hold)
    # The discrete form of straight lines takes the input for zero before the record: a step is added separately.
    first = fine[0] if hold == "foh" else 0.0
    result = lfilter(np.ravel(b), a, fine - first)[::FINE]
    return result + first * lsim((num, den), np.ones(len(u)), np.arange(len(u)) * DT)[1]


def record_of(y, u, seed, sigma, **more):
    noise = sigma * np.random.default_rng([5, seed]).standard_normal(len(u))
    return Experiment.from_arrays(
        np.arange(len(u)) * DT, u, y + noise, name=f"record {seed}", input_trim=np.zeros(u.shape[1]), **more
    )


@pytest.mark.parametrize(("hold", "delay"), [("zoh", 0.3), ("zoh", 0.235), ("foh", 0.335)])
def test_given_delays_are_exact(hold, delay):
    """Whole samples and parts of one, for held inputs and straight lines: the truth to rounding."""
    u = inputs(np.random.default_rng(1), 1)
    y = response([2.0, 1.0], [1.0, 1.6, 4.0, 1.2], u[:, 0], delay, hold)
    model = fit_transfer_functions([record_of(y, u, 0, 0.0)], 3, 1, delays=delay, hold=hold, ridge=0.0)
    function = model.transfer_functions["y1"]["u1"]
    np.testing.assert_allclose(function.den, [1.0, 1.6, 4.0, 1.2], rtol=1e-4)
    assert function.delay == delay
    assert model.reports["y1"].rmse < 1e-4


def test_estimated_delays_scatter_as_their_covariance_says():
    """Two inputs, 8 seeds, delays of 2.35 and 0.5 samples: 16 normalised squares have mean 1 (bounds at 3 sigma)."""
    normalised = []
    for seed in range(8):
        u = inputs(np.random.default_rng([2, seed]), 2)
        y = response([2.0, 1.0], [1.0, 1.6, 4.0, 1.2], u[:, 0], 0.235) + response([1.0], [1.0, 1.2, 3.0], u[:, 1], 0.05)
        record = record_of(y, u, seed, 0.02)
        model = fit_transfer_functions([record], [3, 2], [1, 0], delays=None, seed=seed)
        row = model.transfer_functions["y1"]
        for name, truth in (("u1", 0.235), ("u2", 0.05)):
            assert 0.0 < row[name].delay_std < 0.01
            normalised.append(((row[name].delay - truth) / row[name].delay_std) ** 2)
    assert 0.3 < np.mean(normalised) < 2.0


def test_a_double_integrator_is_kept():
    """Thrust to height: gain and lag within their deviations, poles at zero exactly, whatever speed it starts with."""
    normalised = []
    for seed in range(16):
        u = inputs(np.random.default_rng([33, seed]), 1)
        y = response([1.5], [1.0, 2.0, 0.0, 0.0], u[:, 0]) + 3.0 + 0.4 * np.arange(SAMPLES) * DT
        model = fit_transfer_functions([record_of(y, u, seed, 0.05)], 3, 0, integrators=2)
        function = model.transfer_functions["y1"]["u1"]
        np.testing.assert_array_equal(function.den[2:], 0.0)
        assert np.isinf(function.gain)
        assert function.determined.all()
        error = np.array([function.num[0] - 1.5, function.den[1] - 2.0])
        normalised.append(error @ np.linalg.solve(function.covariance[:2, :2], error) / 2.0)
    assert 0.3 < np.mean(normalised) < 2.2


def test_every_channel_has_its_own_order_and_may_have_none():
    """Given by output and input; an input of order 0 has no effect, and its transfer function says so."""
    u = inputs(np.random.default_rng(5), 3)
    truth = {"x": ([2.0, 1.0], [1.0, 1.6, 4.0, 1.2]), "z": ([1.0], [1.0, 1.2])}
    y = np.column_stack(
        [response(*truth["x"], u[:, 0]) + response([1.0], [1.0, 0.7, 2.0], u[:, 1]), response(*truth["z"], u[:, 2])]
    )
    record = Experiment.from_arrays(np.arange(SAMPLES) * DT, u, y, output_names=("x", "z"), input_trim=np.zeros(3))
    model = fit_transfer_functions([record], [[3, 2, 0], [0, 0, 1]], [[1, 0, 0], [0, 0, 0]], ridge=0.0)
    functions = model.transfer_functions
    np.testing.assert_allclose(functions["x"]["u1"].den, truth["x"][1], rtol=1e-3)
    np.testing.assert_allclose(functions["x"]["u2"].den, [1.0, 0.7, 2.0], rtol=1e-3)
    np.testing.assert_allclose(functions["z"]["u3"].den, truth["z"][1], rtol=1e-3)
    assert len(functions["x"]["u1"].num) == 2
    assert functions["x"]["u3"].gain == functions["z"]["u1"].gain == 0.0
    assert model.reports["x"].parameters == 8
    assert np.abs(model.simulate(record) - y)[40:].max() < 0.01


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"poles": [2, 2, 2]}, "one for each of the 2 inputs"),
        ({"poles": [2, 1], "zeros": [1, 1]}, "fewer than poles, not 1 for 1 poles"),
        ({"poles": 2, "zeros": 0, "integrators": 3}, "no more than poles"),
        ({"poles": [3, 2], "zeros": 0, "structure": "common"}, "one number of poles"),
        ({"poles": 2, "zeros": 0, "delays": -0.1}, "delays must be at least 0"),
        ({"poles": 2, "zeros": 0, "delays": None, "longest_delay": 1e3}, "longest_delay"),
        ({"poles": 0, "zeros": 0}, "at least 1"),
    ],
)
def test_structures_that_make_no_sense_are_refused(arguments, message):
    u = inputs(np.random.default_rng(9), 2)
    with pytest.raises(ValueError, match=message):
        fit_transfer_functions([record_of(u[:, 0], u, 0, 0.1)], **arguments)
