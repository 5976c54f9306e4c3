"""Lines of the motors in raw gyro batches (ISBH, ISBD): frequency in hover, harmonics, and how throttle moves them.

Batches are a second of the gyro at its full rate before the autopilot's filters, one in two seconds or so. Motors whose
outputs are equal turn alike, so that their sines add or cancel for seconds: the fundamental can be weaker than its
harmonic, and only many batches tell it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.robust import robust_sigma
from logparse import FlightLog, RotoridError
from sysid.loops.filters import NOTCH_LIMIT
from sysid.records import Floats
from sysid.records.filtering import welch

#: What is said of a flight without batches.
NO_BATCHES = "no raw gyro batches"

#: Change of throttle within a batch whose lines smear, and departure from hover's throttle that is hover, in parts.
_STEADY, _HOVERS = 0.03, 0.08

#: Lowest frequency of a motor's line, Hz: below, the craft moves.
_LOWEST = 20.0

#: A line stands out by so much (power) of the median about it (a part of its frequency to either side), and has at
#: least so much of the strongest line's power, and so many rad/s (0.1 deg/s).
_STANDS_OUT, _ABOUT, _PART, _LEAST = 20.0, 0.3, 0.02, 0.0017

#: Half-width of a line, in parts of its frequency and in steps of the spectrum.
_WIDTH, _STEPS = 0.03, 2.0

#: Exponents of throttle that are tried, and the uncertainty of one that tells nothing.
_EXPONENTS = np.linspace(0.0, 1.2, 25)
_UNKNOWN = 0.15

#: Fewest steady batches; most harmonics.
_FEWEST, _HARMONICS = 4, 4


class LineError(RotoridError):
    """The batches do not show the motors' lines."""


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Spectrum of one batch of the gyro."""

    start: float  #: s on the log's clock.
    stop: float
    throttle: float  #: Mean throttle output.
    steady: bool  #: Whether the throttle stayed.
    rate: float  #: Samples per second.
    hz: Floats  #: shape (m,)
    power: Floats  #: shape (3, m): Density about x, y, z, (rad/s)^2/Hz.

    @property
    def step(self) -> float:
        """Resolution, Hz."""
        return float(self.hz[1])


@dataclass(frozen=True, slots=True, eq=False)
class MotorLines:
    """The motors' lines of a flight."""

    steady: tuple[Batch, ...]  #: Batches of steady throttle.
    batches: tuple[Batch, ...]  #: Those of them in hover.
    hover: float  #: Throttle of hover.
    hz: float  #: Fundamental in hover.
    sigma: float
    harmonics: tuple[int, ...]  #: That stand out, 1 for the fundamental.
    exponent: float  #: Of throttle: the firmware's notch follows the square root.
    exponent_sigma: float
    quantum: float  #: Of the batches' samples, rad/s.


def gyro_batches(log: FlightLog) -> tuple[tuple[Batch, ...], tuple[Batch, ...], float]:
    """Return batches of the flown gyro before and after the filters, and the quantum of their samples, rad/s.

    LineError without batches of the gyro that flies, before its filters.
    """
    name, parameters, flight = log.name, log.parameters_flown, log.flight
    tables = log.tables.others("gyro_batch")
    if not tables or flight is None:
        only = " (those of the accelerometer do not tell the gyro's noise)" if "ISBH" in log.messages else ""
        raise LineError(f"{name}: {NO_BATCHES}{only}; fly with INS_LOG_BAT_MASK 1, INS_LOG_BAT_OPT 4")
    heads = log.messages["ISBH"]
    gyro = heads[heads["type"] == 1]
    instances = [int(instance) for instance in sorted(gyro["instance"].unique())]
    option = int(parameters.get("INS_LOG_BAT_OPT", 0.0))
    if option & 2:
        raise LineError(f"{name}: the batches are behind the filters (INS_LOG_BAT_OPT {option}); fly with 0 or 4")
    # With both the instances behind the filters follow those before them.
    raw = instances[: len(instances) // 2] if option & 4 and len(instances) > 1 else instances
    used = next((k for k, flag in enumerate(("INS_USE", "INS_USE2", "INS_USE3")) if parameters.get(flag, 1.0)), 0)
    if used not in raw:
        raise LineError(
            f"{name}: the batches are of IMU {raw[0] + 1}, and the loops fly on IMU {used + 1}; set "
            f"INS_LOG_BAT_MASK {1 << used}"
        )
    both = [tables[raw.index(used)], *(tables[len(raw) + raw.index(used) :][:1] if len(raw) < len(instances) else ())]
    throttle = log.tables.column("setpoints", "throttle")
    if throttle is None or throttle.notna().sum() < 2:
        raise LineError(f"{name}: no throttle output (CTUN), which the notch would follow")
    given = throttle.dropna()
    t, values = given.index.to_numpy(np.float64), given.to_numpy(np.float64)
    by_table: list[tuple[Batch, ...]] = []
    for table in both:
        batches = []
        for _, part in table.loc[flight.start : flight.stop].groupby("batch"):
            times = part.index.to_numpy(np.float64)
            if len(times) < 512:
                continue
            rate = 1.0 / float(np.median(np.diff(times)))
            samples = part[["gyro_x", "gyro_y", "gyro_z"]].to_numpy(np.float64).T
            hz, power = welch(samples, rate, len(times))
            during = np.interp(np.linspace(times[0], times[-1], 11), t, values)
            steady = bool(np.std(during) < _STEADY * np.mean(during))
            batches.append(Batch(times[0], times[-1], float(during.mean()), steady, rate, hz, power))
        by_table.append(tuple(batches))
    return by_table[0], (by_table[1] if len(by_table) > 1 else ()), 1.0 / float(np.median(gyro["mul"]))


def motor_lines(log: FlightLog, batches: Sequence[Batch], quantum: float) -> MotorLines:
    """Find the motors' lines in batches of one flight.

    LineError where none stands out, or none goes with throttle, or the battery moves them at equal throttle.
    """
    steady = [batch for batch in batches if batch.steady]
    if len(steady) < _FEWEST:
        raise LineError(f"{log.name}: {len(steady)} batches of steady throttle; hover for half a minute")
    hover = float(np.median([batch.throttle for batch in steady]))
    near = tuple(batch for batch in steady if abs(batch.throttle / hover - 1.0) < _HOVERS)
    alike = [batch for batch in near if len(batch.hz) == len(near[0].hz)]
    mean = np.mean([batch.power.sum(axis=0) for batch in alike], axis=0)
    candidates = _standing_out(alike[0].hz, mean, alike[0].rate)
    if not candidates:
        raise LineError(f"{log.name}: no line stands out of the gyro's noise, so that no notch is needed")
    still = ""
    for candidate in candidates:
        harmonics = tuple(k for k in range(1, _HARMONICS + 1) if _near(k * candidate, candidates))
        times, throttles, lines = _tracked(steady, candidate, harmonics, hover)
        if len(lines) < _FEWEST:
            continue
        values, sigma = _fitted(times, throttles, lines, hover)
        if sigma[1] > _UNKNOWN:
            still = still or f"the line at {candidate:.0f} Hz was not seen at other throttles; climb and descend"
        elif values[1] > 4.0 * sigma[1]:
            drift = float(values[2] * (steady[-1].stop - steady[0].start))
            if abs(drift) > _WIDTH and abs(values[2]) > 4.0 * sigma[2]:
                raise LineError(
                    f"{log.name}: at equal throttle the motors' line moved by {100.0 * drift:.0f} % through the "
                    "flight, as with a battery that sags: a notch on throttle would miss it; log ESC telemetry"
                )
            spread = float(np.hypot(np.exp(values[0]) * sigma[0], 0.1 * alike[0].step))
            exponent, exponent_sigma = float(values[1]), float(sigma[1])
            hz = float(np.exp(values[0]))
            return MotorLines(tuple(steady), near, hover, hz, spread, harmonics, exponent, exponent_sigma, quantum)
        else:
            still = still or f"the line at {candidate:.0f} Hz does not go with throttle: a mode of the frame"
    raise LineError(f"{log.name}: {still or f'no line is seen in {_FEWEST} of its {len(steady)} steady batches'}")


def _standing_out(hz: Floats, power: Floats, rate: float) -> list[float]:
    """Return the frequencies of lines that stand out, the lowest first."""
    inside = np.flatnonzero((hz >= _LOWEST) & (hz <= NOTCH_LIMIT * rate))
    lines: list[tuple[float, float]] = []
    for k in inside:
        wide = max(_WIDTH * hz[k], _STEPS * hz[1])
        line, about = np.abs(hz - hz[k]) <= wide, np.abs(hz - hz[k]) <= _ABOUT * hz[k]
        if power[k] == power[line].max() and power[k] > _STANDS_OUT * np.median(power[about]):
            total = float(power[line].sum() * hz[1])
            if total > _LEAST**2:
                lines.append((float(hz[line] @ power[line] / power[line].sum()), total))
    strongest = max((total for _, total in lines), default=0.0)
    return [where for where, total in lines if total > _PART * strongest]


def _near(where: float, lines: Sequence[float]) -> bool:
    return any(abs(line / where - 1.0) < _WIDTH for line in lines)


def _tracked(
    batches: Sequence[Batch], hover_hz: float, harmonics: Sequence[int], hover: float
) -> tuple[Floats, Floats, Floats]:
    """Return time, throttle and fundamental of batches in which the lines are seen where throttle would put them."""

    def strength(batch: Batch, exponent: float) -> list[tuple[float, float]]:
        seen = []
        total = batch.power.sum(axis=0)
        for k in harmonics:
            where = k * hover_hz * (batch.throttle / hover) ** exponent
            wide = max(_WIDTH * where, _STEPS * batch.step)
            line = np.flatnonzero(np.abs(batch.hz - where) <= wide)
            about = np.abs(batch.hz - where) <= _ABOUT * where
            if len(line) and line[-1] + 1 < len(total):
                part = total[line]
                seen.append(
                    (float(part.max() / np.median(total[about])), float(batch.hz[line] @ part / part.sum()) / k)
                )
        return seen

    scores = [sum(np.log(max((s for s, _ in strength(b, p)), default=1.0)) for b in batches) for p in _EXPONENTS]
    exponent = float(_EXPONENTS[int(np.argmax(scores))])
    rows = []
    for batch in batches:
        seen = strength(batch, exponent)
        best, where = max(seen, default=(0.0, 0.0))
        if best > _STANDS_OUT:
            rows.append((0.5 * (batch.start + batch.stop), batch.throttle, where))
    times, throttles, lines = np.array(rows).T if rows else np.empty((3, 0))
    return times, throttles, lines


def _fitted(times: Floats, throttles: Floats, lines: Floats, hover: float) -> tuple[Floats, Floats]:
    """Fit ln f = ln F + p ln(throttle / hover) + d t robustly; return the three with their sigmas."""
    design = np.column_stack([np.ones(len(times)), np.log(throttles / hover), times - times.mean()])
    weights = np.ones(len(times))
    for _ in range(5):
        weighted = design * weights[:, None]
        values = np.linalg.lstsq(weighted.T @ design, weighted.T @ np.log(lines), rcond=None)[0]
        left = np.log(lines) - design @ values
        scale = max(robust_sigma(left), 1e-4)
        weights = np.minimum(1.0, (2.0 * scale / np.maximum(np.abs(left), 1e-9)) ** 2)
    covariance = np.linalg.pinv((design * weights[:, None]).T @ design) * scale**2
    return values, np.sqrt(np.diag(covariance))
