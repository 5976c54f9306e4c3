"""ARX models: exact on what they are made for, unbiased within their covariance, stable, and blind to the future."""

import numpy as np
import pytest
from scipy.signal import lfilter

from sysid import Experiment, ExperimentError
from sysid.transfer_functions.arx import fit_arx

A, B = [1.0, -1.5, 0.7], [[0.0, 1.0, 0.5], [0.0, -0.3, 0.2]]


def arx_record(seed, samples=1500, sigma=0.1, level=0.0):
    """Simulate ``A y = B u + e`` with white e, from rest."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, 2))
    drive = sum(lfilter(b, [1.0], u[:, j]) for j, b in enumerate(B))
    y = lfilter([1.0], A, drive + sigma * rng.standard_normal(samples)) + level
    return Experiment.from_arrays(
        np.arange(samples) * 0.1, 1500.0 + u, y, name=f"arx {seed}", input_trim=[1500.0, 1500.0], output_trim=[level]
    )


def test_coefficients_lie_within_their_covariance():
    """The normalised squared error of 6 coefficients over 40 seeds is chi-square with mean 1; bounds at 5 sigma."""
    truth = np.array([-1.5, 0.7, 1.0, 0.5, -0.3, 0.2])
    normalised = []
    for seed in range(40):
        difference = fit_arx([arx_record(seed)], 2, 2).differences["y1"]
        error = np.concatenate([difference.a, difference.b.ravel()]) - truth
        normalised.append(error @ np.linalg.solve(difference.covariance, error) / 6.0)
    assert 0.55 < np.mean(normalised) < 1.45


def test_prediction_errs_as_much_as_theory_says():
    """Over h steps the variance is sigma^2 times the squared sum of the impulse response of 1/A."""
    model = fit_arx([arx_record(seed) for seed in range(4)], 2, 2)
    fresh = arx_record(9, samples=6000)
    impulse = lfilter([1.0], A, np.eye(1, 20)[0])
    for steps in (1, 5, 20):
        error = (fresh.y - model.predict(fresh, 0.1 * steps))[60:]
        expected = 0.1 * np.sqrt(np.sum(impulse[:steps] ** 2))
        assert np.sqrt(np.mean(error**2)) == pytest.approx(expected, rel=0.08)


def test_an_unstable_estimate_is_made_stable_and_said():
    rng = np.random.default_rng(0)
    growing = np.exp(0.02 * np.arange(300)) + 0.01 * rng.standard_normal(300)
    record = Experiment.from_arrays(np.arange(300) * 0.1, rng.standard_normal((300, 1)), growing)
    model = fit_arx([record], 2, 2)
    assert "fit-not-converged" in {finding.id for finding in model.findings}
    assert np.all(np.abs(np.roots([1.0, *model.differences["y1"].a])) < 1.0)
    assert np.isfinite(model.simulate(record)).all()


def test_bad_input():
    record = arx_record(1, samples=20)
    with pytest.raises(ExperimentError, match="equations for"):
        fit_arx([record], 8, 8)
    still = Experiment.from_arrays(record.t, np.full(20, 3.0), record.y)
    with pytest.raises(ExperimentError, match="every input is constant"):
        fit_arx([still], 1, 1)
    model = fit_arx([arx_record(2)], 2, 2)
    slower = Experiment.from_arrays(record.t * 2.0, record.u, record.y)
    with pytest.raises(ExperimentError, match="resample"):
        model.simulate(slower)
    twins = Experiment.from_arrays(
        np.arange(200) * 0.1, np.repeat(arx_record(4, 200).u[:, :1], 2, axis=1), np.ones(200)
    )
    # What the data do not determine has an infinite variance.
    assert np.isinf(fit_arx([twins], 2, 2).differences["y1"].covariance).any()
