"""Order scans by flight time held back, and ARX models within their covariance."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from core.serialization import as_json, from_json
from sysid import Experiment, ExperimentError, scan_orders
from sysid.transfer_functions.arx import fit_arx
from sysid.validation.order import recommend
from sysid.validation.report import OrderScan
from tests.sysid.simulated import motion, simulated_record

#: Third order, one zero: simulated by SciPy.
TRUE = {"x": (([2.0, 1.0], [1.0, 1.6, 4.0, 1.2]),)}
ORDERS = ((1, 0), (2, 0), (2, 1), (3, 1), (4, 2))


@pytest.fixture(scope="module")
def scan():
    records = [simulated_record(seed, samples=900, systems=TRUE) for seed in range(40, 43)]
    heard = []
    result = scan_orders(records, ORDERS, progress=lambda stage, fraction: heard.append(fraction))
    assert heard == sorted(heard)
    assert heard[-1] == 1.0
    return result


def test_the_true_order_is_recommended_with_its_reason(scan):
    assert scan.recommended == (3, 1)
    assert scan.reason.startswith("3 poles and 1 zero are recommended: the error on the part held back is 0.")
    assert "AIC prefers" in scan.reason
    assert scan.held_out == ("record 42",)


def test_the_table_holds_criteria_in_closed_form(scan):
    assert list(scan.table[["poles", "zeros"]].itertuples(index=False, name=None)) == list(ORDERS)
    row = scan.table.iloc[3]
    assert row["parameters"] == 5
    assert row["aic"] == pytest.approx(1800 * np.log(row["rmse"] ** 2) + 10)
    assert row["bic"] == pytest.approx(1800 * np.log(row["rmse"] ** 2) + 5 * np.log(1800))
    # White residuals: here the criteria know the order, too.
    assert scan.table["bic"].idxmin() == 3
    assert row["rmse_held_out"] == pytest.approx(0.05, rel=0.15)
    assert from_json(as_json(scan), OrderScan) == scan


def test_no_order_is_recommended_for_noise():
    rng = np.random.default_rng(3)
    t = np.arange(700) * 0.1
    record = Experiment.from_arrays(t, motion(rng, 700, 1), rng.standard_normal(700), name="noise")
    scan = scan_orders([record], ((1, 0), (2, 1)))
    assert scan.recommended is None
    assert "the order is not what is wrong" in scan.reason


def table(rows):
    return pd.DataFrame(
        [
            {"poles": p, "zeros": z, "parameters": k, "aic": 0.0, "bic": 0.0, "rmse_held_out": error, "rmse_mean": 1.0}
            for p, z, k, error in rows
        ]
    )


def test_the_simplest_of_equals_is_recommended():
    order, reason = recommend(table([(1, 0, 2, 0.9), (3, 1, 5, 0.205), (5, 3, 9, 0.2)]))
    assert order == (3, 1)
    assert "within 5 % of the least (0.20, 5 poles and 3 zeros, 9 coefficients) with 5 coefficients" in reason


def test_too_little_time_and_too_little_to_hold_back_are_said():
    records = [simulated_record(50, samples=450, systems=TRUE)]
    with pytest.raises(ExperimentError, match="no order could be fitted: the time was up"):
        scan_orders(records, ORDERS, time_limit=0.0)
    with pytest.raises(ExperimentError, match="three flights or more, or 40 s of one"):
        scan_orders([simulated_record(51, samples=200, systems=TRUE)], ORDERS)


def test_orders_that_the_data_cannot_carry_are_named():
    """Of 450 samples 315 are fitted; 20 inputs with 16 coefficients each are more."""
    rng = np.random.default_rng(5)
    u = motion(rng, 450, 20)
    record = Experiment.from_arrays(np.arange(450) * 0.1, u, u @ rng.standard_normal(20), name="many inputs")
    scan = scan_orders([record], ((1, 0), (8, 7)))
    (finding,) = scan.findings
    assert finding.id == "fit-not-converged"
    assert finding.reason.startswith("orders not tried: 8 poles, 7 zeros (315 samples for")
    assert set(scan.table["poles"]) == {1}


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
