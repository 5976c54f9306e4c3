"""Values of several flights with their standard errors together: what is common, what differs, what goes with it.

Random-effects meta-regression (Thompson and Sharp 1999; Viechtbauer 2010)::

    y_i = x_i beta + u_i + e_i,     u_i ~ N(0, tau^2) between flights,     e_i ~ N(0, sigma_i^2) as each flight says

tau^2 is Paule and Mandel's (1982; DerSimonian and Kacker 2007): the value at which the weighted sum of squares of the
residuals equals its expectation, or 0 where it is below that even for tau = 0. Beta is judged by Student's t with as
many degrees of freedom as there are values more than coefficients (Knapp and Hartung 2003), whose factor on the
covariance, the same sum of squares over its expectation, is 1 for this tau and not allowed below 1 (Röver, Knapp and
Friede 2015), so that flights which agree by luck do not make every difference significant.

Before and after a change parameters are compared over flights, not over fits: the values of single flights scatter more
than their standard errors say, because wind, battery and temperature differ. The difference of the two means is the
slope of a meta-regression on before/after, corrected for the number of parameters (Holm 1979).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import chdtrc as chi2_sf
from scipy.special import ndtr as normal_cdf
from scipy.special import ndtri, stdtrit
from scipy.special import stdtr as student_cdf

from pipeline.results.drift import Mean, ParameterChange

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]


#: Smallest standard error taken seriously, as a part of the largest value: below it is rounding.
_FINEST = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MetaRegression:
    """What values of several flights say together."""

    beta: Floats  #: shape (q,): One coefficient for each column of the design.
    covariance: Floats  #: shape (q, q)
    tau: float  #: Standard deviation between flights beyond their own standard errors.
    #: Degrees of freedom; 0 where there are as many values as coefficients. Then tau cannot be told and is taken as 0.
    df: int
    q: float  #: Weighted sum of squares of the residuals without any scatter between flights (Cochran's Q).
    weights: Floats  #: shape (n,): Of the values, ``1 / (sigma^2 + tau^2)``.

    @property
    def q_p(self) -> float:
        """Probability of a larger Q if flights differed by their standard errors only; 1 without degrees of freedom."""
        return float(chi2_sf(self.df, self.q)) if self.df else 1.0

    @property
    def i2(self) -> float:
        """Part of the scatter that is not the flights' own errors (Higgins and Thompson 2002), 0 to 1."""
        return max(0.0, 1.0 - self.df / self.q) if self.q > 0.0 else 0.0

    def test(self, contrast: ArrayLike) -> tuple[float, float, float]:
        """Judge a combination of coefficients, shape (q,), against zero: estimate, standard error, two-sided p."""
        weights = np.asarray(contrast, dtype=np.float64)
        estimate = float(weights @ self.beta)
        sigma = float(np.sqrt(max(float(weights @ self.covariance @ weights), 0.0)))
        if sigma == 0.0:
            return estimate, sigma, 1.0 if estimate == 0.0 else 0.0
        ratio = abs(estimate) / sigma
        return estimate, sigma, float(2.0 * (student_cdf(self.df, -ratio) if self.df else normal_cdf(-ratio)))


def meta_regression(values: ArrayLike, sigmas: ArrayLike, design: ArrayLike | None = None) -> MetaRegression:
    """Fit a random-effects meta-regression to values and their standard errors, finite, shape (n,).

    They may depend on the columns of `design`, shape (n, q), on ones (the mean) without it; ValueError where there are
    fewer values than coefficients, or the design does not tell these apart.
    """
    y = np.asarray(values, dtype=np.float64)
    x = np.ones((len(y), 1)) if design is None else np.asarray(design, dtype=np.float64)
    if x.ndim != 2 or len(x) != len(y) or len(y) < x.shape[1] or np.linalg.matrix_rank(x) < x.shape[1]:
        raise ValueError(f"{len(y)} values cannot determine the coefficients of a design of shape {x.shape}")
    variance = np.maximum(np.asarray(sigmas, dtype=np.float64), _FINEST * max(float(np.abs(y).max()), 1e-300)) ** 2
    df = len(y) - x.shape[1]

    def fit(between: float) -> tuple[Floats, Floats, Floats, Floats]:
        weights = 1.0 / (variance + between)
        weighted = x * weights[:, None]
        information = x.T @ weighted
        beta = np.asarray(np.linalg.solve(information, weighted.T @ y), dtype=np.float64)
        return beta, information, weights, weights * (y - x @ beta) ** 2

    beta, information, weights, squares = fit(0.0)
    q, between = float(squares.sum()), 0.0
    # One over the sum of squares is concave in tau^2 and rises: Newton's steps from 0 towards df never pass it.
    # One is enough where all standard errors are alike, a dozen where they differ wildly.
    for _ in range(100 if df else 0):
        total = float(squares.sum())
        if not total > df:
            break
        step = (total / df - 1.0) * total / float(weights @ squares)
        if step <= _FINEST * between:
            break
        between += step
        beta, information, weights, squares = fit(between)
    covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
    return MetaRegression(beta=beta, covariance=covariance, tau=between**0.5, df=df, q=q, weights=weights)


def holm(p: Sequence[float]) -> list[float]:
    """Adjust p values such that the chance of any false alarm among them stays below the level (Holm 1979)."""
    order = sorted(range(len(p)), key=lambda k: p[k])
    adjusted, worst = [0.0] * len(p), 0.0
    for rank, k in enumerate(order):
        worst = max(worst, min(1.0, (len(p) - rank) * p[k]))
        adjusted[k] = worst
    return adjusted


#: Chance of any false alarm among all questions about one craft, or two reports of it.
ALPHA = 0.05


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
    half = _quantile(1.0 - ALPHA / 2.0, fit.df) * sigma
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
    return tuple(replace(row, p_adjusted=p, significant=p < ALPHA) for row, p in pairs)


def _quantile(chance: float, df: int) -> float:
    """Return the value below which an estimate over its standard error is with this chance."""
    return float(stdtrit(df, chance) if df else ndtri(chance))
