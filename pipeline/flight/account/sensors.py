"""Sensors and estimates that failed in flight: GPS, the autopilot's estimator, its height, vibration."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from core.catalogue import finding
from core.findings import Happening, Severity
from core.quantity import number
from logparse.heights import WRONG, smoothed
from pipeline.flight.account.readings import (
    RECOVERS,
    SATELLITES,
    Mask,
    Readings,
    Stretch,
    at,
    stretches,
)
from pipeline.flight.account.state import GLITCH_RADIUS, SILENT, SOURCES, steps
from pipeline.flight.account.vibration import Floats
from pipeline.results.span import Span, within

#: Time [s] for which a loss is no danger.
_BRIEF = 5.0
#: A rise of vibration: it stays for this long [s], and is for most of the rest, above this many times nearly all of
#: what was before, and above a third of the advised limit, or this [m/s^2] of what filters leave of it (26-11-2014_181,
#: which rose to 1.7).
_STAYS, _TIMES, _FILTERED = 5.0, 2.0, 1.0
#: Share of the flight beyond the limit that is more than moments.
_SHARE = 0.1


def sensor_happenings(readings: Readings) -> Iterator[Happening]:
    """Yield what sensors and estimates did in flight that they should not."""
    gps = readings.tables.gps
    if gps is not None and len(gps) > 3 and (gps["fix"] >= 3.0).any():
        yield from _gps(readings, gps)
    yield from _height(readings)
    yield from _vibrations(readings)


def _gps(readings: Readings, gps: pd.DataFrame) -> Iterator[Happening]:
    """Find lost fixes, silence of the receiver and jumps; a receiver that never had a fix loses nothing."""
    t = gps.index.to_numpy(np.float64)
    flying = readings.flying(t)
    fix, satellites = gps["fix"].to_numpy(np.float64), gps["satellites"].to_numpy(np.float64)
    with np.errstate(invalid="ignore"):
        signs = (fix < 3.0, satellites < SATELLITES, ~np.isfinite(gps["lat"].to_numpy(np.float64)))
    lost = (np.sum(signs, axis=0) > 1) | np.logical_or.reduce([_not_alone(sign) for sign in signs])
    losses = list(_losses(t, lost, flying, readings.flight.stop))
    for first, last, rows in losses:
        before, inside = satellites[(t < first) & (t > first - SILENT)], satellites[rows]
        had = float(np.nanmedian(before)) if np.isfinite(before).any() else np.nan
        left = float(np.nanmin(inside)) if np.isfinite(inside).any() else np.nan
        counted = f" (satellites {had:.0f} to {left:.0f})" if left < had else ""
        counted += ", all at once, as when it is jammed" if had - left >= SATELLITES else ""
        yield finding(
            "gps-lost",
            f"GPS lost its fix for {last - first:.1f} s{counted}.",
            severity=Severity.ERROR if last - first > _BRIEF else Severity.WARNING,
            t=first,
            end=last,
            satellites_before=had,
            satellites_least=left,
        )
    yield from _silence(readings, t, losses)
    step, foretold, jump = steps(gps)
    near = within(t, (Span(first - 1.0, last + SILENT) for first, last, _ in losses))
    for first, last, rows in stretches(t, (jump > GLITCH_RADIUS) & flying & ~near, join=RECOVERS):
        worst, left = float(jump[rows].max()), (step - foretold)[rows].sum(axis=0)
        if rows.stop - rows.start == 2 and np.linalg.norm(left) < GLITCH_RADIUS:
            continue  # to one fix and back
        yield finding(
            "gps-glitch", f"GPS jumped by {worst:.0f} m against its own speed.", t=first, end=last, jump_m=worst
        )


def _losses(t: Floats, lost: Mask, flying: Mask, stop: float) -> Iterator[Stretch]:
    """Yield when the position was lost: to the last row without it, or to the end where no more was heard."""
    on = np.flatnonzero(lost & flying)
    for rows in np.split(on, np.flatnonzero((np.diff(on) > 1) & (np.diff(t[on]) > SILENT)) + 1):
        if not len(rows):
            continue
        first, last = float(t[rows[0]]), float(t[rows[-1]])
        if stop - last > SILENT and not flying[rows[-1] + 1 :].any():
            last = stop
        # One row alone is damage, and so are some among many.
        if last > first and 2 * len(rows) > rows[-1] + 1 - rows[0]:
            yield Stretch(first, last, slice(int(rows[0]), int(rows[-1]) + 1))


def _not_alone(sign: Mask) -> Mask:
    """Return the rows of a sign that the row before or behind shows too."""
    beside = np.pad(sign, 1)
    return np.asarray(sign & (beside[:-2] | beside[2:]))


def _silence(readings: Readings, t: Floats, losses: list[Stretch]) -> Iterator[Happening]:
    """Find times in flight without a word from the receiver while the log went on; telemetry repeats its last word."""
    others = [times for name in ("attitude", "baro", "motors") if (times := readings.tables.times(name)) is not None]
    if not others or "GPS_RAW_INT" in readings.messages:
        return
    first, last = readings.flight.start, readings.flight.stop
    limit = max(SILENT, 5.0 * float(np.median(np.diff(t))))
    inside = np.append(t[(t > first) & (t < last)], last)
    for k in np.flatnonzero(np.diff(inside) > limit):
        begin, end = float(inside[k]), float(inside[k + 1])
        # Where another table stops too, it is the log that is silent.
        silent = max(float(np.max(np.diff([begin, *times[(times > begin) & (times < end)], end]))) for times in others)
        if silent > 0.5 * (end - begin) or any(a <= end and b >= begin for a, b, _ in losses):
            continue
        yield finding(
            "gps-lost",
            f"The GPS receiver was silent for {end - begin:.1f} s.",
            severity=Severity.ERROR if end - begin > _BRIEF else Severity.WARNING,
            t=begin,
            end=end,
        )


def _height(readings: Readings) -> Iterator[Happening]:
    """Find a barometer that stopped or stayed in the air, or an autopilot whose height ran away."""
    flight = readings.flight
    if readings.barometer_stopped is not None:
        yield finding(
            "height-estimate-wrong",
            "The barometer stopped: it repeated one value while other heights changed.",
            t=readings.barometer_stopped,
            end=flight.stop,
            advice="Look at the barometer and its bus: do not hold height before it is cured.",
        )
    elif (above := readings.stayed.get("baro")) is not None:
        side = "above" if above > 0.0 else "below"
        yield finding(
            "height-estimate-wrong",
            f"The barometer was {abs(above):.0f} m {side} the ground when the craft was back.",
            t=flight.stop,
            advice="Look at the barometer's foam and wiring: do not hold height before it is cured.",
            height_error_m=above,
        )
    own = dict(readings.heights).get("autopilot")
    if own is None or readings.own_height:
        return
    source, credible = readings.heights[0]
    height, other = (smoothed(series.loc[flight.start : flight.stop]) for series in (own, credible))
    if len(height) < 10 or len(other) < 10:
        return
    t = height.index.to_numpy(np.float64)
    off = height.to_numpy(np.float64) - at(t, other)
    off -= float(np.median(off[: max(len(off) // 20, 3)]))
    for first, last, rows in stretches(t, np.abs(off) > WRONG, join=5.0, shortest=2.0)[:1]:
        worst = float(off[rows][int(np.argmax(np.abs(off[rows])))])
        side = "above" if worst > 0.0 else "below"
        yield finding(
            "height-estimate-wrong",
            f"The autopilot's own height was up to {abs(worst):.0f} m {side} the {SOURCES[source]}'s.",
            t=first,
            end=last,
            height_error_m=worst,
        )


def _vibrations(readings: Readings) -> Iterator[Happening]:
    """Find vibration beyond the published limit, or that rose and stayed."""
    measured = readings.vibration
    if measured is None:
        return
    inside = readings.flying(measured.t) & (measured.t < readings.flight.stop - 1.0)
    t, level = measured.t[inside], measured.level[inside]
    rise = _rise(t, level, _FILTERED if measured.relative else measured.advised / 3.0)
    if rise is not None:
        usual, risen, since = rise
        yield finding(
            "vibration",
            f"Vibration rose {risen / max(usual, 0.1):.0f} times and stayed: from {number(usual, 2)} to "
            f"{number(risen, 2)} m/s²{' behind the filters of the autopilot' if measured.relative else ''}.",
            severity=Severity.ERROR,
            advice="Look for a chipped propeller, and for a loose motor or arm.",
            t=since,
            end=readings.flight.stop,
            level_m_s2=risen,
        )
        return
    strong = t[level > measured.harmful]
    if len(strong) > _SHARE * len(t):
        worst = float(level.max())
        yield finding(
            "vibration",
            f"Vibration was up to {worst:.0f} m/s², beyond {measured.harmful:.0f} m/s² which nearly always harms.",
            severity=Severity.WARNING,
            t=float(strong[0]),
            end=float(strong[-1]),
            level_m_s2=worst,
        )


def _rise(t: Floats, level: Floats, least: float) -> tuple[float, float, float] | None:
    """Return what vibration was, what it became and since when; None where it did not rise for good to `least`."""
    if not len(t):
        return None
    # The shortest prefix whose 95th percentile nearly everything in the next seconds exceeds, and most of the rest.
    for begin in np.arange(t[0] + 2.0 * _STAYS, t[-1] - _STAYS, 0.5):
        k = int(np.searchsorted(t, begin))
        later = level[k:][t[k:] < begin + _STAYS]
        risen = min(float(np.percentile(later, 20.0)), float(np.median(level[k:]))) if len(later) else 0.0
        if risen > least and risen > _TIMES * (usual := float(np.percentile(level[:k], 95.0))):
            return usual, float(np.median(level[k:])), float(t[k + int(np.argmax(level[k:] > _TIMES * usual))])
    return None
