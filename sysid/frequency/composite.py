"""One response from windows of several lengths, and whether it is as smooth as its stated errors allow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.frequency.response import COHERENT, Complex, Floats
from sysid.frequency.spectra import HANN_BANDWIDTH, WindowEstimate

#: Reach of the local parabolas in ln f to both sides, and the fewest frequencies that one is laid through.
_REACH, _FEWEST = 0.35, 8


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


def roughness(hz: Floats, response: Complex, sigma: Floats, coherence: Floats) -> float:
    """Compare the scatter of ln G about local parabolas over ln f with the stated errors.

    Noise that is not there while the chirp is elsewhere, such as that of outputs rounded to 1 us, does not show in the
    spectrum of the remainder, but it does in a response that is rougher than its errors.

    `hz, response, sigma, coherence` (n,): the response with its steep part (an integrator) taken out. Returns median
    over frequency of the root mean square scatter in standard deviations; 0 where little is coherent.
    """
    good = (coherence >= COHERENT) & np.isfinite(sigma) & (np.abs(response) > 0.0)
    if np.count_nonzero(good) < 12:
        return 0.0
    x, weight = np.log(hz[good]), 1.0 / sigma[good]
    log_g = np.log(np.abs(response[good])) + 1j * np.unwrap(np.angle(response[good]))
    apart = x - x[:, None]
    near = np.where(np.abs(apart) < _REACH, weight, 0.0)
    enough = np.count_nonzero(near, axis=1) >= _FEWEST
    if not enough.any():
        return 0.0
    apart, near = apart[enough] / _REACH, near[enough]
    regressors = np.stack([near, near * apart, near * apart**2], axis=2)
    wanted = near * log_g
    normal = np.swapaxes(regressors, 1, 2)
    rest = wanted - (regressors @ np.linalg.solve(normal @ regressors, normal @ wanted[..., None]))[..., 0]
    scatter = np.sum(np.abs(rest) ** 2, axis=1) / np.count_nonzero(near, axis=1) / 2.0
    return float(np.sqrt(np.median(scatter)))
