"""Chirps of mode SYSTEMID for a craft: band and magnitude from its response, with the errors that they will leave."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from sysid.frequency.fit import FLOOR, fit
from sysid.frequency.fitted import TIMES, FrequencyFit
from sysid.loops.controller import LoopError, LoopSettings
from sysid.loops.filters import Floats
from sysid.loops.loop import RateLoop
from sysid.loops.plant import DELAY_BETWEEN_FLIGHTS, gain_between_flights

#: Unit of an expected error that is a share of the quantity itself.
RELATIVE = "1 (relative)"

#: Highest frequency in parts of the rate at which RATE is logged.
_BELOW_RATE = 0.4

#: Part of the limits of lean, and of rate and mixer, that a design uses: wind leans the craft, and gusts need the rest.
_USED_LEAN, _USED = 0.75, 0.85

#: Frequencies at which a chirp may start and stop, in parts of the crossover; the highest beyond which none stops [Hz,
#: or three times the crossover]: frames bend there, and a fit without their modes errs by more than it gains.
_STARTS, _STOPS, _RIGID = (0.1, 0.15, 0.2, 0.3, 0.4), (1.75, 2.0, 2.5, 3.0, 4.0, 6.0, 8.0), (8.0, 3.0)

#: Times [s] over which a chirp may fade in. A slow one keeps it small at the frequencies that lean the craft, which
#: a sweep passes first, and lets it grow towards those that the limits of rate and mixer allow.
_FADES_IN, FADE_OUT = (1.0, 3.0, 6.0, 9.0, 12.0, 15.0, 18.0), 1.0

#: How far past a mode that was found a chirp may go, in parts of its frequency, and where none ends: too near to it to
#: know it, too near not to be bent by it.
_PAST_MODE, _ON_MODE = 1.6, (0.7, 1.4)

#: Length of a chirp, and time over which the first chirp of a craft fades in, s.
_SECONDS, _FIRST_FADE = 20.0, 3.0

#: Peak of the sensitivity that a craft may have before it is known.
_RESONANCE = 4.0

#: A plain chirp: the firmware's own SID_F_START_HZ and SID_F_STOP_HZ, Hz,
#: and a magnitude at the mixer (its own, 15, is meant for angles).
DEFAULT_BAND, DEFAULT_MAGNITUDE = (0.5, 40.0), 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What an experiment may ask of the craft: lean [deg], rates [deg/s], part of the mixer's range, height [m]."""

    lean_deg: float = 20.0
    rate_deg: float = 150.0
    mixer: float = 0.3
    height_m: float = 20.0


@dataclass(frozen=True, slots=True)
class Expected:
    """A standard deviation that a flight will leave of one parameter."""

    name: str
    #: The error to count with: `random`, what the structure cannot follow, and by what flights of one craft differ.
    sigma: float
    unit: str
    random: float = 0.0  #: By which repeated flights of the same design will scatter; 0 where nothing tells.

    def __str__(self) -> str:
        def shown(sigma: float) -> str:
            return f"{100 * sigma:.2g} %" if self.unit == RELATIVE else f"{sigma:.2g} {self.unit}"

        scatter = f" (repeated flights scatter by {shown(self.random)})" if self.random else ""
        return f"{self.name}: {shown(self.sigma)}{scatter}"


@dataclass(frozen=True, slots=True)
class ChirpDesign:
    """One chirp and what is expected of it."""

    axis: str
    #: SID_F_START_HZ, SID_F_STOP_HZ, SID_MAGNITUDE, SID_T_REC, SID_T_FADE_IN.
    low: float
    high: float
    magnitude: float
    seconds: float
    fade_in: float
    errors: tuple[Expected, ...]  #: Of the craft's parameters; empty before the first chirp.
    #: Largest that are expected.
    lean_deg: float
    rate_deg: float
    mixer: float


def chirp_window(hz: Floats, low: float, high: float, seconds: float, fade_in: float) -> Floats:
    """Return which part of its magnitude a chirp of SYSTEMID has when it passes a frequency; 0 outside its band.

    It holds the lowest frequency for two cycles, then sweeps evenly in the logarithm of frequency.

    `hz` (n,): frequencies, Hz. Returns (n,): from 0 to 1.
    """
    held = 2.0 / low
    inside = (hz >= low) & (hz <= high)
    t = held + (seconds - held) * np.log(np.where(inside, hz, low) / low) / np.log(high / low)
    part = np.clip(np.minimum(t / fade_in, (seconds - t) / FADE_OUT), 0.0, 1.0)
    return np.where(inside, 0.5 - 0.5 * np.cos(np.pi * part), 0.0)


def chirp_energy(
    hz: Floats, low: float, high: float, magnitude: float, seconds: float, fade_in: float = FADE_OUT
) -> Floats:
    """Return the energy per Hz of a logarithmic sweep, ``A^2 / (4 f')`` at its speed f'; 0 outside its band.

    `hz` (n,): frequencies, Hz. Returns (n,): square of the magnitude's unit, over Hz^2.
    """
    passing = (seconds - 2.0 / low) / (hz * np.log(high / low))
    return np.asarray(0.25 * passing * (magnitude * chirp_window(hz, low, high, seconds, fade_in)) ** 2, np.float64)


def flown_energy(loop: RateLoop) -> Floats:
    """Return the energy per Hz of the chirps that a loop was identified with, at the frequencies of its response."""
    if not loop.records:
        raise LoopError(f"{loop.name}: without records the errors of other chirps are unknown")
    frf = loop.frf
    total = np.zeros(len(frf.hz))
    for record in loop.records:
        chirp = record.plant.instruments[:, 0]
        size = 4 * len(chirp)
        grid = np.fft.rfftfreq(size, record.plant.dt)
        summed = (
            np.concatenate([[0.0], np.cumsum(np.abs(np.fft.rfft(chirp, size)) ** 2)]) * record.plant.dt**2 * grid[1]
        )
        edges = (grid[0] - 0.5 * grid[1]) + grid[1] * np.arange(len(summed))
        half = 0.5 * np.maximum(frf.resolution, 2.0 * grid[1])
        total += (np.interp(frf.hz + half, edges, summed) - np.interp(frf.hz - half, edges, summed)) / (2.0 * half)
    return total


def predicted_errors(loop: RateLoop, model: FrequencyFit, energy: Floats) -> tuple[Expected, ...]:
    """Predict what the fit to another experiment on a craft will leave undetermined.

    The errors of the flown response are those of its noise, its windows and its estimator; at each frequency they fall
    with the root of the energy. The fit weighs them as `sysid.frequency.fit` does.

    `energy`: of the experiment at the mixer, per Hz. As the fit names
    them; empty where the experiment determines nothing.
    """
    frf, structure = loop.frf, model.structure[0]
    names = list(structure.names)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = frf.sigma * np.sqrt(flown_energy(loop) / energy)
    good = np.isfinite(sigma) & (sigma < 0.4) & frf.usable & (energy > 0.0)
    if np.count_nonzero(good) < len(names) + 2:
        return ()
    hz, sigma, worth = frf.hz[good], sigma[good], frf.weight_of_points[good]
    slope = structure.slopes(model.values, hz)
    weight = worth / (sigma**2 + FLOOR**2)
    information = (slope.conj().T * weight) @ slope
    stated = np.linalg.pinv(information.real, hermitian=True)
    scatter = stated @ ((slope.conj().T * (weight**2 * sigma**2 / worth)) @ slope).real @ stated
    rows = {name: np.eye(len(names))[k] for k, name in enumerate(names) if name not in TIMES}
    rows["effective_delay"] = np.array([TIMES.get(name, 0.0) for name in names])
    between = {"gain": gain_between_flights(loop.axis), "effective_delay": DELAY_BETWEEN_FLIGHTS}
    errors = []
    for name, row in rows.items():
        size = abs(float(model.values[0])) if name == "gain" else 1.0
        random, whole = (float(np.sqrt(max(row @ matrix @ row, 0.0))) / size for matrix in (scatter, stated))
        unit = RELATIVE if name == "gain" else structure.specs[names.index(name)].unit if name in names else "s"
        errors.append(Expected(name, float(np.hypot(whole, between.get(name, 0.0))), unit, random))
    return tuple(errors)


def motion_per_unit(loop: RateLoop) -> Floats:
    """Return lean [rad], rate [rad/s] and mixer input per unit of a chirp, at the worst of the draws, shape (3, n)."""
    own = loop.with_settings(loop.flown)
    sensitivity = np.max(1.0 / np.abs(1.0 + own.draws), axis=0)
    rate = np.abs(own.plant.response / own.flown.gyro.response(own.hz)) * sensitivity
    return np.stack([rate / (2.0 * np.pi * own.hz), rate, sensitivity])


def design_chirp(loop: RateLoop, limits: Limits) -> ChirpDesign:
    """Choose band and magnitude: small errors of gain and delay within the limits, starting as low as they allow.

    Low frequencies tell of the rejection of disturbances, which gains that `tune` tries move down.
    """
    crossover = loop.with_settings(loop.flown).margins.crossover_hz.value
    if crossover is None:
        raise LoopError(f"{loop.axis}: the crossover is not known, so that no chirp can be designed around it")
    model = fit(loop.frf)
    mode = model.parameters.get("mode_frequency")
    bends = 0.0 if mode is None or mode.value is None else mode.value / (2.0 * np.pi)
    highest = min(_BELOW_RATE / loop.frf.step, loop.hz[-1], max(_RIGID[0], _RIGID[1] * crossover, _PAST_MODE * bends))
    moved = motion_per_unit(loop)
    allowed = (_USED_LEAN * np.radians(limits.lean_deg), _USED * np.radians(limits.rate_deg), _USED * limits.mixer)
    found_designs: list[tuple[float, ChirpDesign]] = []
    for start, stop, fade_in in itertools.product(_STARTS, _STOPS, _FADES_IN):
        low = float(f"{max(start * crossover, loop.hz[0], 2.0 / (0.3 * _SECONDS)):.2g}")
        high = float(f"{min(stop * crossover, highest):.3g}")
        if high < 3.0 * low or fade_in > _SECONDS - FADE_OUT or _ON_MODE[0] * bends < high < _ON_MODE[1] * bends:
            continue
        largest_motion = (moved * chirp_window(loop.hz, low, high, _SECONDS, fade_in)).max(axis=1)
        largest = float(np.min(np.array(allowed) / largest_motion))
        magnitude = float(f"{0.995 * largest:.2g}")
        magnitude = magnitude if magnitude <= largest else float(f"{0.9 * largest:.2g}")
        errors = predicted_errors(loop, model, chirp_energy(loop.frf.hz, low, high, magnitude, _SECONDS, fade_in))
        if not errors:
            continue
        lean, rate, mixer = magnitude * largest_motion
        design = ChirpDesign(
            axis=loop.axis,
            low=low,
            high=high,
            magnitude=magnitude,
            seconds=_SECONDS,
            fade_in=fade_in,
            errors=errors,
            lean_deg=float(np.degrees(lean)),
            rate_deg=float(np.degrees(rate)),
            mixer=float(mixer),
        )
        found_designs.append((errors[0].random * errors[-1].random, design))  # of gain and effective delay
    if not found_designs:
        raise LoopError(f"{loop.axis}: RATE is logged too seldom for a chirp around {crossover:.1f} Hz")
    least = min(badness for badness, _ in found_designs)
    # Of those that err little more, the chirp that starts lowest.
    return min((one for badness, one in found_designs if badness <= 1.3 * least), key=lambda one: one.low)


def first_chirp(settings: LoopSettings, limits: Limits) -> ChirpDesign:
    """Choose a careful chirp for a craft that was never identified, from its gains alone.

    Where the loop is tight the rate per unit of the chirp is one over the controller's gain; elsewhere less, but for
    the loop's resonance, for which a factor of `_RESONANCE` is allowed.
    """
    low, high = DEFAULT_BAND
    hz = np.geomspace(low, high, 200)
    rate = _RESONANCE / np.abs(settings.feedback(hz))
    lean = rate / (2.0 * np.pi * hz)
    largest = min(
        _USED_LEAN * np.radians(limits.lean_deg) / float(lean.max()),
        _USED * np.radians(limits.rate_deg) / float(rate.max()),
        _USED * limits.mixer / _RESONANCE,
        DEFAULT_MAGNITUDE,
    )
    magnitude = float(f"{largest:.2g}")
    return ChirpDesign(
        settings.axis,
        low,
        high,
        magnitude,
        _SECONDS,
        _FIRST_FADE,
        (),
        float(np.degrees(magnitude * lean.max())),
        float(np.degrees(magnitude * rate.max())),
        magnitude * _RESONANCE,
    )
