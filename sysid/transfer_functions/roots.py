"""Poles and zeros with the uncertainty that follows from that of the coefficients (delta method)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri as chi2_isf

from sysid.records.experiment import Floats

#: What has a standard deviation above this part of its value is reported as not determined.
DETERMINED = 0.5

#: Roots closer to each other than this part of their size are one multiple root, whose place is not differentiable.
MULTIPLE = 1e-6

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Root:
    """A pole or zero with its uncertainty."""

    value: complex  #: rad/s.
    covariance: Floats  #: shape (2, 2): Of real and imaginary part, (rad/s)^2; infinite for a multiple root.

    @property
    def sigma(self) -> float:
        """Largest standard deviation in any direction, rad/s."""
        if not np.isfinite(self.covariance).all():
            return float("inf")
        return float(np.sqrt(max(np.linalg.eigvalsh(self.covariance)[-1], 0.0)))

    @property
    def determined(self) -> bool:
        """Whether the deviation is below half of the distance from the origin."""
        return self.sigma < DETERMINED * abs(self.value)

    def ellipse(self, level: float = 0.95) -> Complex:
        """Draw the line within which the root lies with the given probability; on the axis, for a real root."""
        values, vectors = np.linalg.eigh(self.covariance)
        radii = np.sqrt(np.maximum(values, 0.0) * chi2_isf(2 if self.value.imag else 1, 1.0 - level))
        angle = np.linspace(0.0, 2.0 * np.pi, 48)
        around = vectors @ (radii[:, None] * np.array([np.cos(angle), np.sin(angle)]))
        return np.asarray(self.value + around[0] + 1j * around[1])


def roots_of(polynomial: Floats, covariance: Floats | None) -> tuple[Root, ...]:
    """Return the roots of ``c_0 s^n + ...``, slowest first, by ``d r / d c_k = -r^(n-k) / C'(r)``."""
    roots = np.roots(polynomial).astype(np.complex128)
    if covariance is None:
        covariance = np.zeros((len(polynomial), len(polynomial)))
    free = len(covariance)
    derivative = np.polyder(polynomial)
    found = []
    for root in sorted(roots, key=lambda r: (abs(r), r.imag)):
        apart = np.abs(roots - root)
        if np.count_nonzero(apart <= MULTIPLE * max(abs(root), 1e-12)) > 1:
            found.append(Root(complex(root), np.full((2, 2), np.inf)))
            continue
        slope = -(root ** np.arange(free - 1, -1, -1)) / np.polyval(derivative, root)
        parts = np.vstack([slope.real, slope.imag])
        found.append(Root(complex(root), np.asarray(parts @ covariance @ parts.T)))
    return tuple(found)
