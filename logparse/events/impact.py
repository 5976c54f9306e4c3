"""Falls, crashes and hard landings, by specific force, attitude and height."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from core.findings import Severity
from core.units import STANDARD_GRAVITY
from logparse.events.attitude import LOST
from logparse.events.event import FlightEvent
from logparse.events.reported import airborne
from logparse.events.stretches import Array, stretches
from logparse.flights import Flight
from logparse.heights import height_above_ground, speed_down
from logparse.rest import ACCEL
from logparse.tables import Tables

#: Specific force [m/s^2] of a blow that no manoeuvre makes: 4 g. ArduPilot names no limit for landings.
BLOW = 4.0 * STANDARD_GRAVITY
#: Speed down [m/s] before a blow, and lean [rad] around it, that make it a crash: an upright craft that comes down more
#: slowly than from a free fall of 1.8 m has landed hard, and ANGLE_MAX keeps a craft under control below the second.
_FAST, _OVER = 6.0, np.radians(60.0)
#: Specific force [m/s^2] and time [s] of a fall: motors at idle still leave a third of the weight in a descent.
_FREE, _FALLING = 0.3 * STANDARD_GRAVITY, 0.3
#: Time over which force is averaged before it is called a fall, s.
_SMOOTH = 0.1
#: Part of the flight's median throttle below which less lift was asked for, and time before a fall [s] in which it is.
_CLOSED, _CLOSING = 0.75, 0.2
#: Height lost [m] after disarming, within `_AFTER` seconds, that shows that the craft was in the air.
_DROP, _AFTER = 1.5, 5.0
#: Time after a blow within which a craft that still flies has risen by that much, s.
_RISEN_WITHIN = 10.0


@dataclass(frozen=True, slots=True)
class _Blow:
    t: float
    force: float


def impact_events(
    tables: Tables, flights: tuple[Flight, ...], error: "pd.Series[float] | None"
) -> Iterator[FlightEvent]:
    """Yield falls, disarming in the air, crashes and hard landings.

    Parameters
    ----------
    tables : Tables
    flights : tuple of Flight
    error : Series or None
        Angle by which the thrust axis is off its target, as `logparse.events.attitude.attitude_error` gives it.
    """
    height = height_above_ground(tables)
    force = _force(tables)
    falls = list(_falls(_force(tables, smooth=_SMOOTH), flights))
    dropped = list(_disarmed(tables, height, flights, falls))
    yield from dropped
    for fall in falls:
        if any(abs(event.t - fall.t) < 1.0 for event in dropped) or not _let_fall(fall, tables, flights):
            yield fall
    for flight in flights:
        yield from _blows(force, tables, height, error, flight, [event.t for event in dropped])


def _force(tables: Tables, smooth: float = 0.0) -> "pd.Series[float] | None":
    """Magnitude of the specific force, m/s^2, or of its mean over `smooth` seconds, of which vibration is no part."""
    if tables.imu is None:
        return None
    axes = tables.imu[list(ACCEL)]
    if axes.isna().to_numpy().any():
        axes = axes.dropna()
    if len(axes) <= 2:
        return None
    size = 1
    if smooth:
        step = float(np.median(np.diff(axes.index.to_numpy(np.float64))))
        # Slow samples have been averaged before, and are too few to lose.
        size = round(smooth / step) if 0.0 < step <= 0.25 * smooth else 1
    squares = np.zeros(len(axes))
    for name in ACCEL:  # one by one: together they are as large as half a log
        axis = axes[name].rolling(size, center=True, min_periods=1).mean() if smooth else axes[name]
        squares += axis.to_numpy(np.float64) ** 2
    return pd.Series(np.sqrt(squares, out=squares), index=axes.index)


def _falls(force: "pd.Series[float] | None", flights: tuple[Flight, ...]) -> Iterator[FlightEvent]:
    if force is None:
        return
    t, values = force.index.to_numpy(np.float64), force.to_numpy(np.float64)
    if 1.0 / float(np.median(np.diff(t))) < 5.0:
        return
    for first, last in stretches(t, values < _FREE, join=0.1, shortest=_FALLING):
        if not airborne(first, flights, margin=1.0):
            continue
        yield FlightEvent(
            id="free-fall",
            t=first,
            end=last,
            severity=Severity.ERROR,
            reason=f"The craft fell for {last - first:.1f} s: nothing carried it.",
            advice="Look for what stopped the motors: disarming, power, a closed throttle.",
            evidence={"least_force_m_s2": float(np.min(values[(t >= first) & (t <= last)]))},
        )


def _let_fall(fall: FlightEvent, tables: Tables, flights: tuple[Flight, ...]) -> bool:
    """Return whether the throttle was closed when a fall began: a manoeuvre, and nobody's failure."""
    if tables.setpoints is None:
        return False
    throttle = tables.setpoints["throttle"].dropna()
    usual = [float(throttle.loc[each.start : each.stop].median()) for each in flights if each.start <= fall.t]
    asked = throttle.loc[fall.t - _CLOSING : fall.end]
    return bool(usual) and len(asked) > 0 and float(asked.min()) < _CLOSED * usual[-1]


def _disarmed(
    tables: Tables, height: "pd.Series[float] | None", flights: tuple[Flight, ...], falls: list[FlightEvent]
) -> Iterator[FlightEvent]:
    if tables.events is None:
        return
    names = tables.events
    off = names.index[(names["event"] == "DISARMED") | names["detail"].str.startswith("Disarming motors")]
    last = -np.inf
    for t in map(float, off):
        repeated, last = t - last < 1.0, t
        if repeated or not airborne(t, flights, margin=1.5):
            continue
        drop = _drop(height, t)
        fell = any(-0.2 <= fall.t - t <= 1.0 for fall in falls)
        if not (drop > _DROP or (fell and not drop <= 0.5)):
            continue
        evidence: dict[str, str | int | float | bool] = {"fell": fell}
        if np.isfinite(drop):
            evidence["height_m"] = drop
        above = f" {drop:.0f} m above the ground" if np.isfinite(drop) else ""
        yield FlightEvent(
            id="disarmed-in-air",
            t=t,
            end=t,
            severity=Severity.ERROR,
            reason=f"The motors were disarmed in the air{above}.",
            advice="Find who disarmed: a switch, a stick gesture, a failsafe or the ground station.",
            evidence=evidence,
        )


def _drop(height: "pd.Series[float] | None", t: float) -> float:
    """Height lost in the seconds after a moment, m; NaN where not known."""
    if height is None:
        return float("nan")
    before, after = height.loc[t - 1.0 : t + 0.2], height.loc[t : t + _AFTER]
    if not len(before) or len(after) < 2:
        return float("nan")
    return float(before.iloc[-1] - np.percentile(after, 5.0))


def _blows(
    force: "pd.Series[float] | None",
    tables: Tables,
    height: "pd.Series[float] | None",
    error: "pd.Series[float] | None",
    flight: Flight,
    dropped: list[float],
) -> Iterator[FlightEvent]:
    if force is None:
        return
    inside = force.loc[flight.start : flight.stop + _AFTER]
    t, values = inside.index.to_numpy(np.float64), inside.to_numpy(np.float64)
    if not len(t):
        return
    crashed = False
    for first, last in stretches(t, values > BLOW, join=2.0):
        piece = (t >= first) & (t <= last)
        blow = _Blow(first, float(values[piece].max()))
        crash, evidence = _how_bad(blow, flight, tables, height, error, dropped)
        crash = crash and not _flew_on(height, last)
        if crash and not crashed:
            crashed = True
            yield FlightEvent(
                id="crash",
                t=first,
                end=last,
                severity=Severity.ERROR,
                reason=f"The craft crashed: {_told(blow, evidence)}.",
                advice="Inspect frame, propellers, motors and the autopilot's mount before the next flight.",
                evidence=evidence,
            )
        elif not crashed:
            landing = first > flight.stop - 3.0
            yield FlightEvent(
                id="hard-landing" if landing else "blow-in-flight",
                t=first,
                end=last,
                severity=Severity.WARNING,
                reason=("The landing was hard: " if landing else "The craft was hit: ") + _told(blow, evidence) + ".",
                advice="Inspect legs, arms and propellers." if landing else "Look for contact with ground or objects.",
                evidence=evidence,
            )


def _flew_on(height: "pd.Series[float] | None", t: float) -> bool:
    """Return whether the craft rose again after a blow: it was a touch then, not the end of a flight."""
    if height is None:
        return False
    low, later = height.loc[t : t + 1.0].dropna(), height.loc[t + 1.0 : t + _RISEN_WITHIN].dropna()
    return len(low) > 0 and len(later) > 1 and float(np.percentile(later, 90.0) - low.min()) > _DROP


def _told(blow: _Blow, evidence: dict[str, str | int | float | bool]) -> str:
    parts = [f"a blow of {blow.force / STANDARD_GRAVITY:.0f} g"]
    if "descent_m_s" in evidence:
        parts.append(f"{float(evidence['descent_m_s']):.1f} m/s down before it")
    if float(evidence.get("lean_rad", 0.0)) > _OVER:
        parts.append(f"leaning {np.degrees(float(evidence['lean_rad'])):.0f}° around it")
    return ", ".join(parts)


def _how_bad(
    blow: _Blow,
    flight: Flight,
    tables: Tables,
    height: "pd.Series[float] | None",
    error: "pd.Series[float] | None",
    dropped: list[float],
) -> tuple[bool, dict[str, str | int | float | bool]]:
    """Return whether a blow was a crash, and the evidence."""
    evidence: dict[str, str | int | float | bool] = {"force_m_s2": blow.force}
    descent = _descent(tables, height, blow.t)
    if np.isfinite(descent):
        evidence["descent_m_s"] = descent
    lean = 0.0
    if tables.attitude is not None:
        near = tables.attitude.loc[blow.t - 1.0 : blow.t + 2.0, ["roll", "pitch"]].dropna()
        if len(near):
            lean = float(np.max(np.arccos(np.cos(near["roll"]) * np.cos(near["pitch"]))))
            evidence["lean_rad"] = lean
    lost = False
    if error is not None:
        near_error = error.loc[blow.t - 1.5 : blow.t].dropna()
        # Of a craft that stays in the air afterwards, off its target for a moment, the blow was a touch.
        lost = len(near_error) > 0 and float(near_error.max()) > LOST and flight.stop - blow.t < _AFTER
    declared = False
    if tables.events is not None:
        said = tables.events.loc[blow.t - 1.0 : blow.t + 5.0]
        declared = bool((said["detail"].str.startswith("CRASH_CHECK") & ~said["detail"].str.endswith(" 0")).any())
    fell = any(0.0 <= blow.t - t <= _AFTER for t in dropped)
    return descent > _FAST or lean > _OVER or lost or declared or fell, evidence


def _descent(tables: Tables, height: "pd.Series[float] | None", t: float) -> float:
    """Speed down just before a moment, m/s: the estimate's, or the slope of the height; NaN where not known."""
    down = speed_down(tables)
    if down is not None:
        speed = down.loc[t - 0.6 : t - 0.02]
        return float(np.percentile(speed, 80.0)) if len(speed) else float("nan")
    if height is None:
        return float("nan")
    before = height.loc[t - 1.0 : t].dropna()
    if len(before) < 3 or before.index[-1] - before.index[0] < 0.4:
        return float("nan")
    times: Array = before.index.to_numpy(np.float64)
    return -float(np.polyfit(times - times[0], before.to_numpy(np.float64), 1)[0])
