"""Responses of the closed loop to its targets, and how well they foretell what was flown."""

from __future__ import annotations

import numpy as np

from logparse import FlightLog
from sysid.frequency.axes import axis_of
from sysid.frequency.excitation import find_chirps
from sysid.loops.filters import Complexes, Floats
from sysid.loops.loop import RateLoop

#: Windows [s] of flown manoeuvres, and the least standard deviation [rad/s] of the rate target in one.
_WINDOW, _MOVING = 4.0, 0.08


def rate_transfer(loop: RateLoop, craft: Complexes | None = None) -> Complexes:
    """Compute measured rate per rate target with the rate loop closed and the angle loop open.

    `craft` (K, n): other responses of the craft through the flown filters, as those that the data leave possible.
    """
    plant = (loop.plant.response if craft is None else craft) * loop.gyro_change
    controller = loop.settings.controller
    forward = plant * controller.target_response(loop.hz)
    return np.asarray(forward / (1.0 + plant * controller.error_response(loop.hz)))


def attitude_loop(loop: RateLoop, craft: Complexes | None = None) -> Complexes:
    """Compute the attitude loop broken at the attitude, with the rate loop closed; `craft` as in `rate_transfer`."""
    angle = loop.settings.angle
    turned = rate_transfer(loop, craft) / loop.settings.gyro.response(loop.hz) / (2j * np.pi * loop.hz)
    return np.asarray(turned * angle.P * angle.delay_response(loop.hz))


def lagging(hz: Floats, closed: Complexes, level: float) -> Floats:
    """Return the frequency at which each response, shape (K, n), first lags by a level [deg], (K,); NaN where none."""
    phase = np.unwrap(np.angle(closed), axis=1)
    first = np.argmax(phase <= np.radians(level), axis=1)
    rows, before = np.arange(len(phase)), np.maximum(first - 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (np.radians(level) - phase[rows, before]) / (phase[rows, first] - phase[rows, before])
    return np.where(first > 0, hz[before] * (hz[first] / hz[before]) ** share, np.nan)


def attitude_bandwidth(loop: RateLoop) -> float:
    """Return the frequency, Hz, at which the attitude lags its target by 135 deg; NaN beyond the band."""
    broken = attitude_loop(loop)[None]
    return float(lagging(loop.hz, broken / (1.0 + broken), -135.0)[0])


def flown_fit(loop: RateLoop, log: FlightLog) -> float | None:
    """Return how well the loop foretells the rates of a flight from its rate targets, %; None without manoeuvres.

    Over windows outside chirps in which the target moves: 100 (1 - rms(measured - foretold) / rms(measured)), each
    less its mean.
    """
    table = log.tables.rates
    which = axis_of(loop.axis)
    if table is None or log.flight is None or not {which.output, which.reference} <= set(table.columns):
        return None
    t = table.index.to_numpy(np.float64)
    target, rate = (table[name].to_numpy(np.float64) for name in (which.reference, which.output))
    keep = (t > log.flight.start + 3.0) & (t < log.flight.stop - 3.0) & np.isfinite(target) & np.isfinite(rate)
    for chirp in find_chirps(log):
        keep &= ~((t > chirp.start - 0.5) & (t < chirp.stop + 2.0))
    if keep.sum() < 64:
        return None
    step = float(np.median(np.diff(t)))
    transfer = rate_transfer(loop)
    size = int(_WINDOW / step)
    wrong = power = 0.0
    index = np.flatnonzero(keep)
    for run in np.split(index, np.flatnonzero((np.diff(index) > 1) | (np.diff(t[index]) > 3.0 * step)) + 1):
        if len(run) < 2 * size:
            continue
        foretold = _through(target[run], step, loop.hz, transfer)
        for first in range(size // 2, len(run) - size, size):
            part = slice(first, first + size)
            if np.std(target[run][part]) < _MOVING:
                continue
            measured, own = rate[run][part], foretold[part]
            wrong += float(np.sum(((measured - measured.mean()) - (own - own.mean())) ** 2))
            power += float(np.sum((measured - measured.mean()) ** 2))
    return 100.0 * (1.0 - np.sqrt(wrong / power)) if power > 0.0 else None


def _through(values: Floats, step: float, hz: Floats, transfer: Complexes) -> Floats:
    """Pass samples through a transfer function known on a band."""
    padded = np.concatenate([np.full(256, values[0]), values, np.full(256, values[-1])])
    whole = beyond_band(np.asarray(np.fft.rfftfreq(len(padded), step), np.float64), hz, transfer)
    return np.asarray(np.fft.irfft(np.fft.rfft(padded) * whole, len(padded))[256 : 256 + len(values)])


def beyond_band(grid: Floats, hz: Floats, transfer: Complexes) -> Complexes:
    """Return a transfer function known on a band, (n,), at a grid from 0 Hz on: one at rest, dying out beyond."""
    whole = np.interp(grid, hz, transfer.real) + 1j * np.interp(grid, hz, transfer.imag)
    low, high = grid < hz[0], grid > hz[-1]
    share = grid[low] / hz[0]
    whole[low] = 1.0 + share * 1j * transfer[0].imag + share**2 * (transfer[0].real - 1.0)
    whole[high] = transfer[-1] * (hz[-1] / grid[high]) ** 2
    return np.asarray(whole, np.complex128)
