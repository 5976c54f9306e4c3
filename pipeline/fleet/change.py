"""A parameter over the flights before a change and after it: what differs by more than flights differ anyway.

Parameters are compared over flights, not over fits: the values of single flights scatter more than their standard
errors say, because wind, battery and temperature differ. The difference of the two means is the slope of a
random-effects meta-regression on before/after (Knapp and Hartung 2003), corrected for the number of parameters
(Holm 1979).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import ndtri, stdtrit

from pipeline.fleet.meta_analysis import holm, meta_regression
from pipeline.results.drift import Mean, ParameterChange

#: Chance of calling any parameter changed when none did.
SIGNIFICANCE = 0.05


def difference(
    parameter: str, method: str, unit: str, a: Sequence[tuple[float, float]], b: Sequence[tuple[float, float]]
) -> ParameterChange:
    """Compare the means of a parameter over the flights of both sides, given values and standard errors."""
    values, sigmas = np.array([*a, *b]).T
    after = np.repeat([0.0, 1.0], [len(a), len(b)])
    fit = meta_regression(values, sigmas, np.column_stack([1.0 - after, after]))
    change, sigma, p = fit.test([-1.0, 1.0])
    before, before_sigma = float(fit.beta[0]), math.sqrt(fit.covariance[0, 0])
    # Percent of what may be zero mean nothing.
    # Standard errors that a value must differ from zero by for a change of it to be told in percent.
    percent = 100.0 / before if abs(before) > 3.0 * before_sigma else None
    half = _quantile(1.0 - SIGNIFICANCE / 2.0, fit.df) * sigma
    return ParameterChange(
        parameter=parameter,
        method=method,
        unit=unit,
        a=Mean(value=before, sigma=before_sigma, flights=len(a)),
        b=Mean(value=float(fit.beta[1]), sigma=math.sqrt(fit.covariance[1, 1]), flights=len(b)),
        between_flights=fit.tau if fit.df else None,
        difference=change,
        difference_sigma=sigma,
        difference_percent=None if percent is None else percent * change,
        interval_percent=None if percent is None else (percent * (change - half), percent * (change + half)),
        # That of a true change that is found four times out of five.
        detectable_percent=None if percent is None else abs(percent) * (half + _quantile(0.8, fit.df) * sigma),
        p=p,
    )


def corrected(rows: Sequence[ParameterChange]) -> tuple[ParameterChange, ...]:
    """Correct all probabilities together, and judge by them."""
    adjusted = holm([row.p for row in rows])
    pairs = zip(rows, adjusted, strict=True)
    return tuple(replace(row, p_adjusted=p, significant=p < SIGNIFICANCE) for row, p in pairs)


def _quantile(chance: float, df: int) -> float:
    """Return the value below which an estimate over its standard error is with this chance."""
    return float(stdtrit(df, chance) if df else ndtri(chance))
