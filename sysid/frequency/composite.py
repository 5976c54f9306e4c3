"""One response from windows of several lengths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.frequency.response import Complex, Floats
from sysid.frequency.spectra import HANN_BANDWIDTH, WindowEstimate


@dataclass(frozen=True, slots=True, eq=False)
class Composite:
    """Merged estimates of one input's response; see `FrequencyResponse` for the fields."""

    response: Complex
    direct: Complex
    sigma: Floats
    coherence: Floats
    multiple: Floats
    resolution: Floats


def merge(hz: Floats, parts: list[tuple[NDArray[np.bool_], WindowEstimate]], column: int) -> Composite:
    """Merge estimates of several window lengths by their random error.

    Weights are the fourth power of the smallest error over each window's own (Tischler and Remple 2012, eq. 10.3).
    The windows share their data: errors are averaged as they are, not reduced.

    `hz` (F,).
    """
    count = (len(parts), len(hz))
    sigma = np.full(count, np.inf)
    response, direct = np.ones(count, dtype=complex), np.ones(count, dtype=complex)
    coherence, multiple, width = np.zeros(count), np.zeros(count), np.zeros(count)
    for k, (mask, part) in enumerate(parts):
        sigma[k, mask] = part.sigma[:, column]
        response[k, mask], direct[k, mask] = part.response[:, column], part.direct[:, column]
        coherence[k, mask], multiple[k, mask] = part.coherence[:, column], part.multiple
        width[k, mask] = HANN_BANDWIDTH / part.length
    best = np.argmin(sigma, axis=0)
    at = np.arange(len(hz))
    smallest = sigma[best, at]
    with np.errstate(invalid="ignore"):
        weight = np.where(np.isfinite(sigma), (smallest / np.maximum(sigma, 1e-300)) ** 4, 0.0)
    total = np.sum(weight, axis=0)
    known = total > 0.0
    weight[best[~known], at[~known]] = 1.0
    weight /= np.sum(weight, axis=0)

    def mean_log(values: Complex) -> Complex:
        first = values[best, at]
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.where(weight > 0.0, np.log(values / first), 0.0)
        return np.asarray(first * np.exp(np.sum(weight * apart, axis=0)))

    return Composite(
        response=mean_log(response),
        direct=mean_log(direct),
        sigma=np.where(known, np.sum(weight * np.where(weight > 0.0, sigma, 0.0), axis=0), np.inf),
        coherence=np.where(known, np.sum(weight * coherence, axis=0), 0.0),
        multiple=np.sum(weight * multiple, axis=0),
        resolution=np.sum(weight * width, axis=0),
    )
