"""Transfer functions from simulated records: the truth within the model's own uncertainty, and bad input."""

import numpy as np
import pytest

from logparse import RotoridError
from sysid import Experiment, ExperimentError, fit_transfer_functions
from tests.sysid.simulated import TRUE, motion, simulated_record

POLES, ZEROS = 3, 1


def true_parameters(output, name):
    num, den = TRUE[output][int(name[1:]) - 1]
    return np.concatenate([np.array(num) / 50.0, den[1:]])  # inputs are 50 us a unit


@pytest.fixture(scope="module")
def joint():
    """Three records with different offsets, two of them beginning in motion."""
    records = [
        simulated_record(1, offset=3.0),
        simulated_record(2, offset=-40.0, from_rest=False),
        simulated_record(3, samples=900, from_rest=False),
    ]
    return records, fit_transfer_functions(records, POLES, ZEROS)


def test_truth_is_found_within_the_models_own_uncertainty(joint):
    """Normalised squared errors of 20 coefficients have mean 1; above 2 has a chance below 1 %."""
    _, model = joint
    normalised = []
    for output, row in model.transfer_functions.items():
        for name, function in row.items():
            error = np.concatenate([function.num, function.den[1:]]) - true_parameters(output, name)
            normalised.append(error @ np.linalg.solve(function.covariance, error) / len(error))
            # The uncertainty itself is useful: a few per cent of the values.
            assert np.all(function.standard_deviation < 0.25 * np.abs(true_parameters(output, name)))
    assert 0.2 < np.mean(normalised) < 2.0


def test_free_run_on_a_new_record_is_nearly_noise_free(joint):
    """On a record with 0.05 of noise and a spread of about 0.5, the free run errs by a tenth of the noise."""
    _, model = joint
    clean = simulated_record(9, noise=0.0)
    error = model.simulate(clean) - clean.y
    assert np.sqrt(np.mean(error[30:] ** 2)) < 0.01


def test_standard_errors_hold_for_coloured_residuals():
    """Noise through a slow filter: white-noise formulae would claim errors several times too small."""
    from scipy.signal import lfilter

    systems, normalised = {"y": TRUE["y1"][:1]}, []
    for seed in range(30):
        record = simulated_record(100 + seed, samples=1000, noise=0.0, systems=systems)
        noise = lfilter([0.015], [1.0, -0.95], np.random.default_rng(seed).standard_normal((1000, 1)), axis=0)
        record = Experiment.from_arrays(record.t, record.u, record.y + noise, input_trim=[1500.0])
        function = fit_transfer_functions([record], POLES, ZEROS, ridge=0.0).transfer_functions["y1"]["u1"]
        error = np.concatenate([function.num, function.den[1:]]) - true_parameters("y1", "u1")
        normalised.append(error @ np.linalg.solve(function.covariance, error) / 5.0)
    # 30 chi-squares of 5 degrees of freedom: mean 1, deviation 0.12, and the colour itself is estimated.
    assert 0.5 < np.mean(normalised) < 1.8


def test_poles_are_stable_even_for_noise():
    """Nothing to identify: whatever comes out is stable, bounded, and said to be undetermined."""
    rng = np.random.default_rng(0)
    y = np.cumsum(np.cumsum(rng.standard_normal((300, 1)), axis=0), axis=0)
    record = Experiment.from_arrays(np.arange(300) * 0.1, motion(rng, 300, 3), y)
    model = fit_transfer_functions([record], 5, 3)
    for function in model.transfer_functions["y1"].values():
        assert np.all(function.poles.real < 0.0)
    longer = Experiment.from_arrays(np.arange(3000) * 0.1, motion(rng, 3000, 3), np.zeros(3000))
    assert np.all(np.abs(model.simulate(longer)) < 1e3 * np.abs(y).max())
    assert any(f.id == "not-determined" and "are not determined by the data" in f.reason for f in model.findings)


def test_a_constant_input_is_left_out_with_a_finding():
    record = simulated_record(7, samples=500, systems={"y": TRUE["y1"]})
    dead = record.u.copy()
    dead[:, 1] = 1100.0
    made = Experiment.from_arrays(record.t, dead, record.y)
    model = fit_transfer_functions([made], POLES, ZEROS)
    assert model.transfer_functions["y1"]["u2"].gain == 0.0
    finding = next(finding for finding in model.findings if finding.id == "constant-input")
    assert "u2 stays at 1100" in finding.reason
    assert np.isfinite(model.simulate(made)).all()


def test_identical_inputs_share_their_effect_with_a_finding():
    record = simulated_record(8, samples=800, systems={"y": TRUE["y1"][:1]}, noise=0.01)
    twins = Experiment.from_arrays(record.t, np.repeat(record.u, 2, axis=1), record.y, input_trim=[1500.0, 1500.0])
    model = fit_transfer_functions([twins], POLES, ZEROS, structure="common")
    assert "inputs-alike" in {finding.id for finding in model.findings}
    together = sum(function.gain for function in model.transfer_functions["y1"].values())
    assert together == pytest.approx(1.0 / 1.2 / 50.0, rel=0.03)
    assert not any(function.determined[:2].any() for function in model.transfer_functions["y1"].values())


def test_bad_input_is_refused():
    record = simulated_record(10, samples=40)
    with pytest.raises(ExperimentError, match="40 samples for"):
        fit_transfer_functions([record], 8, 7)
    still = Experiment.from_arrays(record.t, np.full(40, 1500.0), record.y)
    with pytest.raises(ExperimentError, match="every input is constant"):
        fit_transfer_functions([still], 2, 1)
    with pytest.raises(RotoridError):
        fit_transfer_functions([record], 2, 1, structure="none")


def test_inputs_that_explain_nothing_are_said_to():
    """A drift fits by slow poles and the initial state to 60 % and more, whatever the inputs.

    By a chance of some percent an input still seems to act: errors of a fit to a growing exponential are no noise.
    """
    said, t = [], 0.1 * np.arange(400)
    for seed in range(2):
        rng = np.random.default_rng([21, seed])
        unrelated = 1500.0 + 50.0 * rng.standard_normal((400, 2))
        for y in (np.exp(0.2 * t), np.cumsum(rng.standard_normal(400))):
            model = fit_transfer_functions([Experiment.from_arrays(t, unrelated, y)], 2, 1)
            found = [f.reason for f in model.findings if f.id == "output-unexplained"]
            said.append(any("no input is seen to act" in reason for reason in found))
    assert sum(said) >= len(said) - 1


def test_a_time_limit_is_kept_and_said():
    record = simulated_record(12)
    model = fit_transfer_functions([record], 5, 3, time_limit=0.01)
    assert "fit-not-converged" in {finding.id for finding in model.findings}
    assert all(np.all(f.poles.real < 0.0) for row in model.transfer_functions.values() for f in row.values())
