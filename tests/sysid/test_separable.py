"""Derivatives against differences, for every structure: own and common denominators, delays, integrators, orders."""

from dataclasses import replace

import numpy as np
import pytest

from sysid.transfer_functions.problem import Band, Problem
from sysid.transfer_functions.separable import (
    nonlinear_system,
    sensitivities,
    solve,
)

BASE = Problem(
    inputs=(),
    outputs=(),
    group=(0, 1),
    order=3,
    numerators=3,
    dt=0.1,
    hold="zoh",
    band=Band(1e-3, 30.0),
    ridge=1e-3,
    initial=1e-3,
)
CASES = {
    "own": {},
    "common": {"group": (0, 0)},
    "foh": {"hold": "foh"},
    "integrators": {"integrators": 2},
    "orders": {"orders": (3, 2), "counts": (3, 1)},
    "orders and integrators": {"orders": (3, 2), "counts": (2, 2), "integrators": 1},
    "delays": {"delays": (0.13, 0.52), "longest_delay": 1.0},
    "foh delays": {"delays": (0.13, 0.52), "longest_delay": 1.0, "hold": "foh"},
    "common delays": {"group": (0, 0), "delays": (0.13, 0.52), "longest_delay": 1.0, "counts": (1, 3)},
}


def problem_of(changes, samples=(300, 200)):
    rng = np.random.default_rng(0)
    # Smooth inputs: the response to a delay is differentiable in closed form for held inputs too.
    inputs = tuple(np.cumsum(rng.standard_normal((n, 2)), axis=0) * 0.1 for n in samples)
    outputs = tuple(np.cumsum(rng.standard_normal(n)) * 0.1 for n in samples)
    return replace(BASE, inputs=inputs, outputs=outputs, **changes)


def start_of(problem):
    theta = np.array([[0.3, -0.7, -1.0], [0.9, -0.3, -0.2]])[: problem.groups, : problem.lags].copy()
    for g, order in enumerate(problem.all_orders):
        theta[g, order - problem.integrators :] = 0.0
    return theta


def response(problem, point, theta, delays):
    """Return the model's output at other poles and delays, linear parameters as they are in `point`."""
    moved = solve(problem, theta, delays)
    scale = point.system.unit[list(problem.group)] / moved.system.unit[list(problem.group)]
    orders = np.array(problem.all_orders)
    powers = orders[list(problem.group)] - np.arange(problem.numerators)[:, None]
    numerators = point.numerators * scale**powers
    outputs = []
    first = 1 + problem.integrators
    for z, local in ((there.regressors, here.local) for there, here in zip(moved.parts, point.parts, strict=True)):
        initial = local[first:].reshape(problem.lags, problem.groups)
        lags = orders - problem.integrators
        ratio = (point.system.unit / moved.system.unit) ** (lags - 1 - np.arange(problem.lags)[:, None])
        whole = np.concatenate([local[:first], (initial * ratio).ravel(), numerators.ravel()])
        outputs.append(z[:, :-1] @ whole)
    return np.concatenate(outputs)


@pytest.mark.parametrize("name", CASES)
def test_sensitivities_equal_differences(name):
    """The impulse that starts the initial responses, and the states, are in units of the poles' mean: undone here."""
    problem = problem_of(CASES[name])
    theta, delays = start_of(problem), problem.start_delays
    point = solve(problem, theta)
    jacobian = np.vstack(sensitivities(problem, point))
    step = 1e-6
    for i in range(problem.lags):
        for g in range(problem.groups):
            up, down = theta.copy(), theta.copy()
            up[g, i] += step
            down[g, i] -= step
            if i >= problem.all_orders[g] - problem.integrators:
                assert not jacobian[:, i * problem.groups + g].any()
                continue
            expected = (response(problem, point, up, delays) - response(problem, point, down, delays)) / (2.0 * step)
            np.testing.assert_allclose(
                jacobian[:, i * problem.groups + g], expected, atol=2e-5 * np.abs(expected).max(), err_msg=f"{i} {g}"
            )
    for lane in range(problem.delay_parameters):
        moved = [delays + change * np.eye(2)[lane] for change in (step, -step)]
        expected = response(problem, point, theta, moved[0]) - response(problem, point, theta, moved[1])
        expected *= problem.dt / (2.0 * step)
        column = jacobian[:, problem.lags * problem.groups + lane]
        np.testing.assert_allclose(column, expected, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize("name", CASES)
def test_the_gradient_is_that_of_the_cost_with_its_penalties(name):
    """Initial responses that are dear, so that their price weighs; the ridge too weak to matter."""
    problem = replace(problem_of(CASES[name]), initial=3.0, ridge=1e-9)
    theta, delays = start_of(problem), problem.start_delays
    _, gradient, _ = nonlinear_system(problem, solve(problem, theta))
    step = 1e-5
    for i in range(problem.lags):
        for g in range(problem.groups):
            if i >= problem.all_orders[g] - problem.integrators:
                continue
            up, down = theta.copy(), theta.copy()
            up[g, i] += step
            down[g, i] -= step
            slope = (solve(problem, up, delays).cost - solve(problem, down, delays).cost) / (2.0 * step)
            expected = -0.5 * slope
            assert gradient[i * problem.groups + g] == pytest.approx(
                expected, rel=1e-3, abs=1e-4 * np.abs(gradient).max()
            )
