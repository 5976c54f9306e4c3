"""Transfer functions: the gradient of the cost against differences, poles without a start."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from sysid import Experiment
from sysid.transfer_functions.problem import Band, FitProblem, denominators, from_poles, resolvable_band
from sysid.transfer_functions.response import INITIAL_SECONDS
from sysid.transfer_functions.separable import descend, nonlinear_system, solve
from sysid.transfer_functions.starts import refine, srivc
from sysid.transfer_functions.transfer_function import TransferFunction, run_freely
from tests.sysid.rao_garnier import STEP, rao_garnier

BASE = FitProblem(
    inputs=(),
    outputs=(),
    group=(0, 1),
    orders=(3, 3),
    counts=(3, 3),
    dt=0.1,
    hold="zoh",
    band=Band(1e-3, 30.0),
    ridge=1e-3,
    initial=1e-3,
)
CASES = {
    "own": {},
    "common": {"group": (0, 0), "orders": (3,)},
    "orders and integrators": {"orders": (3, 2), "counts": (2, 2), "integrators": 1},
    "foh delays": {"delays": (0.13, 0.52), "longest_delay": 1.0, "hold": "foh"},
    "common delays": {"group": (0, 0), "orders": (3,), "delays": (0.13, 0.52), "longest_delay": 1.0, "counts": (1, 3)},
}


def problem_of(changes, samples=(300, 200)):
    rng = np.random.default_rng(0)
    # Smooth inputs: the response to a delay is differentiable in closed form for held inputs too.
    inputs = tuple(np.cumsum(rng.standard_normal((n, 2)), axis=0) * 0.1 for n in samples)
    outputs = tuple(np.cumsum(rng.standard_normal(n)) * 0.1 for n in samples)
    return replace(BASE, inputs=inputs, outputs=outputs, **changes)


def start_of(problem):
    theta = np.array([[0.3, -0.7, -1.0], [0.9, -0.3, -0.2]])[: problem.groups, : problem.lags].copy()
    for g, order in enumerate(problem.lag_orders):
        theta[g, order:] = 0.0
    return theta


@pytest.mark.parametrize("name", CASES)
def test_the_gradient_is_that_of_the_cost_with_its_penalties(name):
    """Initial responses that are dear, so that their price weighs; the ridge too weak to matter."""
    problem = replace(problem_of(CASES[name]), initial=3.0, ridge=1e-9)
    theta, delays = start_of(problem), problem.start_delays
    _, gradient, _ = nonlinear_system(problem, solve(problem, theta))
    step = 1e-5
    for i in range(problem.lags):
        for g in range(problem.groups):
            if i >= problem.lag_orders[g]:
                continue
            up, down = theta.copy(), theta.copy()
            up[g, i] += step
            down[g, i] -= step
            slope = (solve(problem, up, delays).cost - solve(problem, down, delays).cost) / (2.0 * step)
            expected = -0.5 * slope
            assert gradient[i * problem.groups + g] == pytest.approx(
                expected, rel=1e-3, abs=1e-4 * np.abs(gradient).max()
            )


def test_free_run_looks_at_nothing_after_the_first_seconds():
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((200, 1)), rng.standard_normal(200)
    record = Experiment.from_arrays(np.arange(200) * 0.1, u, y, input_trim=np.zeros(1), output_trim=np.zeros(1))
    row, late = {record.input_names[0]: TransferFunction(np.array([1.0]), np.array([1.0, 1.0]))}, record.y.copy()
    late[round(INITIAL_SECONDS / 0.1) + 1 :] += 100.0
    first, second = (
        run_freely(row, data, 0, "zoh", shared=False, rmse=0.1, initial_energy=0.5)
        for data in (record, replace(record, y=late))
    )
    np.testing.assert_array_equal(first, second)


def srivc_problem(u, y, order, numerators, dt):
    duration = len(y) * dt
    inputs = u.reshape(len(y), -1)
    return FitProblem(
        inputs=(np.ascontiguousarray(inputs / u.std()),),
        outputs=(y / y.std(),),
        group=(0,) * inputs.shape[1],
        orders=(order,),
        counts=(numerators,) * inputs.shape[1],
        dt=dt,
        hold="zoh",
        band=resolvable_band(duration, dt),
        ridge=1e-6,
        initial=1.0 / duration,
    )


@pytest.mark.parametrize("bandwidth", [0.5, 10.0, 100.0])
def test_rao_garnier_from_every_bandwidth(bandwidth):
    """Poles of 2 and 20 rad/s, found from filters far below, between and above; a last few steps change nothing."""
    problem = srivc_problem(*rao_garnier(3), 4, 2, STEP)
    start = srivc(problem, bandwidth)
    assert start.settled
    frequencies = np.sort(np.abs(np.roots([1.0, *denominators(start.theta)[0][0, ::-1]])))
    np.testing.assert_allclose(frequencies, [2.0, 2.0, 20.0, 20.0], rtol=0.01)
    assert start.cost < 1.001 * descend(problem, start.theta, 20).point.cost


def test_instruments_take_the_bias_of_least_squares_away():
    """Half as much noise as signal through a filter five times too wide: what each makes of the damping, 0.8."""
    den, dt = [1.0, 0.8, 4.0], 0.1
    rng = np.random.default_rng(0)
    u = rng.standard_normal(4000)
    y = lsim(([4.0], den), u, np.arange(4000) * dt, interp=False)[1]
    problem = srivc_problem(u, y + 0.5 * y.std() * rng.standard_normal(4000), 2, 1, dt)
    filtered = solve(problem, from_poles(np.full(2, -10.0 + 0.0j))[None])
    biased, refined = (np.atleast_2d(refine(problem, filtered, noisy=noisy)) for noisy in (True, False))
    settled = srivc(problem, 10.0).theta
    least_squares, once, last = (denominators(theta)[0][0, 1] for theta in (biased, refined, settled))
    assert abs(least_squares - 0.8) > 1.0
    assert abs(once - 0.8) < 0.5  # unbiased, but through this filter far from efficient
    assert abs(last - 0.8) < 0.05


def test_an_input_that_filters_to_no_number_ends_the_search_at_its_start(monkeypatch):
    """A garbled log left a position target whose regressors were no numbers: the solver ended the stage."""
    rng = np.random.default_rng(0)
    problem = srivc_problem(rng.standard_normal(400), rng.standard_normal(400), 2, 1, 0.1)
    whole = solve(problem, from_poles(np.full(2, -10.0 + 0.0j))[None])
    broken = replace(whole, penalty=np.full((whole.numerators.size,) * 2, np.nan))
    assert refine(problem, broken, noisy=True) is None
    monkeypatch.setitem(srivc.__globals__, "solve", lambda *_: broken)
    start = srivc(problem, 10.0)
    assert (start.settled, start.iterations) == (False, 0)
    assert np.isfinite(start.theta).all()
