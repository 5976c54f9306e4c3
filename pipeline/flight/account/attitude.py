"""Whether the craft did what was asked of its attitude: control lost, yaw lost, oscillation."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate

import numpy as np
import pandas as pd

from core.catalogue import finding
from core.findings import Happening
from logparse.tables import between
from pipeline.flight.account.readings import BLIND, Readings, stretches
from pipeline.flight.account.vibration import Floats

#: Control is lost with an error of 30 deg for a second (ArduCopter's crash check), twice as far for a quarter of one,
#: or swings of 30 to 50 deg again and again (5-12-2014_218 at 356 s), beyond 10 deg that all craft are off [rad^2 s].
_TOLERATED, _HELPLESS = np.radians(10.0), np.radians(30.0) ** 2 - np.radians(10.0) ** 2
#: Rate [rad/s] by which a craft turns faster than asked, or against it, and for how long [s], when yaw is lost: a yaw
#: stick let go leaves a craft turning for about a second.
_YAW_EXCESS, _YAW_TIME = 1.5, 1.2
#: Oscillation: windows [s], lowest frequency [Hz], amplitude of the rate [rad/s], part of the power above that
#: frequency in one line, how many times the same line in the rate asked for, and for how long [s] at least: sticks
#: thrown about (29-09-2014_2) swing a craft for a window or two.
_WINDOW, _LOWEST, _AMPLITUDE, _PURITY, _UNASKED, _LASTING = 2.0, 2.0, np.radians(20.0), 0.6, 1.5, 3.0
#: Slowest rates [Hz] in which an oscillation can be seen, and fastest swings of sticks [Hz]: 3.5 in 6-3-2014_7.
_SLOWEST, _STICKS = 20.0, 5.0


def attitude_happenings(readings: Readings) -> Iterator[Happening]:
    """Yield what went wrong with the attitude in flight."""
    yield from _lost(readings)
    yield from _yaw(readings)
    yield from _oscillations(readings)


def _lost(readings: Readings) -> Iterator[Happening]:
    error = readings.attitude_error
    if error is None or len(error) < 3:
        return
    t, off = error.index.to_numpy(np.float64), error.to_numpy(np.float64)
    off = np.where(readings.flying(t), np.nan_to_num(off), 0.0)
    # What one row alone says is not believed, nor the time between rows in which a stick thrown about is not seen.
    beside = np.pad(off, 1)
    twice = np.minimum(off, np.maximum(beside[:-2], beside[2:]))
    gained = (twice**2 - _TOLERATED**2) * np.minimum(np.gradient(t), BLIND)
    gained[np.diff(t, prepend=t[0]) > BLIND] = -np.inf
    # Page's sum: what was off beyond what is tolerated, since it was last nothing.
    total = np.fromiter(accumulate(gained, lambda before, more: max(before + more, 0.0)), np.float64)
    on = np.flatnonzero(total > 0.0)
    for run in np.split(on, np.flatnonzero(np.diff(on) > 1) + 1):
        if not len(run) or total[run].max() < _HELPLESS:
            continue
        last = int(run[np.argmax(total[run])])
        rows = slice(int(run[0]), last + 1)
        worst, swings = float(off[rows].max()), len(stretches(t[rows], off[rows] > _TOLERATED, join=0.0))
        yield finding(
            "control-lost",
            f"The craft {'swung' if swings > 2 else 'leaned'} up to {np.degrees(worst):.0f}° away from what was asked"
            f" for {t[last] - t[rows.start]:.1f} s{_with(readings.at_limits(t[rows.start], t[last]))}.",
            t=float(t[rows.start]),
            end=float(t[last]),
            worst_rad=worst,
        )


def _with(limits: str) -> str:
    return f", {limits}" if limits else ""


def _yaw(readings: Readings) -> Iterator[Happening]:
    """Find times in which the craft turned faster than asked, or against it, for longer than a stick needs."""
    columns = list(readings.tables.columns("rates", ("w_z", "w_z_ref")))
    if len(columns) < 2:
        return
    both = [column.to_numpy(np.float64) for column in columns]
    known = np.isfinite(both[0]) & np.isfinite(both[1])
    t = columns[0].index.to_numpy(np.float64)[known]
    flown, asked = (column[known] for column in both)
    excess = np.where(flown * asked >= 0.0, np.abs(flown) - np.abs(asked), np.abs(flown - asked))
    on = readings.flying(t) & (excess > _YAW_EXCESS)
    for first, last, rows in stretches(t, on, join=0.3, shortest=_YAW_TIME):
        worst = float(np.max(excess[rows]))
        yield finding(
            "yaw-lost",
            f"Yaw ran away by up to {np.degrees(worst):.0f}°/s for {last - first:.1f} s"
            f"{_with(readings.at_limits(first, last))}.",
            t=first,
            end=last,
            excess_rad_s=worst,
        )


def _oscillations(readings: Readings) -> Iterator[Happening]:
    """Find stretches in which a rate swings at one frequency without being asked to."""
    for axis, name in (("x", "roll"), ("y", "pitch"), ("z", "yaw")):
        # One axis at a time: all columns of a fast loop together are nearly as large as the log.
        flown = _rate(readings, axis)
        if flown is None:
            continue
        lines = _lines(readings, *flown, axis)
        if not len(lines):
            continue
        t, hz, amplitude = lines.T
        swinging = (amplitude > 0.0) & ~readings.chirped(t)
        for first, last, rows in stretches(t, swinging, join=1.1 * _WINDOW, shortest=_LASTING):
            strength, frequency = (float(np.median(series[rows][amplitude[rows] > 0.0])) for series in (amplitude, hz))
            yield finding(
                "oscillation",
                f"The craft oscillated in {name} at {frequency:.1f} Hz with {np.degrees(strength):.0f}°/s.",
                t=first - 0.5 * _WINDOW,
                end=last + 0.5 * _WINDOW,
                axis=name,
                frequency_hz=frequency,
                amplitude_rad_s=strength,
            )


def _rate(readings: Readings, axis: str) -> tuple[Floats, Floats] | None:
    """Time and angular rate of an axis from the fastest table that has it."""
    for table, column in (("rates", f"w_{axis}"), ("imu", f"gyro_{axis}")):
        frame = next(readings.tables.columns(table, (column,)), None)
        if frame is None:
            continue
        inside = between(frame, readings.flight.start + 1.0, readings.flight.stop - 0.5).dropna()
        t = inside.index.to_numpy(np.float64)
        if len(t) > 10 and 1.0 / float(np.median(np.diff(t))) >= _SLOWEST:
            return np.asarray(t), np.asarray(inside.to_numpy(np.float64))
    return None


def _asked(readings: Readings, axis: str) -> tuple[pd.Series[float] | None, int]:
    """Return the rate that was asked for, of logs without it the angle, and how often that is to be differentiated."""
    names = {"x": (("rates", "w_x_ref"), ("setpoints", "roll")), "y": (("rates", "w_y_ref"), ("setpoints", "pitch"))}
    for order, (table, name) in enumerate(names.get(axis, (("rates", "w_z_ref"),))):
        asked = readings.tables.column(table, name)
        if asked is not None and len(known := asked.dropna()) > 10:
            return known, order
    return None, 0


def _lines(readings: Readings, t: Floats, flown: Floats, axis: str) -> Floats:
    """Middle [s], frequency [Hz] and amplitude [rad/s] of each window, 0 where no line stands out unasked."""
    dt = float(np.median(np.diff(t)))
    size = round(_WINDOW / dt)
    grid = np.arange(t[0], t[-1], dt)
    count = 1 + (len(grid) - size) // (size // 2) if size >= 8 and len(grid) >= size else 0
    if count < 1:
        return np.empty((0, 3))
    power = _spectra(np.interp(grid, t, flown), size, count)
    hz = np.fft.rfftfreq(size, dt)
    band = hz >= _LOWEST
    if np.count_nonzero(band) < 4:
        return np.empty((0, 3))
    power = np.where(band, power, 0.0)
    peak = hz[np.argmax(power, axis=1)]
    # A line within a window of Hann is five wide.
    near = np.abs(hz[None, :] - peak[:, None]) <= 2.0 * hz[1]
    line = np.sum(np.where(near, power, 0.0), axis=1)
    amplitude = np.sqrt(2.0 * line)
    # What is strongest at the lowest frequency is the edge of slower motion, and no line.
    edge = peak <= hz[band][0]
    amplitude[edge | (amplitude < _AMPLITUDE) | (line < _PURITY * np.sum(power, axis=1))] = 0.0
    asked, order = _asked(readings, axis) if amplitude.any() else (None, 0)
    # Slower swings than a pilot's may be asked for where nothing tells what was.
    resolved = 0.0 if asked is None else 0.4 / float(np.median(np.diff(asked.index.to_numpy(np.float64))))
    amplitude[(peak < _STICKS) & (peak > resolved)] = 0.0
    if asked is not None:
        wanted = _spectra(np.interp(grid, asked.index.to_numpy(np.float64), asked.to_numpy(np.float64)), size, count)
        wanted *= (2.0 * np.pi * hz) ** (2 * order)
        amplitude[line < _UNASKED**2 * np.sum(np.where(near & band, wanted, 0.0), axis=1)] = 0.0
    return np.column_stack([grid[np.arange(count) * (size // 2)] + 0.5 * _WINDOW, peak, amplitude])


def _spectra(values: Floats, size: int, count: int) -> Floats:
    """Power of each line in half-overlapping windows; their sum is the variance. Shape (count, size // 2 + 1)."""
    rows = np.lib.stride_tricks.sliding_window_view(values, size)[:: size // 2][:count]
    hann, linear = np.hanning(size + 1)[:-1], np.linspace(-1.0, 1.0, size)
    power = np.empty((count, size // 2 + 1))
    for first in range(0, count, 1024):  # as a whole they are several times the signal
        piece = rows[first : first + 1024]
        flat = piece - piece.mean(axis=1, keepdims=True)
        flat = flat - (flat @ linear / (linear @ linear))[:, None] * linear
        power[first : first + 1024] = 2.0 * np.abs(np.fft.rfft(flat * hann, axis=1)) ** 2 / (size * np.sum(hann**2))
    return power
