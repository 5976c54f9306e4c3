"""What a model leaves over, tested for whiteness and for independence of the inputs.

Tested are the errors of the prediction one sample ahead. Those of a free run are no candidates: wind colours them
however right the model is, and the autopilot, which reacts to what the wind did, makes its outputs depend on them.
One sample ahead, an error should be news: unrelated to earlier errors, and to all inputs before it, feedback or not
(Ljung 1999, sections 16.6 and 13.4; Söderström and Stoica 1989, section 11.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtrc as chi2_sf
from scipy.special import chdtri as chi2_isf
from scipy.special import ndtri as normal_ppf

from sysid.records.experiment import Floats
from sysid.statistics.covariance import autocovariance, lagged_information
from sysid.statistics.residual_test import ResidualTest

#: Probability that a right model stays inside the bands and limits.
LEVEL = 0.99


def examine_residuals(
    output: str, errors: Sequence[Floats], inputs: Sequence[Floats], names: Sequence[str]
) -> ResidualTest | None:
    """Test prediction errors of one output; None for too few samples, or errors that are all the same.

    `errors` (N_r,): one-sample-ahead prediction errors, one array per record; `inputs` (N_r, m): at the same samples.
    """
    longest = max((len(error) for error in errors), default=0)
    lags = min(25, longest // 4)
    usable = [k for k, error in enumerate(errors) if len(error) > 2 * lags]
    if lags < 2 or not usable:
        return None
    centred = [errors[k] - errors[k].mean() for k in usable]
    samples = sum(len(error) for error in centred)
    power = sum(float(error @ error) for error in centred)
    if not power > 1e-24 * samples:
        return None
    # Plain sums over all records; dividing each by its own number of terms is what Ljung and Box add.
    products = np.array([sum(float(e[lag:] @ e[:-lag]) for e in centred) for lag in range(1, lags + 1)])
    terms = np.array([sum(len(e) - lag for e in centred) for lag in range(1, lags + 1)])
    correlation = products / power
    whiteness = float(samples * np.sum(correlation**2 * samples / terms))
    single = float(normal_ppf(0.5 + 0.5 * LEVEL))

    # The errors' own colour widens what chance allows, so that one test does not fail because the other does.
    colour = autocovariance(centred, min(4 * lags, longest))
    statistics: dict[str, float] = {}
    limit = float(chi2_isf(lags, 1.0 - LEVEL ** (1.0 / max(len(names), 1))))
    for column, name in enumerate(names):
        before = [inputs[k][:, column] - inputs[k][:, column].mean() for k in usable]
        size = float(np.sqrt(np.mean(np.concatenate([u[lags - 1 : -1] for u in before]) ** 2)))
        if not size > 0.0:
            continue
        before = [u / size for u in before]
        total = np.array(
            [
                sum(float(u[lags - lag : len(u) - lag] @ e[lags:]) for u, e in zip(before, centred, strict=True))
                for lag in range(1, lags + 1)
            ]
        )
        spread = lagged_information(before, lags, colour)
        # Inputs change slowly, so that their lags are nearly collinear: what they share counts once.
        values, vectors = np.linalg.eigh(spread)
        kept = values > 1e-6 * values[-1]
        projected = vectors[:, kept].T @ total
        statistic = float(np.sum(projected**2 / values[kept]))
        # Fewer directions have a lower limit; brought to the probability that all lags would have.
        statistics[name] = float(chi2_isf(lags, max(chi2_sf(int(kept.sum()), statistic), 1e-300)))
    return ResidualTest(
        output=output,
        samples=samples,
        lags=lags,
        autocorrelation=tuple(correlation.tolist()),
        band=single / float(np.sqrt(samples)),
        whiteness=whiteness,
        whiteness_limit=float(chi2_isf(lags, 1.0 - LEVEL)),
        independence=statistics,
        independence_limit=limit,
    )
