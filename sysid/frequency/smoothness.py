"""Whether a response is as smooth as its stated errors allow."""

from __future__ import annotations

import numpy as np

from sysid.frequency.response import COHERENT, Complex, Floats

#: Reach of the local parabolas in ln f to both sides.
_REACH = 0.35


def roughness(hz: Floats, response: Complex, sigma: Floats, coherence: Floats) -> float:
    """Compare the scatter of ln G about local parabolas over ln f with the stated errors.

    Noise that is not there while the chirp is elsewhere, such as that of outputs rounded to 1 us, does not show in the
    spectrum of the remainder, but it does in a response that is rougher than its errors.

    Parameters
    ----------
    hz, response, sigma, coherence : ndarray, shape (n,)
        The response with its steep part (an integrator) taken out.

    Returns
    -------
    float
        Median over frequency of the root mean square scatter in standard deviations; 0 where little is coherent.
    """
    good = (coherence >= COHERENT) & np.isfinite(sigma) & (np.abs(response) > 0.0)
    if np.count_nonzero(good) < 12:
        return 0.0
    x, weight = np.log(hz[good]), 1.0 / sigma[good]
    log_g = np.log(np.abs(response[good])) + 1j * np.unwrap(np.angle(response[good]))
    scatter = []
    for at in x:
        near = np.abs(x - at) < _REACH
        if np.count_nonzero(near) < 8:
            continue
        dx = x[near] - at
        regressors = np.column_stack([np.ones_like(dx), dx, dx**2]) * weight[near, None]
        wanted = log_g[near] * weight[near]
        rest = wanted - regressors @ np.linalg.lstsq(regressors, wanted, rcond=None)[0]
        scatter.append(np.mean(np.abs(rest) ** 2) / 2.0)
    return float(np.sqrt(np.median(scatter))) if scatter else 0.0
