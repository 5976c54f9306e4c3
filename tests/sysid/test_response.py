"""Exact discretisation against SciPy, and sensitivities against differences."""

import numpy as np
import pytest
from scipy.signal import lsim

from sysid.transfer_functions.problem import denominators
from sysid.transfer_functions.response import INITIAL_SECONDS, discretise, free_run

POLES = np.array(
    [
        [np.log(0.5), np.log(0.3), np.log(2.0), np.log(0.7), np.log(0.05)],
        [np.log(0.02), np.log(2.0), np.log(9.0), np.log(0.02), np.log(1.0)],
    ]
)


@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("lanes", [2, 8])
def test_states_equal_scipys_simulation(hold, lanes):
    """Every power of s over A, for slow, fast and lightly damped poles, few and many channels."""
    rng = np.random.default_rng(0)
    dt, n = 0.1, POLES.shape[1]
    group = [lane % 2 for lane in range(lanes)]
    u = rng.standard_normal((600, lanes))
    a, _ = denominators(POLES)
    system = discretise(a, dt, hold)
    states = system.forced(u, group)
    t = np.arange(len(u)) * dt
    for lane, g in enumerate(group):
        den = np.concatenate([[1.0], a[g, ::-1]])
        for power in range(n):
            num = np.zeros(power + 1)
            num[0] = system.unit[g] ** (n - power)
            _, expected, _ = lsim((num, den), u[:, lane], t, interp=hold == "foh")
            np.testing.assert_allclose(states[:, power, lane], expected, atol=1e-9 * np.abs(expected).max())


def test_states_over_the_squared_denominator():
    """The sensitivity states are 1/A applied twice in continuous time, not a filtered sample sequence."""
    rng = np.random.default_rng(1)
    a, _ = denominators(POLES[:1])
    system = discretise(a, 0.1, "zoh")
    u = rng.standard_normal((400, 1))
    den = np.concatenate([[1.0], a[0, ::-1]])
    _, expected, _ = lsim(([system.unit[0] ** 10], np.convolve(den, den)), u[:, 0], np.arange(400) * 0.1, interp=False)
    squared = system.forced(u, [0], first=system.forced(u, [0]))
    np.testing.assert_allclose(squared[:, 0, 0], expected, atol=1e-9 * np.abs(expected).max())


def test_free_run_looks_at_nothing_after_the_first_seconds():
    rng = np.random.default_rng(3)
    u, y = rng.standard_normal((200, 1)), rng.standard_normal(200)
    arguments = {"shared": False, "sigma": 0.1, "initial_energy": 0.5}
    first = free_run([np.array([1.0])], [np.array([1.0, 1.0])], u, y, 0.0, 0.1, "zoh", **arguments)
    y[round(INITIAL_SECONDS / 0.1) + 1 :] += 100.0
    second = free_run([np.array([1.0])], [np.array([1.0, 1.0])], u, y, 0.0, 0.1, "zoh", **arguments)
    np.testing.assert_array_equal(first, second)
