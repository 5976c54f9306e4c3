"""One sheet of criteria for a loop: each with its value, its limit, where the limit is from, and whether it is kept.

Limits of helicopters are those of their size. Froude's law, by which they are scaled to unmanned craft (Ivler and Geyer
2024), multiplies frequencies by the root of how many times the craft is smaller than the UH-60 that they are from,
hub-to-hub distance to its rotor's diameter; decibels and degrees stay.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from core.parameter import Parameter
from sysid.frequency.axes import FrequencyError
from sysid.frequency.fit import fit
from sysid.frequency.response import lagging
from sysid.loops.filters import Complexes, Floats
from sysid.loops.known_margins import MARGINS
from sysid.loops.loop import RateLoop
from sysid.loops.margins import margins_of

#: Rejection of disturbances at the attitude that is asked for, rad/s.
_REJECTION = {"roll": 0.9, "pitch": 0.5, "yaw": 0.7}

#: Diameter of the UH-60's rotor, m.
_REFERENCE = 16.36

_MIL, _HOLD = "MIL-F-9490D, table III", "Tischler et al. 2017, hover"
_TISCHLER = "Tischler and Remple 2012"


@dataclass(frozen=True, slots=True)
class Criterion:
    """A number of a loop beside its limit."""

    name: str
    value: Parameter
    limit: float | None = None  #: In the unit of the value; None where none is customary.
    least: bool = True  #: Whether the limit is the least, else the most.
    source: str = ""  #: Of the limit.
    kept: bool | None = None  #: Whether the value keeps it; None without a limit or a value.


def _criterion(
    name: str, value: Parameter, limit: float | None = None, least: bool = True, source: str = ""
) -> Criterion:
    kept = None
    if limit is not None and value.value is not None:
        kept = value.value >= limit if least else value.value <= limit
    return Criterion(name, value, limit, least, source, kept)


def sheet(loop: RateLoop, size: float | None = None) -> tuple[Criterion, ...]:
    """Return the criteria of a loop as its settings have it: at the mixer, at the attitude, and steps.

    Of a craft of known `size` [m], hub to hub, the limits of helicopters are scaled to it.
    """
    # The craft's response, and some that the data leave possible.
    drawn = np.vstack([loop.plant.response, loop.plant.draws[1:30]])
    broken = loop.attitude_loop(drawn)
    steps = _steps(loop.hz, {"rate": loop.rate_transfer(drawn), "attitude": broken / (1.0 + broken)})
    return (*_at_mixer(loop), *_at_attitude(loop, broken, size), *steps)


def _at_mixer(loop: RateLoop) -> Iterator[Criterion]:
    margins = loop.margins
    limits = {"gain_db": (6.0, True, _MIL), "phase_deg": (45.0, True, _MIL), "peak_db": (6.0, False, "Ms of 2")}
    names = {"gain_db": "gain margin", "phase_deg": "phase margin", "peak_db": "disturbance rejection peak"}
    names |= {"crossover_hz": "crossover", "rejection_hz": "disturbance rejection bandwidth"}
    for name in MARGINS:
        limit, least, source = limits.get(name, (None, True, ""))
        yield _criterion(f"{names[name]} at the mixer", getattr(margins, name), limit, least, source)


def _at_attitude(loop: RateLoop, broken: Complexes, size: float | None) -> Iterator[Criterion]:
    """Yield those of the attitude loop broken at the attitude, and of how the attitude follows its target."""
    scale = 1.0 if size is None else float(np.sqrt(_REFERENCE / size))
    scaled = ", unscaled" if size is None else f", times {scale:.2g} (Froude, Ivler and Geyer 2024)"
    margins = margins_of(loop.hz, broken)
    turn = 2.0 * np.pi
    yield _criterion("phase margin of the attitude", _known(margins.phase_deg, "deg"), 45.0, True, _MIL)
    bandwidth = _known(turn * margins.rejection_hz, "rad/s")
    least = scale * _REJECTION[loop.axis]
    yield _criterion("disturbance rejection bandwidth at the attitude", bandwidth, least, True, _HOLD + scaled)
    yield _criterion("disturbance rejection peak at the attitude", _known(margins.peak_db, "dB"), 5.0, False, _HOLD)
    closed = broken / (1.0 + broken)
    at_135, (at_180, twice) = lagging(loop.hz, closed, -0.75 * np.pi)[0], lagging(loop.hz, closed, -np.pi)
    yield _criterion(
        "attitude bandwidth", _known(turn * at_135, "rad/s"), scale * 2.0, True, f"ADS-33E-PRF, 3.3.2.1{scaled}"
    )
    late = -(twice + np.pi) / (2.0 * turn * at_180)
    yield _criterion("bandwidth of the attitude, 3 dB", _known(turn * _falling(loop.hz, closed), "rad/s"))
    yield _criterion("phase delay of the attitude", _known(late, "s"))


def _steps(hz: Floats, transfers: Mapping[str, Complexes]) -> Iterator[Criterion]:
    for what, transfer in transfers.items():
        rise, over, settling = step_numbers(hz, transfer)
        yield _criterion(f"rise time of a step of {what}", _known(rise, "s"))
        yield _criterion(f"overshoot of a step of {what}", _known(over, "%"))
        yield _criterion(f"settling time of a step of {what}", _known(settling, "s"))


def identified(loop: RateLoop) -> Iterator[Criterion]:
    """Yield what the identification is worth: coherence, cost, bounds and insensitivities of the fitted parameters."""
    crossover = loop.with_settings(loop.flown).margins.crossover_hz.value
    if crossover is not None:
        near = (loop.hz > 0.4 * crossover) & (loop.hz < 1.6 * crossover) & (loop.hz <= loop.plant.seen)
        least = float(loop.plant.coherence[near].min()) if near.any() else None
        value = Parameter(least, None, "1", "" if near.any() else "the crossover lies beyond what was measured")
        yield _criterion("coherence around the crossover", value, 0.6, True, _TISCHLER)
    try:
        model = fit(loop.frf)
    except FrequencyError as error:
        yield _criterion("cost J", Parameter(None, None, "1", str(error)), 100.0, False, _TISCHLER)
        return
    yield _criterion("cost J", Parameter(model.cost, None, "1"), 100.0, False, _TISCHLER)
    gain = model.parameters["gain"]
    if gain.value and gain.sigma:
        forward = Parameter(1.0 / gain.value, gain.sigma / gain.value**2, "s^2/rad")
        yield _criterion("D_FF that turns what is asked for (1 / gain)", forward)
    stated = {name: one for name in model.names if (one := model.parameters[name]).value and one.sigma}
    bounds = [100.0 * one.sigma / abs(one.value) for one in stated.values() if one.value and one.sigma]
    blind = [100.0 * float(part) for name, part in zip(model.names, model.insensitivity, strict=True) if name in stated]
    reason = "" if stated else "no parameter is determined"
    for name, values, limit in (("Cramer-Rao bound", bounds, 20.0), ("insensitivity", blind, 10.0)):
        worst = Parameter(max(values, default=None), None, "%", reason)
        yield _criterion(f"largest {name} of {', '.join(stated) or 'parameters'}", worst, limit, False, _TISCHLER)


def _known(drawn: Floats, unit: str) -> Parameter:
    """Return a number from its values of the best estimate and of draws, the best estimate first."""
    value, finite = float(drawn[0]), drawn[np.isfinite(drawn)]
    if not np.isfinite(value) or len(finite) < 0.5 * len(drawn):
        return Parameter(None, None, unit, "the measured band does not show it")
    return Parameter(value, float(np.std(finite)), unit)


def _falling(hz: Floats, closed: Complexes) -> Floats:
    """Return the frequency from which on each response stays 3 dB below one, shape (K,); NaN where none does."""
    above = np.abs(closed) >= np.sqrt(0.5)
    last = closed.shape[1] - 1 - np.argmax(above[:, ::-1], axis=1)
    return np.where(above.any(axis=1) & ~above[:, -1], hz[last], np.nan)


def step_numbers(hz: Floats, transfer: Complexes) -> tuple[Floats, Floats, Floats]:
    """Return rise from 10 to 90 % [s], overshoot [%] and settling within 5 % [s] of unit steps, shape (K,) each.

    `transfer` (K, n) at `hz` (n,): one at rest, dying out beyond the band.
    """
    grid = np.arange(0.0, 120.0, 0.05)
    spectrum = np.array([beyond_band(grid, hz, known) for known in transfer])
    steps = np.cumsum(np.fft.irfft(spectrum, axis=1), axis=1)[:, : len(grid)]
    dt = 0.5 / grid[-1]
    rise, settling = np.empty(len(steps)), np.empty(len(steps))
    for k, step in enumerate(steps):
        reached = step.max() >= 0.9
        rise[k] = dt * float(np.argmax(step >= 0.9) - np.argmax(step >= 0.1)) if reached else np.nan
        outside = np.flatnonzero(np.abs(step - 1.0) > 0.05)
        settles = len(outside) > 0 and outside[-1] + 1 < len(step)
        settling[k] = dt * float(outside[-1] + 1) if settles else np.nan
    return rise, 100.0 * np.maximum(steps.max(axis=1) - 1.0, 0.0), settling


def beyond_band(grid: Floats, hz: Floats, transfer: Complexes) -> Complexes:
    """Return a transfer function known on a band, (n,), at a grid from 0 Hz on: one at rest, dying out beyond."""
    whole = np.interp(grid, hz, transfer.real) + 1j * np.interp(grid, hz, transfer.imag)
    low, high = grid < hz[0], grid > hz[-1]
    share = grid[low] / hz[0]
    whole[low] = 1.0 + share * 1j * transfer[0].imag + share**2 * (transfer[0].real - 1.0)
    whole[high] = transfer[-1] * (hz[-1] / grid[high]) ** 2
    return np.asarray(whole, np.complex128)
