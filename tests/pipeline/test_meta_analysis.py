"""Values of several flights taken together: closed forms, textbook properties, rates of false alarms."""

import numpy as np
import pytest
from scipy import stats

from pipeline.fleet.meta_analysis import holm, meta_regression


def test_equal_errors_give_the_ordinary_mean_and_its_t_test():
    """With scatter beyond equal standard errors the model is that of Student's t-test."""
    values = np.array([4.1, 4.9, 5.2, 3.6, 4.7, 5.0])
    found = meta_regression(values, np.full(6, 0.1))
    assert found.beta[0] == pytest.approx(values.mean())
    assert found.covariance[0, 0] == pytest.approx(values.var(ddof=1) / 6)
    assert found.tau**2 == pytest.approx(values.var(ddof=1) - 0.1**2)
    ordinary = stats.ttest_1samp(values, 4.0)
    _, sigma, _ = found.test([1.0])
    assert (found.beta[0] - 4.0) / sigma == pytest.approx(ordinary.statistic)


def test_a_binary_moderator_is_the_two_sample_t_test():
    a, b = np.array([1.0, 1.3, 0.9, 1.2]), np.array([1.6, 1.4, 1.9])
    design = np.column_stack([np.ones(7), np.repeat([0.0, 1.0], [4, 3])])
    estimate, sigma, p = meta_regression(np.concatenate([a, b]), np.full(7, 0.01), design).test([0.0, 1.0])
    ordinary = stats.ttest_ind(b, a)
    assert estimate == pytest.approx(b.mean() - a.mean())
    assert estimate / sigma == pytest.approx(ordinary.statistic)
    assert p == pytest.approx(ordinary.pvalue)


def test_without_scatter_between_flights_weights_are_those_of_their_errors():
    values, sigmas = np.array([1.00, 1.01, 0.98]), np.array([0.1, 0.2, 0.3])
    found = meta_regression(values, sigmas)
    weights = 1.0 / sigmas**2
    assert found.tau == 0.0
    assert found.beta[0] == pytest.approx(np.average(values, weights=weights))
    assert found.covariance[0, 0] == pytest.approx(1.0 / weights.sum()), "never smaller than the flights' own errors"


def test_paule_mandel_makes_the_sum_of_squares_what_is_expected():
    random = np.random.default_rng(3)
    sigmas = random.uniform(0.05, 0.4, 12)
    values = 2.0 + 0.5 * random.standard_normal(12) + sigmas * random.standard_normal(12)
    found = meta_regression(values, sigmas)
    assert np.sum((values - found.beta[0]) ** 2 / (sigmas**2 + found.tau**2)) == pytest.approx(11.0)
    assert found.q == pytest.approx(np.sum(((values - np.average(values, weights=sigmas**-2)) / sigmas) ** 2))


def test_a_flight_that_knows_nothing_leaves_the_scatter_of_the_others():
    """Beside errors of 1e-9 and of 1000 the scatter once came out as 297,360."""
    found = meta_regression([1.0, 2.0, 4.0, 3.0], [1e-9, 1e-9, 1e-9, 1000.0])
    residuals = np.array([1.0, 2.0, 4.0, 3.0]) - found.beta[0]
    assert np.sum(residuals**2 * found.weights) == pytest.approx(3.0)
    assert found.tau == pytest.approx(np.sqrt(14.0 / 9.0), rel=1e-4), "the sum of squares of 1, 2 and 4, over 3"


def test_two_flights_and_a_difference_leave_no_degree_of_freedom():
    found = meta_regression([1.0, 1.3], [0.1, 0.1], [[1.0, 0.0], [1.0, 1.0]])
    estimate, sigma, p = found.test([0.0, 1.0])
    assert (found.df, found.tau) == (0, 0.0)
    assert (estimate, sigma) == pytest.approx((0.3, 0.1 * 2**0.5))
    assert p == pytest.approx(2.0 * stats.norm.sf(0.3 / 0.1 / 2**0.5))


def test_what_cannot_be_told_apart_is_refused():
    with pytest.raises(ValueError, match="2 values"):
        meta_regression([1.0, 2.0], [0.1, 0.1], [[1.0, 1.0], [1.0, 1.0]])


def test_false_alarms_of_a_trend_keep_to_their_rate():
    """400 series without a trend, 5 to 12 flights, scatter between them of 0 to 3 times their errors."""
    random = np.random.default_rng(20261121)
    alarms = 0
    for _ in range(400):
        n = int(random.integers(5, 13))
        sigmas = random.uniform(0.5, 2.0, n)
        values = random.uniform(0.0, 3.0) * random.standard_normal(n) + sigmas * random.standard_normal(n)
        design = np.column_stack([np.ones(n), np.arange(n)])
        alarms += meta_regression(values, sigmas, design).test([0.0, 1.0])[2] < 0.05
    # 400 at 5 %: 20, and at most 33 with a probability of 99.8 %.
    assert alarms <= 33


def test_holm_is_the_textbook_procedure():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []
