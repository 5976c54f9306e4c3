"""Chirps of mode SYSTEMID for a craft: band and magnitude from its response, with the errors that they will leave."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.loops.errors import LoopError
from sysid.loops.filters import Floats
from sysid.loops.loop import RateLoop
from sysid.loops.settings import LoopSettings
from sysid.records.periodogram import welch

#: SID_AXIS of a chirp at the mixer.
SID_AXIS = {"roll": 10, "pitch": 11, "yaw": 12}

#: Highest frequency in parts of the rate at which RATE is logged.
_BELOW_RATE = 0.4

#: Part of a limit that a design uses: gusts need the rest.
_USED = 0.7

#: Peak of the sensitivity that a craft may have before it is known.
_RESONANCE = 4.0

#: What ArduPilot's documentation suggests, to compare with: band, Hz, and magnitude at the mixer.
DEFAULT_BAND, DEFAULT_MAGNITUDE = (0.5, 40.0), 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What an experiment may ask of the craft: lean [deg], rates [deg/s], part of the mixer's range, height [m]."""

    lean_deg: float = 15.0
    rate_deg: float = 120.0
    mixer: float = 0.3
    height_m: float = 20.0


@dataclass(frozen=True, slots=True)
class ChirpDesign:
    """One chirp and what is expected of it."""

    axis: str
    #: SID_F_START_HZ, SID_F_STOP_HZ, SID_MAGNITUDE, SID_T_REC.
    low: float
    high: float
    magnitude: float
    seconds: float
    gain_sigma: float | None  #: Predicted standard deviation of ln gain of the craft; None before the first chirp.
    delay_sigma: float | None  #: Of its delay, s.
    #: Largest that are expected.
    lean_deg: float
    rate_deg: float
    mixer: float


def noise_of(loop: RateLoop) -> tuple[Floats, Floats]:
    """Estimate the two-sided spectrum of the measured rate that the chirp does not explain, (rad/s)^2 / Hz.

    Raises
    ------
    LoopError
        For a loop that has no records.
    """
    if not loop.records:
        raise LoopError(f"{loop.name}: without records the noise is unknown")
    spectra, hz = [], np.zeros(0)
    for record in loop.records:
        plant = record.plant
        chirp, rate = plant.instruments[:, 0], plant.output
        grid = np.fft.rfftfreq(len(rate), plant.dt)
        closed = loop.plant.response / (1.0 + loop.with_settings(loop.flown).response)
        through = np.interp(grid, loop.hz, closed.real, 0.0, 0.0) + 1j * np.interp(grid, loop.hz, closed.imag, 0.0, 0.0)
        rest = rate - np.fft.irfft(np.fft.rfft(chirp) * through, len(rate))
        # The ends of the record, where the transform wraps around, are left out.
        rest = rest[len(rest) // 10 : -len(rest) // 10]
        hz, power = welch(rest, 1.0 / plant.dt, min(256, len(rest)))
        spectra.append(power / 2.0)
    return hz[1:], np.median(spectra, axis=0)[1:]


def chirp_errors(loop: RateLoop, low: float, high: float, magnitude: float, seconds: float) -> tuple[float, float]:
    """Predict the standard deviations of ln gain and of delay [s] that a chirp will leave (Cramer-Rao bound).

    The measured rate is ``T d + e`` with ``T = G / (1 + L)``, so that ``dT / d ln G = T / (1 + L)``; a logarithmic
    sweep has the energy ``A^2 / (4 f')`` per Hz at its speed ``f' = f ln(high / low) / seconds``.
    """
    hz = loop.hz[(loop.hz >= low) & (loop.hz <= high)]
    own = loop.with_settings(loop.flown)
    broken = np.interp(hz, loop.hz, own.response.real) + 1j * np.interp(hz, loop.hz, own.response.imag)
    plant = np.interp(hz, loop.hz, np.abs(own.plant.response))
    noise_hz, noise = noise_of(loop)
    spectrum = np.exp(np.interp(np.log(hz), np.log(noise_hz), np.log(np.maximum(noise, 1e-16))))
    energy = magnitude**2 * seconds / (4.0 * hz * np.log(high / low))
    density = 2.0 * (plant / np.abs(1.0 + broken) ** 2) ** 2 * energy / spectrum
    width = np.gradient(hz)
    return (
        float(np.sum(density * width) ** -0.5),
        float(np.sum(density * (2.0 * np.pi * hz) ** 2 * width) ** -0.5),
    )


def expected_motion(loop: RateLoop, low: float, high: float) -> tuple[float, float, float]:
    """Return the largest lean [rad], rate [rad/s] and mixer input per unit of a chirp, at the worst of the draws."""
    inside = (loop.hz >= low) & (loop.hz <= high)
    own = loop.with_settings(loop.flown)
    sensitivity = np.max(1.0 / np.abs(1.0 + own.draws[:, inside]), axis=0)
    true = np.abs(own.plant.response / own.flown.gyro.response(own.hz))[inside]
    rate = true * sensitivity
    return (
        float(np.max(rate / (2.0 * np.pi * own.hz[inside]))),
        float(np.max(rate)),
        float(np.max(sensitivity)),
    )


def design_chirp(loop: RateLoop, limits: Limits, seconds: float = 20.0) -> ChirpDesign:
    """Choose band and magnitude: smallest product of both errors within the limits and around the crossover.

    Raises
    ------
    LoopError
        Where the crossover is not known.
    """
    crossover = loop.with_settings(loop.flown).margins.crossover_hz.value
    if crossover is None:
        raise LoopError(f"{loop.axis}: the crossover is not known, so that no chirp can be designed around it")
    highest = min(_BELOW_RATE / loop.frf.step, loop.hz[-1])
    best: ChirpDesign | None = None
    least = np.inf
    for start in (0.1, 0.15, 0.2, 0.3, 0.4):
        for stop in (1.7, 2.0, 2.5, 3.0):
            low = float(f"{max(start * crossover, loop.hz[0]):.2g}")
            high = float(f"{min(stop * crossover, highest):.3g}")
            if high < 3.0 * low:
                continue
            lean, rate, mixer = expected_motion(loop, low, high)
            largest = _USED * min(
                np.radians(limits.lean_deg) / lean, np.radians(limits.rate_deg) / rate, limits.mixer / mixer
            )
            magnitude = float(f"{0.995 * largest:.2g}")
            magnitude = magnitude if magnitude <= largest else float(f"{0.9 * largest:.2g}")
            gain, delay = chirp_errors(loop, low, high, magnitude, seconds)
            design = ChirpDesign(
                loop.axis,
                low,
                high,
                magnitude,
                seconds,
                gain,
                delay,
                float(np.degrees(magnitude * lean)),
                float(np.degrees(magnitude * rate)),
                magnitude * mixer,
            )
            if gain * delay < least:
                best, least = design, gain * delay
    if best is None:
        raise LoopError(f"{loop.axis}: RATE is logged too seldom for a chirp around {crossover:.1f} Hz")
    return best


def first_chirp(settings: LoopSettings, limits: Limits, seconds: float = 20.0) -> ChirpDesign:
    """Choose a careful chirp for a craft that was never identified, from its gains alone.

    Where the loop is tight the rate per unit of the chirp is one over the controller's gain; elsewhere less, but for
    the loop's resonance, for which a factor of `_RESONANCE` is allowed.
    """
    low, high = DEFAULT_BAND
    hz = np.geomspace(low, high, 200)
    rate = _RESONANCE / np.abs(settings.feedback(hz))
    lean = rate / (2.0 * np.pi * hz)
    largest = _USED * min(
        np.radians(limits.lean_deg) / float(lean.max()),
        np.radians(limits.rate_deg) / float(rate.max()),
        limits.mixer / _RESONANCE,
        DEFAULT_MAGNITUDE / _USED,
    )
    magnitude = float(f"{largest:.2g}")
    return ChirpDesign(
        settings.axis,
        low,
        high,
        magnitude,
        seconds,
        None,
        None,
        float(np.degrees(magnitude * lean.max())),
        float(np.degrees(magnitude * rate.max())),
        magnitude * _RESONANCE,
    )
