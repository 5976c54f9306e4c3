"""Spectrum of a flight's vibration: peaks, what the rotors have to do with them, and where the notches lie."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from logparse import Tables
from pipeline.results.signals import Notch, Peak, Spectrum
from pipeline.results.span import Span
from sysid.loops.settings import NOTCHES, notch_frequency
from sysid.records.filtering import densities, welch

Floats = NDArray[np.float64]

#: Windows that are transformed at a time.
_AT_ONCE = 64
#: Slowest samples that a spectrum is made of [Hz], its resolution [Hz], and fewest samples of a burst.
_FAST, _RESOLUTION, _BURST = 90.0, 1.0, 512
#: Lowest frequency that is shown, and lowest that may be vibration, Hz: below, the craft moves.
_SHOWN, _LOWEST = 5.0, 15.0
#: A peak stands out by so much above the median of its neighbourhood (a part of its frequency to either side).
_STANDS_OUT, _NEIGHBOURS = 3.0, 0.3
#: Least amplitude of a line that is named, rad/s (0.3 deg/s).
_LEAST = 0.005
#: Most peaks that are named, and multiples of the rotors' speed that are looked for.
_MOST, _MULTIPLES = 5, 4
#: Correlation of a line's frequency with the motors' outputs that makes it a rotor's, and fewest windows that tell.
_FOLLOWS, _FEWEST = 0.6, 15

_AXES = {"roll": "gyro_x", "pitch": "gyro_y", "yaw": "gyro_z"}


class _Windows(NamedTuple):
    """Spectra of short stretches."""

    source: str
    t: Floats  #: shape (n,): Middle, s.
    hz: Floats  #: shape (m,)
    power: Mapping[str, Floats]  #: shape (n, m): By axis, per hertz.


def vibration_spectrum(tables: Tables, flight: Span, parameters: Mapping[str, float]) -> Spectrum | None:
    """Transform bursts of the batch sampler, or the gyro where it was logged fast enough; None where neither was."""
    windows = _bursts(tables, flight) or _logged(tables, flight)
    if windows is None:
        return None
    shown = windows.hz >= _SHOWN
    hz, width = windows.hz[shown], float(windows.hz[1] - windows.hz[0])
    amplitudes = {axis: np.sqrt(2.0 * power.mean(axis=0)[shown] * width) for axis, power in windows.power.items()}
    rotors = rotor_speeds(tables, flight)
    notches = tuple(notch for notch in _notches(parameters, tables, flight, rotors) if notch.low <= hz[-1])
    cutoff = next((parameters[name] for name in ("INS_GYRO_FILTER", "IMU_GYRO_CUTOFF") if name in parameters), 0.0)
    name = "INS_GYRO_FILTER" if "INS_GYRO_FILTER" in parameters else "IMU_GYRO_CUTOFF"
    return Spectrum(
        source=windows.source,
        unit="rad/s",
        hz=hz,
        amplitudes=amplitudes,
        filters={name: cutoff} if _SHOWN <= cutoff <= hz[-1] else {},
        rotors_hz=rotors,
        notches=notches,
        peaks=_peaks(hz, amplitudes, windows, tables, rotors, notches),
    )


def _bursts(tables: Tables, flight: Span) -> _Windows | None:
    for table in tables.others("gyro_batch"):
        inside = table.loc[flight.start : flight.stop]
        spectra: list[tuple[float, Floats, dict[str, Floats]]] = []
        for _, burst in inside.groupby("batch"):
            t = burst.index.to_numpy(np.float64)
            if len(t) < _BURST:
                continue
            rate = 1.0 / float(np.median(np.diff(t)))
            spectra.append((float(t.mean()), *_power(burst, rate, len(t))))
        grids = [hz for _, hz, _ in spectra]
        alike = [
            spectrum
            for spectrum in spectra
            if len(spectrum[1]) == len(grids[0]) and abs(spectrum[1][1] - grids[0][1]) < 0.5
        ]
        if alike:
            rate = 2.0 * grids[0][-1]
            return _joined(f"gyro, {len(alike)} bursts at {rate:.0f} Hz", alike)
    return None


def _logged(tables: Tables, flight: Span) -> _Windows | None:
    if tables.imu is None:
        return None
    inside = tables.imu.iloc[flight.rows(tables.imu.index)].dropna()
    if len(inside) < 512:
        return None
    t = inside.index.to_numpy(np.float64)
    rate = 1.0 / float(np.median(np.diff(t)))
    if rate < _FAST:
        return None
    size = round(rate / _RESOLUTION)
    begins = np.arange(0, len(t) - size + 1, size // 2)
    begins = begins[t[begins + size - 1] - t[begins] < 1.2 * size / rate]
    if not len(begins):
        return None
    hz = np.fft.rfftfreq(size, 1.0 / rate).astype(np.float64)
    gyros = {axis: inside[column].to_numpy(np.float64) for axis, column in _AXES.items()}
    power = {axis: _densities(signal, begins, size, rate) for axis, signal in gyros.items()}
    middles = np.lib.stride_tricks.sliding_window_view(t, size)[begins].mean(axis=1)
    return _Windows(f"gyro as logged, {rate:.0f} Hz, behind the autopilot's filters", middles, hz, power)


def _densities(signal: Floats, begins: NDArray[np.intp], size: int, rate: float) -> Floats:
    """Estimate the spectrum of each window, some at a time: all at once take twice the memory of a long log."""
    windows = np.lib.stride_tricks.sliding_window_view(signal, size)
    return np.concatenate([densities(windows[begins[k : k + _AT_ONCE]], rate) for k in range(0, len(begins), _AT_ONCE)])


def _power(table: pd.DataFrame, rate: float, size: int) -> tuple[Floats, dict[str, Floats]]:
    powers: dict[str, Floats] = {}
    hz: Floats = np.zeros(0)
    for axis, column in _AXES.items():
        values = table[column].to_numpy(np.float64)
        hz, powers[axis] = welch(values - values.mean(), rate, min(size, len(values)))
    return hz, powers


def _joined(source: str, spectra: list[tuple[float, Floats, dict[str, Floats]]]) -> _Windows:
    times = np.array([t for t, _, _ in spectra])
    return _Windows(
        source, times, spectra[0][1], {axis: np.array([power[axis] for _, _, power in spectra]) for axis in _AXES}
    )


def rotor_speeds(tables: Tables, flight: Span) -> tuple[float, float] | None:
    """Return the speeds between which the rotors turned nine tenths of the time by ESC telemetry, Hz."""
    if tables.esc is None:
        return None
    speeds = tables.esc.loc[flight.start : flight.stop].filter(regex=r"^w\d+$").to_numpy(np.float64)
    speeds = speeds[np.isfinite(speeds) & (speeds > 1.0)] / (2.0 * np.pi)
    return (float(np.percentile(speeds, 5.0)), float(np.percentile(speeds, 95.0))) if len(speeds) > 20 else None


def _notches(
    parameters: Mapping[str, float], tables: Tables, flight: Span, rotors: tuple[float, float] | None
) -> Iterator[Notch]:
    """Yield the bands of enabled notches: fixed ones, and those that follow throttle or ESC telemetry."""
    asked = tables.column("setpoints", "throttle")
    throttle = np.zeros(0) if asked is None else asked.iloc[flight.rows(asked.index)].dropna().to_numpy(np.float64)
    throttles = (
        [float(value) for value in np.percentile(throttle, [5.0, 95.0]).clip(0.0)] if len(throttle) > 10 else None
    )
    for prefix in ("INS_NOTCH_", *NOTCHES, "IMU_GYRO_NF0_", "IMU_GYRO_NF1_"):
        px4 = prefix.startswith("IMU")
        enabled = px4 or any(parameters.get(f"{prefix}{word}", 0.0) > 0.0 for word in ("ENABLE", "ENA"))
        centre = parameters.get(f"{prefix}{'FRQ' if px4 else 'FREQ'}", 0.0)
        if not enabled or not centre > 0.0:
            continue
        width = parameters.get(f"{prefix}BW", 0.5 * centre) / centre
        followed = zip(throttles or (None, None), rotors or (None, None), strict=True)
        low, high = (centre if px4 else notch_frequency(parameters, prefix, *pair) for pair in followed)
        bits = round(parameters.get(f"{prefix}HMNCS", 1.0)) if prefix in NOTCHES else 1
        name = prefix.rstrip("_")
        for multiple in (k + 1 for k in range(8) if bits >> k & 1):
            label = name if multiple == 1 else f"{name} × {multiple}"
            yield Notch(label, multiple * low * (1.0 - 0.5 * width), multiple * high * (1.0 + 0.5 * width))


def _peaks(
    hz: Floats,
    amplitudes: Mapping[str, Floats],
    windows: _Windows,
    tables: Tables,
    rotors: tuple[float, float] | None,
    notches: tuple[Notch, ...],
) -> tuple[Peak, ...]:
    """Find what stands out of its neighbourhood on any axis, the strongest first, and name what it comes from."""
    candidates: list[tuple[float, float, str]] = []
    for axis, amplitude in amplitudes.items():
        for k in range(1, len(hz) - 1):
            if hz[k] < _LOWEST or amplitude[k] < max(_LEAST, amplitude[k - 1], amplitude[k + 1]):
                continue
            near = np.abs(hz - hz[k]) <= _NEIGHBOURS * hz[k]
            if amplitude[k] >= _STANDS_OUT * float(np.median(amplitude[near])):
                candidates.append((float(amplitude[k]), float(hz[k]), axis))
    width = max(3.0 * float(hz[1] - hz[0]), 2.0)
    peaks: list[Peak] = []
    for strength, where, axis in sorted(candidates, reverse=True):
        if len(peaks) < _MOST and all(abs(where - peak.hz) > width for peak in peaks):
            multiple = _multiple(where, rotors, width)
            if not multiple and rotors is None and _follows(where, axis, windows, tables):
                multiple = 1
            covered = next((notch.name for notch in notches if notch.low <= where <= notch.high), "")
            peaks.append(Peak(hz=where, amplitude=strength, axis=axis, rotor_multiple=multiple, notch=covered))
    return tuple(peaks)


def _multiple(where: float, rotors: tuple[float, float] | None, width: float) -> int:
    """Return which multiple of the rotors' speed a frequency is; 0 where none."""
    if rotors is None:
        return 0
    tolerance = 0.5 * width
    return next(
        (k for k in range(1, _MULTIPLES + 1) if k * rotors[0] - tolerance <= where <= k * rotors[1] + tolerance), 0
    )


def _follows(where: float, axis: str, windows: _Windows, tables: Tables) -> bool:
    """Return whether the frequency of a line goes with the motors' outputs, as rotors do and frames do not."""
    if tables.motors is None or len(windows.t) < _FEWEST:
        return False
    near = (windows.hz >= 0.7 * where) & (windows.hz <= 1.4 * where)
    line = windows.hz[near][np.argmax(windows.power[axis][:, near], axis=1)]
    outputs = tables.motors.mean(axis=1)
    asked = np.interp(windows.t, outputs.index.to_numpy(np.float64), outputs.to_numpy(np.float64))
    if not (np.std(line) > 0.0 and np.std(asked) > 0.0):
        return False
    return bool(np.corrcoef(line, asked)[0, 1] >= _FOLLOWS)
