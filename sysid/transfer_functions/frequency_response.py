"""Frequency response of an estimated transfer function, with its uncertainty.

By the delta method: a quantity's covariance is ``J P J'`` with the covariance P of the coefficients and the quantity's
derivatives J, which is good as long as its deviation is small against itself. Where it is not, the quantity is marked
as not determined instead of being given a band that means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri as chi2_isf

from sysid.records.experiment import Floats
from sysid.transfer_functions.transfer_function import TransferFunction

#: Gain and phase are parts of the logarithm of G; with a larger standard deviation of it, they are not known.
LARGEST_SIGMA = 0.5

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class ModelResponse:
    """G(j omega) with its uncertainty."""

    omega: Floats  #: shape (K,): rad/s.
    response: Complex  #: shape (K,)
    sigma_gain: Floats  #: shape (K,): Standard deviation of the gain's logarithm, that is the relative one of the gain.
    sigma_phase: Floats  #: shape (K,): rad.

    @property
    def determined(self) -> NDArray[np.bool_]:
        """Where the data determine gain and phase, shape (K,)."""
        return np.asarray((self.sigma_gain <= LARGEST_SIGMA) & (self.sigma_phase <= LARGEST_SIGMA))

    @property
    def gain(self) -> Floats:
        """Absolute value of the response, shape (K,)."""
        return np.asarray(np.abs(self.response))

    @property
    def phase(self) -> Floats:
        """Phase in rad, continuous over frequency, shape (K,)."""
        return np.asarray(np.unwrap(np.angle(self.response)))

    def band(self, level: float = 0.95) -> tuple[Floats, Floats]:
        """Return the lower and upper limit of the gain at each frequency."""
        # Beyond e^50 a band says nothing more.
        reach = np.minimum(np.sqrt(chi2_isf(1, 1.0 - level)) * self.sigma_gain, 50.0)
        return self.gain * np.exp(-reach), self.gain * np.exp(reach)


def frequency_response(function: TransferFunction, omega: Floats) -> ModelResponse:
    """Evaluate a transfer function and its uncertainty.

    Parameters
    ----------
    function : TransferFunction
        Without a covariance the deviations are zero.
    omega : ndarray, shape (K,)
        rad/s, above zero.

    Notes
    -----
    With G = B / A, ``d ln G / d b_k = s^k / B`` and ``d ln G / d a_k = -s^k / A``; the real part of ln G is the
    logarithm of the gain, the imaginary part the phase (Ljung 1999, section 9.4). An uncertain delay adds to the phase.
    """
    omega = np.asarray(omega, dtype=np.float64)
    response = function.response(omega)
    none = np.zeros_like(omega)
    late = function.delay_std * omega
    if function.covariance is None or not np.any(function.num):
        return ModelResponse(omega, response, none, late)
    s = 1j * omega[:, None]
    num, den = function.num, function.den
    above = s ** np.arange(len(num) - 1, -1, -1) / np.polyval(num, s)
    below = -(s ** np.arange(len(den) - 2, -1, -1)) / np.polyval(den, s)
    slope = np.hstack([above, below])
    variances = [np.einsum("ki,ij,kj->k", part, function.covariance, part) for part in (slope.real, slope.imag)]
    gain, phase = (np.sqrt(np.maximum(variance, 0.0)) for variance in variances)
    return ModelResponse(omega, response, gain, np.hypot(phase, late))
