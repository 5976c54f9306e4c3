"""Poles without a start: from any bandwidth, without the bias of least squares, for systems drawn at random."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, max_len_seq

from sysid.transfer_functions.problem import Problem, denominators, from_poles, resolvable_band
from sysid.transfer_functions.separable import descend, solve
from sysid.transfer_functions.starts import refine, srivc

#: Rao and Garnier 2002.
NUM, DEN, STEP, SAMPLES = [-6400.0, 1600.0], [1.0, 5.0, 408.0, 416.0, 1600.0], 0.01, 7161


def rao_garnier(seed, noise=0.1**0.5):
    u = np.repeat(max_len_seq(10)[0] * 2.0 - 1.0, 7)[:SAMPLES]
    y = lsim((NUM, DEN), u, np.arange(SAMPLES) * STEP, interp=False)[1]
    return u, y + noise * y.std() * np.random.default_rng(seed).standard_normal(SAMPLES)


def problem_of(u, y, order, numerators, dt):
    duration = len(y) * dt
    return Problem(
        inputs=(np.ascontiguousarray(u.reshape(len(y), -1) / u.std()),),
        outputs=(y / y.std(),),
        group=(0,) * u.reshape(len(y), -1).shape[1],
        order=order,
        numerators=numerators,
        dt=dt,
        hold="zoh",
        band=resolvable_band(duration, dt),
        ridge=1e-6,
        initial=1.0 / duration,
    )


@pytest.mark.parametrize("bandwidth", [0.5, 2.0, 10.0, 40.0, 100.0])
def test_rao_garnier_from_every_bandwidth(bandwidth):
    """Poles of 2 and 20 rad/s, found from filters far below, between and above; a last few steps change nothing."""
    problem = problem_of(*rao_garnier(3), 4, 2, STEP)
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
    problem = problem_of(u, y + 0.5 * y.std() * rng.standard_normal(4000), 2, 1, dt)
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
    problem = problem_of(rng.standard_normal(400), rng.standard_normal(400), 2, 1, 0.1)
    whole = solve(problem, from_poles(np.full(2, -10.0 + 0.0j))[None])
    broken = replace(whole, penalty=np.full((whole.numerators.size,) * 2, np.nan))
    assert refine(problem, broken, noisy=True) is None
    monkeypatch.setitem(srivc.__globals__, "solve", lambda *_: broken)
    found = srivc(problem, 10.0)
    assert (found.settled, found.iterations) == (False, 0)
    assert np.isfinite(found.theta).all()
