"""Own denominators without any guess: channels parted by modes that they share, and how records begin."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid import fit_transfer_functions
from sysid.transfer_functions.problem import Band, FitProblem, denominators, resolvable_band
from sysid.transfer_functions.response import discretise
from sysid.transfer_functions.starts import separate
from tests.sysid.table_a1 import NOISE, record

#: Two channels: natural frequency, damping ratio, rate of the real pole.
TRUE = np.log([[0.7, 0.05, 0.4], [1.6, 0.2, 0.3]])


def two_channels(samples=1500, before=0, noise=0.01):
    """Pose the problem of `TRUE` for three records that begin `before` samples after rest."""
    rng = np.random.default_rng(0)
    system = discretise(denominators(TRUE)[0], 0.1, "zoh")
    inputs, outputs = [], []
    for _ in range(3):
        white = rng.standard_normal((samples + before, 2)) @ [[1.0, 0.5], [0.5, 1.0]]
        u = lfilter([0.4], [1.0, -0.9], white, axis=0)
        y = system.forced(u, range(2))[:, 0].sum(axis=1)
        inputs.append(np.ascontiguousarray(u[before:]))
        outputs.append((y + noise * y.std() * rng.standard_normal(len(y)))[before:])
    return FitProblem(
        inputs=tuple(inputs),
        outputs=tuple(y / np.std(outputs) for y in outputs),
        group=(0, 1),
        orders=(3, 3),
        counts=(2, 2),
        dt=0.1,
        hold="zoh",
        band=resolvable_band(0.1 * samples, 0.1),
        ridge=1e-6,
        initial=0.1,
    )


@pytest.mark.parametrize("before", [0, 300])
def test_each_channel_has_its_own_poles(before):
    """At 1 % of noise poles are known to a few per cent, whether records begin at rest or in motion."""
    problem = two_channels(before=before)
    separated = next(separate(problem, Band(0.05, 10.0), np.random.default_rng(0), np.inf))
    np.testing.assert_allclose(separated.theta[:, 0], TRUE[:, 0], atol=0.03)
    np.testing.assert_allclose(separated.theta[:, 1:], TRUE[:, 1:], atol=0.2)
    assert separated.variance == pytest.approx(1e-4, rel=0.15)


@pytest.mark.whole
def test_table_a1_of_the_paper_from_blind_starts():
    """Eight motors with five poles and three zeros each, six records: the noise is left, and a free run is right."""
    records = [record(1, number, "z")[0] for number in range(6)]
    model = fit_transfer_functions(records, time_limit=600.0)
    assert model.reports["z"].rmse == pytest.approx(NOISE, rel=0.02)
    experiment, clean = record(1, 10, "z")
    assert np.sqrt(np.mean((model.simulate(experiment) - clean) ** 2)) < 0.03


@pytest.mark.whole
def test_shared_modes_that_get_stuck_start_from_another_grid() -> None:
    """Table A1, set 8, to y: from the first grid a fifth of a metre was left, and free runs erred by six metres."""
    records = [record(8, number)[0] for number in range(10)]
    model = fit_transfer_functions(records, poles=[[0] * 8, [5] * 8, [0] * 8], time_limit=600.0, seed=8)
    assert model.reports["y"].rmse < 1.02 * NOISE
    fresh, clean = record(8, 10)
    assert np.sqrt(np.mean((model.simulate(fresh) - clean)[:, 1] ** 2)) < 0.03
