"""GPS that is lost or jumps, and an estimator that doubts its sensors."""

from collections.abc import Iterator, Mapping

import numpy as np
import pandas as pd

from core.findings import Severity
from logparse.events.event import FlightEvent
from logparse.events.stretches import Array, stretches, within
from logparse.flights import Flight
from logparse.tables import Tables

#: Distance [m] between a fix and what the last fix and its speed foretell: ArduCopter's glitch radius, and the
#: acceleration [m/s^2] that its check allows on top.
_RADIUS, _ACCELERATION = 5.0, 10.0
_GLITCH_SOURCE = "ArduCopter 3.2, GPSGLITCH_RADIUS 5 m, GPSGLITCH_ACCEL 10 m/s^2"
#: Fewest satellites of a three-dimensional fix; losses closer together than the pause [s] are one.
_FEWEST, _PAUSE = 4, 2.0
_EARTH = 6.371e6
#: Time without a word from the receiver, s.
_SILENT = 2.0
#: State of jamming at which a receiver warns.
_JAMMED = 2.0

#: Test ratio of the estimator above which ArduPilot's EKF failsafe counts, and shortest time [s] of its check.
_RATIO, _DOUBTING = 0.8, 1.0
_RATIO_SOURCE = "ArduPilot FS_EKF_THRESH 0.8; the failsafe waits 1 s"
_RATIOS = {"SV": "velocity", "SP": "position", "SH": "height", "SM": "compass"}


def navigation_events(
    tables: Tables, messages: Mapping[str, pd.DataFrame], flights: tuple[Flight, ...]
) -> Iterator[FlightEvent]:
    """Yield lost and jumping GPS, and test ratios of the estimator beyond the failsafe's limit.

    Parameters
    ----------
    tables : Tables
    messages : mapping of str to DataFrame
        As logged; XKF4 or NKF4 are read.
    flights : tuple of Flight
    """
    spans = [(flight.start, flight.stop) for flight in flights]
    if tables.gps is not None and len(tables.gps) > 3:
        yield from _gps(tables.gps, spans)
        yield from _silence(tables.gps, tables, spans)
    yield from _jamming(messages, spans)
    yield from _ratios(messages, spans)


def _gps(gps: pd.DataFrame, spans: list[tuple[float, float]]) -> Iterator[FlightEvent]:
    t = gps.index.to_numpy(np.float64)
    flying = within(t, spans)
    fix, satellites = gps["fix"].to_numpy(np.float64), gps["satellites"].to_numpy(np.float64)
    if not (fix >= 3.0).any():
        return  # a receiver that never had a fix, such as indoors, loses nothing
    with np.errstate(invalid="ignore"):
        lost = (fix < 3.0) | (satellites < _FEWEST) | ~np.isfinite(gps["lat"].to_numpy(np.float64))
    jump = _jumps(gps)
    pause = max(_PAUSE, 3.0 * float(np.median(np.diff(t))))
    losses = stretches(t, lost & flying, join=pause)
    for first, last in losses:
        inside = (t >= first) & (t <= last)
        before = satellites[(t < first) & (t > first - 3.0)]
        had = float(np.nanmedian(before)) if np.isfinite(before).any() else float("nan")
        left = float(np.nanmin(satellites[inside])) if np.isfinite(satellites[inside]).any() else float("nan")
        leap = float(np.nanmax(np.append(jump[inside], 0.0)))
        sudden = np.isfinite(had) and had - left >= 4.0
        evidence: dict[str, str | int | float | bool] = {"seconds": last - first, "largest_jump_m": leap}
        if np.isfinite(had) and np.isfinite(left):
            evidence |= {"satellites_before": had, "satellites_least": left}
        counted = f" (satellites {had:.0f} to {left:.0f})" if "satellites_least" in evidence else ""
        yield FlightEvent(
            id="gps-lost",
            t=first,
            end=last,
            severity=Severity.ERROR if last - first > 5.0 else Severity.WARNING,
            reason=f"GPS lost its fix for {f'{last - first:.1f} s' if last > first else 'a moment'}{counted}"
            + (f" and jumped by {leap:.0f} m" if leap > _RADIUS else "")
            + (", all at once, as when it is jammed." if sudden else "."),
            advice="Look for jammers, video transmitters and USB 3 near the receiver, and for shading; fly elsewhere.",
            evidence=evidence,
            source="fix below 3-D or fewer than 4 satellites",
        )
    around = within(t, [(first - 1.0, last + pause) for first, last in losses])
    for first, last in stretches(t, (jump > _RADIUS) & flying & ~around, join=pause):
        leap = float(np.nanmax(jump[(t >= first) & (t <= last)]))
        yield FlightEvent(
            id="gps-glitch",
            t=first,
            end=last,
            severity=Severity.WARNING,
            reason=f"GPS jumped by {leap:.0f} m against its own speed.",
            advice="Look at satellites and multipath around this time; rely on height and attitude only there.",
            evidence={"jump_m": leap},
            source=_GLITCH_SOURCE,
        )


def _silence(gps: pd.DataFrame, tables: Tables, spans: list[tuple[float, float]]) -> Iterator[FlightEvent]:
    """Find times in flight without a word from the receiver while the log went on."""
    others = tables.times("attitude")
    if others is None:
        return
    t = gps.index.to_numpy(np.float64)
    limit = max(_SILENT, 5.0 * float(np.median(np.diff(t))))
    for first, last in spans:
        inside = np.concatenate(([max(first, t[0])], t[(t > first) & (t < last)], [last]))
        for k in np.flatnonzero(np.diff(inside) > limit):
            begin, end = float(inside[k]), float(inside[k + 1])
            between = np.concatenate(([begin], others[(others > begin) & (others < end)], [end]))
            # Where the other tables stop too, it is the log that is silent.
            if float(np.max(np.diff(between))) > 0.5 * (end - begin):
                continue
            yield FlightEvent(
                id="gps-lost",
                t=begin,
                end=end,
                severity=Severity.ERROR if end - begin > 5.0 else Severity.WARNING,
                reason=f"The GPS receiver was silent for {end - begin:.1f} s.",
                advice="Check the receiver's plug, cable and supply.",
                evidence={"seconds": end - begin},
            )


def _jumps(gps: pd.DataFrame) -> Array:
    """Distance by which each fix leaves what the one before and its speed foretell, m; 0 where none is known."""
    t = gps.index.to_numpy(np.float64)
    lat, lon = gps["lat"].to_numpy(np.float64), gps["lon"].to_numpy(np.float64)
    dt = np.diff(t)
    north = _EARTH * np.diff(lat)
    east = _EARTH * np.diff(lon) * np.cos(lat[1:])
    v_n, v_e = gps["v_n"].to_numpy(np.float64), gps["v_e"].to_numpy(np.float64)
    miss_n, miss_e = north - v_n[:-1] * dt, east - v_e[:-1] * dt
    miss = np.hypot(miss_n, miss_e) - 0.5 * _ACCELERATION * dt**2
    miss[~np.isfinite(miss) | (dt > 2.0)] = 0.0
    return np.concatenate(([0.0], np.maximum(miss, 0.0)))


def _jamming(messages: Mapping[str, pd.DataFrame], spans: list[tuple[float, float]]) -> Iterator[FlightEvent]:
    """Report what a receiver itself says of jamming (PX4 logs it)."""
    for name in ("vehicle_gps_position", "sensor_gps"):
        if name not in messages or "jamming_state" not in messages[name]:
            continue
        frame = messages[name]
        t, state = frame.index.to_numpy(np.float64), frame["jamming_state"].to_numpy(np.float64)
        for first, last in stretches(t, within(t, spans) & (state >= _JAMMED), join=_PAUSE):
            yield FlightEvent(
                id="gps-jammed",
                t=first,
                end=last,
                severity=Severity.ERROR
                if float(state[(t >= first) & (t <= last)].max()) > _JAMMED
                else Severity.WARNING,
                reason=f"The GPS receiver reported jamming for {last - first:.1f} s.",
                advice="Look for jammers, video transmitters and USB 3 near the receiver; fly again elsewhere.",
                evidence={"seconds": last - first, "state": float(state[(t >= first) & (t <= last)].max())},
                source="PX4 sensor_gps.jamming_state: 2 warning, 3 critical",
            )
        return


def _ratios(messages: Mapping[str, pd.DataFrame], spans: list[tuple[float, float]]) -> Iterator[FlightEvent]:
    name = next((name for name in ("XKF4", "NKF4") if name in messages), None)
    if name is None:
        return
    frame = messages[name]
    lane = next((column for column in ("C", "Core") if column in frame), None)
    if lane is not None:
        # The lane that flies; where the message does not tell, the first.
        primary = frame["PI"].iloc[-1] if "PI" in frame else frame[lane].min()
        frame = frame[frame[lane] == primary]
    t = frame.index.to_numpy(np.float64)
    if len(t) < 3:
        return
    flying = within(t, spans)
    for column, what in _RATIOS.items():
        if column not in frame:
            continue
        values = frame[column].to_numpy(np.float64)
        with np.errstate(invalid="ignore"):
            on = flying & (values > _RATIO)
        for first, last in stretches(t, on, join=0.5, shortest=_DOUBTING):
            worst = float(np.max(values[(t >= first) & (t <= last)]))
            yield FlightEvent(
                id="estimator-doubt",
                t=first,
                end=last,
                severity=Severity.WARNING,
                reason=f"The estimator doubted its {what}: test ratio up to {worst:.1f} for {last - first:.1f} s.",
                advice="Look at the sensor behind it: GPS for velocity and position, barometer for height, compass.",
                evidence={"quantity": what, "ratio": worst, "seconds": last - first},
                source=_RATIO_SOURCE,
            )
