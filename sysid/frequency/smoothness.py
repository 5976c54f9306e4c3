"""Whether a response is as smooth as its stated errors allow."""

from __future__ import annotations

import numpy as np

from sysid.frequency.response import COHERENT, Complex, Floats

#: Reach of the local parabolas in ln f to both sides, and the fewest frequencies that one is laid through.
_REACH, _FEWEST = 0.35, 8


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
