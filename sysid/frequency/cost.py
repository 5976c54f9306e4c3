"""The cost of a fit as engineers of rotorcraft compare it: J of Tischler and Remple."""

from __future__ import annotations

import numpy as np

from sysid.frequency.response import Complex, Floats

#: Weight of a squared degree beside a squared dB: 1 dB counts as 7.57 deg (Tischler and Remple 2012, section 11.2).
PHASE_WEIGHT = 0.01745

#: Cost up to which a fit is good, and up to which it can hardly be told from a perfect one.
ACCEPTABLE, EXCELLENT = 100.0, 50.0

#: Cost beyond which the parameters mean nothing.
POOR = 400.0


def coherence_weight(coherence: Floats) -> Floats:
    """Weigh frequencies by coherence: ``(1.58 (1 - exp(-gamma^2)))^2`` (Tischler and Remple 2012, eq. 11.4)."""
    return np.asarray((1.58 * (1.0 - np.exp(-coherence))) ** 2)


def cost(measured: Complex, modelled: Complex, coherence: Floats) -> float:
    """Compute J, the weighted mean of squared dB and degrees, times 20 (Tischler and Remple 2012, eq. 11.3).

    `measured, modelled` (n,): frequency responses; `coherence` (n,): of the measured response, from 0 to 1.
    """
    ratio = measured / modelled
    gain, phase = 20.0 * np.log10(np.abs(ratio)), np.degrees(np.angle(ratio))
    return float(20.0 * np.mean(coherence_weight(coherence) * (gain**2 + PHASE_WEIGHT * phase**2)))
