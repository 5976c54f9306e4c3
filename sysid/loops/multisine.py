"""Orthogonal multisines of low peak factor (Morelli 2012, "Optimal input design for aircraft stability and control").

Each input has its own harmonics of one period, so that all are excited at once and none looks like another.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.loops.filters import Floats

#: Rounds of the clipping algorithm (Van der Ouderaa et al. 1988) that lowers the peak factor, and where it clips.
_ROUNDS, _CLIP = 300, 0.85

#: Samples per period in which peaks are looked for.
_SAMPLES = 4096


@dataclass(frozen=True, slots=True, eq=False)
class Multisine:
    """A sum of sines ``amplitude sin(2 pi hz t + phase)``, periodic in `period` s and zero at its start."""

    hz: Floats
    amplitude: Floats
    phase: Floats
    period: float

    def at(self, t: Floats) -> Floats:
        """Return values at times, s."""
        return np.asarray(np.sin(2.0 * np.pi * np.outer(t, self.hz) + self.phase) @ self.amplitude)

    @property
    def peak_factor(self) -> float:
        """Return (max - min) / (2 sqrt 2 rms): 1 for a sine."""
        return _peak_factor(self.at(np.arange(_SAMPLES) / _SAMPLES * self.period))


def _peak_factor(x: Floats) -> float:
    return float((x.max() - x.min()) / (2.0 * np.sqrt(2.0) * np.sqrt(np.mean(x**2))))


def orthogonal_multisines(inputs: int, low: float, high: float, period: float) -> tuple[Multisine, ...]:
    """Design multisines of unit peak for several inputs: harmonics of 1 / period dealt out in turn."""
    harmonics = np.arange(np.ceil(low * period), np.floor(high * period) + 1.0)
    return tuple(_optimised(harmonics[k::inputs], period) for k in range(inputs))


def _optimised(harmonics: Floats, period: float) -> Multisine:
    """Choose phases: Schroeder's, then clipping in time and keeping the phases of what results."""
    count = len(harmonics)
    order = np.arange(1, count + 1)
    bins = harmonics.astype(int)

    def over_a_period(phase: Floats) -> Floats:
        spectrum = np.zeros(_SAMPLES // 2 + 1, complex)
        spectrum[bins] = -1j * np.exp(1j * phase) * _SAMPLES / 2.0 / np.sqrt(count)
        return np.fft.irfft(spectrum)

    best = phase = -np.pi * order * (order - 1) / count
    x = signal = over_a_period(phase)
    for _ in range(_ROUNDS):
        limit = _CLIP * np.max(np.abs(signal))
        phase = np.angle(np.fft.rfft(np.clip(signal, -limit, limit))[bins]) + 0.5 * np.pi
        signal = over_a_period(phase)
        if _peak_factor(signal) < _peak_factor(x):
            best, x = phase, signal
    start = int(np.flatnonzero((x[:-1] <= 0.0) & (x[1:] > 0.0))[0]) / _SAMPLES
    shifted = np.mod(best + 2.0 * np.pi * harmonics * start, 2.0 * np.pi)
    return Multisine(harmonics / period, np.full(count, 1.0 / np.sqrt(count) / np.max(np.abs(x))), shifted, period)
