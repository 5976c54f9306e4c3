"""Margins of a loop from its broken-loop response, for one response or many draws of it at once.

Signs: `loop` L is the negative of what comes back when one goes in, so that the loop closes as 1 / (1 + L). Source:
Åström and Murray (2021), chapters 10 and 12; disturbance-rejection bandwidth and peak as in Berger et al. (2016).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.loops.filters import Complexes, Floats

#: |S| that bounds the band in which disturbances are rejected.
REJECTED = 10.0 ** (-3.0 / 20.0)


class MarginSet(NamedTuple):
    """Margins of K loops, each of shape (K,); NaN where the band does not show one."""

    gain_db: Floats  #: Smallest factor of the gain to instability, dB; negative beyond it.
    phase_deg: Floats  #: Smallest phase lag to instability, deg; negative beyond it.
    crossover_hz: Floats  #: Highest frequency at which the gain falls through one.
    rejection_hz: Floats  #: Frequency up to which disturbances are lowered by 3 dB or more.
    peak_db: Floats  #: Largest amplification of a disturbance, dB.
    stable: NDArray[np.bool_]  #: Whether the closed loop is stable, by the Nyquist criterion on the band.

    def row(self, k: int) -> dict[str, float]:
        """Return one loop's margins by name."""
        return {name: float(values[k]) for name, values in self._asdict().items()}


def margins_of(hz: Floats, loop: Complexes) -> MarginSet:
    """Compute the margins of broken-loop responses.

    `hz` (n,): increasing; `loop` (K, n) or (n,). The controller integrates twice and the attitude once: at low
    frequency the phase may come from -270 deg, and noise may let it cross -180 deg there and back: of a stable loop a
    crossing with a gain above one is the limit of lowering the gain and no gain margin.
    """
    loop = np.atleast_2d(loop)
    log_hz = np.log(hz)
    size = np.log(np.maximum(np.abs(loop), 1e-12))
    sensitivity = 1.0 / np.maximum(np.abs(1.0 + loop), 1e-12)

    stable = _is_stable(loop)
    above = size >= 0.0
    k, i = np.nonzero(above[:, :-1] != above[:, 1:])
    part = size[k, i] / (size[k, i] - size[k, i + 1])
    towards = np.angle(-loop[k, i]) + part * np.angle(loop[k, i + 1] / loop[k, i])
    towards = np.degrees((towards + np.pi) % (2.0 * np.pi) - np.pi)
    phase = np.full(len(loop), np.inf)
    np.minimum.at(phase, k, np.where(stable[k], np.abs(towards), towards))
    falls = above[k, i]
    crossover = np.full(len(loop), -np.inf)
    np.maximum.at(crossover, k[falls], np.exp(log_hz[i] + part * np.diff(log_hz)[i])[falls])

    below = loop.imag < 0.0
    k, i = np.nonzero(below[:, :-1] != below[:, 1:])
    here, there = loop[k, i], loop[k, i + 1]
    axis = here.real + here.imag / (here.imag - there.imag) * (there.real - here.real)
    gains = -20.0 * np.log10(np.where(axis < 0.0, -axis, 1.0))
    counted = (axis < 0.0) & ((gains > 0.0) | below[k, i] & ~stable[k])
    gain = np.full(len(loop), np.inf)
    np.minimum.at(gain, k[counted], gains[counted])

    kept = sensitivity <= REJECTED
    first = np.argmin(kept, axis=1)
    rejection = np.full(len(loop), np.nan)
    rows = np.flatnonzero((first > 0) & ~kept[np.arange(len(loop)), first])
    before, after = sensitivity[rows, first[rows] - 1], sensitivity[rows, first[rows]]
    weight = np.log(REJECTED / before) / np.log(after / before)
    rejection[rows] = np.exp(log_hz[first[rows] - 1] + weight * (log_hz[first[rows]] - log_hz[first[rows] - 1]))
    return MarginSet(
        gain_db=np.where(np.isfinite(gain), gain, np.nan),
        phase_deg=np.where(np.isfinite(phase), phase, np.nan),
        crossover_hz=np.where(np.isfinite(crossover), crossover, np.nan),
        rejection_hz=rejection,
        peak_db=20.0 * np.log10(np.max(sensitivity, axis=1)),
        stable=stable,
    )


def _is_stable(loop: Complexes) -> NDArray[np.bool_]:
    """Count turns of 1 + L about zero: none remain where the loop is stable.

    At the lowest frequency the phase of 1 + L lies between -300 and 60 deg (up to three integrations); it must end
    at zero, where L has died out, without a further turn.
    """
    whole = 1.0 + loop
    start = np.angle(whole[:, 0])
    start = np.where(start > np.radians(60.0), start - 2.0 * np.pi, start)
    turning = np.sum(np.angle(whole[:, 1:] / whole[:, :-1]), axis=1)
    return np.asarray(np.rint((start + turning) / (2.0 * np.pi)) == 0.0)
