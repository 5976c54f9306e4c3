"""Frequency responses of the autopilot's digital filters.

Each filter is a rational function of z^-1 at its sample rate. Responses are complex, shape of `hz`, and hold below half
of the sample rate. Sources: ArduPilot libraries/Filter (LowPassFilter, LowPassFilter2p, NotchFilter,
HarmonicNotchFilter), PX4 mathlib/filter; formulae only.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]

#: ArduPilot runs no harmonic above this part of the gyro's sample rate.
NOTCH_LIMIT = 0.48


@dataclass(frozen=True, slots=True)
class DigitalFilter:
    """A rational function of z^-1 at a sample rate [Hz]: ``sum b_k z^-k / sum a_k z^-k``."""

    b: tuple[float, ...]
    a: tuple[float, ...]
    rate: float

    def response(self, hz: Floats) -> Complexes:
        """Compute the frequency response."""
        delay = np.exp(-2j * np.pi * np.asarray(hz, np.float64) / self.rate)
        return np.asarray(_polynomial(self.b, delay) / _polynomial(self.a, delay))


def _polynomial(coefficients: Sequence[float], x: Complexes) -> Complexes:
    """Return ``sum c_k x^k``, several times as fast as `numpy.polyval` of so few."""
    total = np.full_like(x, coefficients[-1])
    for coefficient in coefficients[-2::-1]:
        total *= x
        total += coefficient
    return total


def low_pass_alpha(rate: float, cutoff: float) -> float:
    """Compute the step of a first-order low-pass per sample; a cutoff of 0 means no filter (alpha 1).

    ArduPilot `calc_lowpass_alpha_dt`: dt / (dt + 1 / (2 pi f)).
    """
    if cutoff <= 0.0:
        return 1.0
    dt = 1.0 / rate
    return dt / (dt + 1.0 / (2.0 * math.pi * cutoff))


def first_order(rate: float, cutoff: float) -> DigitalFilter:
    """Return the first-order low-pass ``y += alpha (x - y)``; rate and cutoff in Hz, cutoff 0 for none."""
    alpha = low_pass_alpha(rate, cutoff)
    return DigitalFilter((alpha,), (1.0, alpha - 1.0), rate)


def second_order(rate: float, cutoff: float) -> DigitalFilter:
    """Return the Butterworth low-pass of the gyro (LowPassFilter2p): bilinear with prewarped cutoff; 0 for none."""
    if cutoff <= 0.0 or cutoff >= 0.5 * rate:
        return DigitalFilter((1.0,), (1.0,), rate)
    ohm = math.tan(math.pi * cutoff / rate)
    c = 1.0 + math.sqrt(2.0) * ohm + ohm * ohm
    b = ohm * ohm / c
    return DigitalFilter(
        (b, 2.0 * b, b), (1.0, 2.0 * (ohm * ohm - 1.0) / c, (1.0 - math.sqrt(2.0) * ohm + ohm * ohm) / c), rate
    )


def notch(rate: float, centre: float, attenuation: float, quality: float) -> DigitalFilter:
    """Return a notch of a given quality factor; `attenuation` is the square root of its gain at the centre."""
    omega = 2.0 * math.pi * centre / rate
    alpha = math.sin(omega) / (2.0 * quality)
    squared = attenuation * attenuation
    return DigitalFilter(
        (1.0 + alpha * squared, -2.0 * math.cos(omega), 1.0 - alpha * squared),
        (1.0 + alpha, -2.0 * math.cos(omega), 1.0 - alpha),
        rate,
    )


def harmonic_notches(
    rate: float,
    base: float,
    *,
    nominal: float,
    bandwidth: float,
    attenuation_db: float,
    harmonics: int,
    composite: int = 1,
) -> tuple[DigitalFilter, ...]:
    """Return the notches of a harmonic notch filter tracking a base frequency."""
    centre = min(max(nominal, 0.52 * bandwidth), NOTCH_LIMIT * rate)
    spread = bandwidth / (32.0 * centre)
    octaves = 2.0 * math.log2(centre / (centre - bandwidth / composite / 2.0))
    quality = math.sqrt(2.0**octaves) / (2.0**octaves - 1.0)
    attenuation = 10.0 ** (-attenuation_db / 40.0)
    offsets = {1: (0.0,), 2: (-spread, spread), 3: (0.0, -spread, spread)}[composite]
    centres = [
        base * (k + 1) * (1.0 + offset) for k in range(16) if harmonics >> k & 1 for offset in offsets if base > 0.0
    ]
    return tuple(notch(rate, f, attenuation, quality) for f in centres if 0.0 < f < NOTCH_LIMIT * rate)


def cascade(filters: Sequence[DigitalFilter], hz: Floats) -> Complexes:
    """Compute the response of filters in series; ones where there are none."""
    result = np.ones(len(hz), np.complex128)
    for one in filters:
        result *= one.response(hz)
    return result
