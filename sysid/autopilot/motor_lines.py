"""Spectral lines of the motors in raw gyro batches (ISBH, ISBD): frequency in hover, harmonics, and throttle exponent.

A batch is about a second of the gyro at its full rate before the autopilot's filters, one every two seconds or so.
Motors with equal outputs turn at nearly equal speeds, so their sines add or cancel for seconds: the fundamental can be
weaker than its harmonic, and it takes many batches to find it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from core.robust import robust_sigma
from logparse import FlightLog, RotoridError
from sysid.loops.filters import NOTCH_LIMIT
from sysid.records import Floats
from sysid.records.filtering import welch

#: Largest relative variation of throttle within a steady batch, and largest relative deviation from hover throttle.
_STEADY, _HOVER_BAND = 0.03, 0.08

#: Lowest frequency of a motor's line, Hz; below is motion of the craft.
_LOWEST = 20.0

#: Least power of a line over the median around it, and half-width of that surrounding band relative to its frequency.
_PROMINENCE, _SURROUNDING = 20.0, 0.3

#: Least power of a line relative to the strongest, and least amplitude, rad/s (0.1 deg/s).
_LEAST_POWER, _LEAST_AMPLITUDE = 0.02, 0.0017

#: Half-width of a line, relative to its frequency and in steps of the spectrum.
_WIDTH, _STEPS = 0.03, 2.0

#: Throttle exponents that are tried, and sigma beyond which the exponent is not determined.
_EXPONENTS = np.linspace(0.0, 1.2, 25)
_UNDETERMINED = 0.15

#: Fewest steady batches; most harmonics.
_FEWEST, _HARMONICS = 4, 4


class LineError(RotoridError):
    """The batches do not show the motors' lines."""


class NoBatchesError(LineError):
    """There are no batches of the gyro."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Spectrum of one batch of the gyro."""

    start: float  #: s on the log's clock.
    stop: float
    throttle: float  #: Mean throttle output.
    steady: bool  #: Whether the throttle was nearly constant.
    rate: float  #: Samples per second.
    hz: Floats  #: shape (m,)
    power: Floats  #: shape (3, m): Density about x, y, z, (rad/s)^2/Hz.

    @property
    def step(self) -> float:
        """Resolution, Hz."""
        return float(self.hz[1])


@dataclass(frozen=True, slots=True, eq=False)
class MotorLines:
    """The motors' spectral lines in a flight."""

    steady: tuple[Batch, ...]  #: Batches of steady throttle.
    batches: tuple[Batch, ...]  #: Those of them in hover.
    hover: float  #: Throttle of hover.
    hz: float  #: Fundamental in hover.
    sigma: float
    harmonics: tuple[int, ...]  #: Those found, 1 for the fundamental.
    exponent: float  #: Frequency goes with throttle to this power; the firmware's notch assumes 0.5.
    exponent_sigma: float
    quantum: float  #: Resolution of the batches' samples, rad/s.


def gyro_batches(log: FlightLog) -> tuple[tuple[Batch, ...], tuple[Batch, ...], float]:
    """Return batches of the gyro in use before and after the filters, and the quantum of their samples, rad/s.

    Raises LineError without batches of that gyro from before its filters.
    """
    name, parameters, flight = log.name, log.parameters_flown, log.flight
    tables = log.tables.others("gyro_batch")
    if not tables or flight is None:
        only = " (those of the accelerometer do not tell the gyro's noise)" if "ISBH" in log.messages else ""
        raise NoBatchesError(f"{name}: no raw gyro batches{only}; fly with INS_LOG_BAT_MASK 1, INS_LOG_BAT_OPT 4")
    heads = log.messages["ISBH"]
    gyro = heads[heads["type"] == 1]
    instances = [int(instance) for instance in sorted(gyro["instance"].unique())]
    option = int(parameters.get("INS_LOG_BAT_OPT", 0.0))
    if option & 2:
        raise LineError(f"{name}: the batches are behind the filters (INS_LOG_BAT_OPT {option}); fly with 0 or 4")
    # Where both are logged, the instances after the filters follow those before them.
    raw = instances[: len(instances) // 2] if option & 4 and len(instances) > 1 else instances
    used = next((k for k, flag in enumerate(("INS_USE", "INS_USE2", "INS_USE3")) if parameters.get(flag, 1.0)), 0)
    if used not in raw:
        raise LineError(
            f"{name}: the batches are of IMU {raw[0] + 1}, and the loops fly on IMU {used + 1}; set "
            f"INS_LOG_BAT_MASK {1 << used}"
        )
    place = raw.index(used)
    filtered = tables[len(raw) + place :][:1] if len(raw) < len(instances) else ()
    throttle = log.tables.column("setpoints", "throttle")
    if throttle is None or throttle.notna().sum() < 2:
        raise LineError(f"{name}: no throttle output (CTUN), which the notch would follow")
    before, *after = (
        _spectra(table.loc[flight.start : flight.stop], throttle.dropna()) for table in (tables[place], *filtered)
    )
    return before, (after[0] if after else ()), 1.0 / float(np.median(gyro["mul"]))


def _spectra(table: pd.DataFrame, throttle: pd.Series[float]) -> tuple[Batch, ...]:
    """Compute the spectrum of each batch of a table, with the throttle during it."""
    batches = []
    for _, part in table.groupby("batch"):
        times = part.index.to_numpy(np.float64)
        if len(times) < 512:
            continue
        rate = 1.0 / float(np.median(np.diff(times)))
        samples = part[["gyro_x", "gyro_y", "gyro_z"]].to_numpy(np.float64).T
        hz, power = welch(samples, rate, len(times))
        during = np.interp(np.linspace(times[0], times[-1], 11), throttle.index.to_numpy(np.float64), throttle)
        steady = bool(np.std(during) < _STEADY * np.mean(during))
        batches.append(Batch(times[0], times[-1], float(during.mean()), steady, rate, hz, power))
    return tuple(batches)


def motor_lines(log: FlightLog, batches: Sequence[Batch], quantum: float) -> MotorLines:
    """Find the motors' lines in batches of one flight.

    Raises LineError where no line is found, none goes with throttle, or they drift at equal throttle.
    """
    steady = [batch for batch in batches if batch.steady]
    if len(steady) < _FEWEST:
        raise LineError(f"{log.name}: {len(steady)} batches of steady throttle; hover for half a minute")
    hover = float(np.median([batch.throttle for batch in steady]))
    hovering = tuple(batch for batch in steady if abs(batch.throttle / hover - 1.0) < _HOVER_BAND)
    hz = hovering[0].hz
    mean = np.mean([batch.power.sum(axis=0) for batch in hovering if len(batch.hz) == len(hz)], axis=0)
    candidates = _peaks(hz, mean, hovering[0].rate)
    if not candidates:
        raise LineError(f"{log.name}: no line stands out of the gyro's noise, so that no notch is needed")
    reason = ""
    for candidate in candidates:
        harmonics = tuple(k for k in range(1, _HARMONICS + 1) if _near(k * candidate, candidates))
        times, throttles, lines = _tracked(steady, candidate, harmonics, hover)
        if len(lines) < _FEWEST:
            continue
        values, sigma = _fitted(times, throttles, lines, hover)
        if sigma[1] > _UNDETERMINED:
            reason = reason or f"the line at {candidate:.0f} Hz was not seen at other throttles; climb and descend"
        elif values[1] > 4.0 * sigma[1]:
            drift = float(values[2] * (steady[-1].stop - steady[0].start))
            if abs(drift) > _WIDTH and abs(values[2]) > 4.0 * sigma[2]:
                raise LineError(
                    f"{log.name}: at equal throttle the motors' line moved by {100.0 * drift:.0f} % through the "
                    "flight, as with a battery that sags: a notch on throttle would miss it; log ESC telemetry"
                )
            fundamental = float(np.exp(values[0]))
            return MotorLines(
                steady=tuple(steady),
                batches=hovering,
                hover=hover,
                hz=fundamental,
                sigma=float(np.hypot(fundamental * sigma[0], 0.1 * hovering[0].step)),
                harmonics=harmonics,
                exponent=float(values[1]),
                exponent_sigma=float(sigma[1]),
                quantum=quantum,
            )
        else:
            reason = reason or f"the line at {candidate:.0f} Hz does not go with throttle: a mode of the frame"
    raise LineError(f"{log.name}: {reason or f'no line is seen in {_FEWEST} of its {len(steady)} steady batches'}")


def _peaks(hz: Floats, power: Floats, rate: float) -> list[float]:
    """Return the frequencies of the lines of a spectrum, the lowest first."""
    inside = np.flatnonzero((hz >= _LOWEST) & (hz <= NOTCH_LIMIT * rate))
    lines: list[tuple[float, float]] = []
    for k in inside:
        wide = max(_WIDTH * hz[k], _STEPS * hz[1])
        line, around = np.abs(hz - hz[k]) <= wide, np.abs(hz - hz[k]) <= _SURROUNDING * hz[k]
        if power[k] == power[line].max() and power[k] > _PROMINENCE * np.median(power[around]):
            total = float(power[line].sum() * hz[1])
            if total > _LEAST_AMPLITUDE**2:
                lines.append((float(hz[line] @ power[line] / power[line].sum()), total))
    strongest = max((total for _, total in lines), default=0.0)
    return [frequency for frequency, total in lines if total > _LEAST_POWER * strongest]


def _near(frequency: float, lines: Sequence[float]) -> bool:
    return any(abs(line / frequency - 1.0) < _WIDTH for line in lines)


def _tracked(
    batches: Sequence[Batch], hover_hz: float, harmonics: Sequence[int], hover: float
) -> tuple[Floats, Floats, Floats]:
    """Return time, throttle and fundamental of the batches that show the lines where their throttle predicts them."""

    def peaks(batch: Batch, exponent: float) -> list[tuple[float, float]]:
        """Return prominence and fundamental by each harmonic."""
        found = []
        total = batch.power.sum(axis=0)
        for k in harmonics:
            predicted = k * hover_hz * (batch.throttle / hover) ** exponent
            wide = max(_WIDTH * predicted, _STEPS * batch.step)
            line = np.flatnonzero(np.abs(batch.hz - predicted) <= wide)
            around = np.abs(batch.hz - predicted) <= _SURROUNDING * predicted
            if len(line) and line[-1] + 1 < len(total):
                part = total[line]
                prominence = float(part.max() / np.median(total[around]))
                found.append((prominence, float(batch.hz[line] @ part / part.sum()) / k))
        return found

    scores = [sum(np.log(max((s for s, _ in peaks(b, p)), default=1.0)) for b in batches) for p in _EXPONENTS]
    exponent = float(_EXPONENTS[int(np.argmax(scores))])
    rows = []
    for batch in batches:
        best, fundamental = max(peaks(batch, exponent), default=(0.0, 0.0))
        if best > _PROMINENCE:
            rows.append((0.5 * (batch.start + batch.stop), batch.throttle, fundamental))
    times, throttles, lines = np.array(rows).T if rows else np.empty((3, 0))
    return times, throttles, lines


def _fitted(times: Floats, throttles: Floats, lines: Floats, hover: float) -> tuple[Floats, Floats]:
    """Fit ln f = ln F + p ln(throttle / hover) + d t robustly; return ln F, p and d with their sigmas."""
    design = np.column_stack([np.ones(len(times)), np.log(throttles / hover), times - times.mean()])
    weights = np.ones(len(times))
    for _ in range(5):
        weighted = design * weights[:, None]
        values = np.linalg.lstsq(weighted.T @ design, weighted.T @ np.log(lines), rcond=None)[0]
        residual = np.log(lines) - design @ values
        scale = max(robust_sigma(residual), 1e-4)
        weights = np.minimum(1.0, (2.0 * scale / np.maximum(np.abs(residual), 1e-9)) ** 2)
    covariance = np.linalg.pinv((design * weights[:, None]).T @ design) * scale**2
    return values, np.sqrt(np.diag(covariance))
