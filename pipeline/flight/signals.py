"""Lines by which a flight is judged, thinned for plots such that no peak is lost."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from logparse import Tables
from logparse.heights import above_ground, heights
from pipeline.flight.account.readings import Readings
from pipeline.flight.account.state import SOURCES
from pipeline.flight.spectrum import vibration_spectrum
from pipeline.results.signals import FlightSignals, Panel, SignalLine
from pipeline.results.span import Span

Floats = NDArray[np.float64]

#: Most points of a line.
_MOST = 3000
#: Test ratio at which ArduPilot's failsafe counts (FS_EKF_THRESH).
_RATIO = 0.8


def flight_signals(readings: Readings) -> FlightSignals:
    """Gather the lines of one flight."""
    tables, flight, levels, battery = readings.tables, readings.flight, readings.limits, readings.tables.battery
    return FlightSignals(
        height=_panel("height", "m", _heights(tables, flight)),
        attitude=_asked_and_flown(
            tables, flight, ("setpoints", "attitude"), {name: (name, name) for name in ("roll", "pitch", "yaw")}, "rad"
        ),
        rates=_asked_and_flown(
            tables,
            flight,
            ("rates", "rates"),
            {
                f"{name} rate": (f"w_{axis}_ref", f"w_{axis}")
                for name, axis in (("roll", "x"), ("pitch", "y"), ("yaw", "z"))
            },
            "rad/s",
        ),
        vibration=_vibration(readings),
        battery=_columns(
            None if battery is None else battery.assign(power=battery["voltage"] * battery["current"]),
            flight,
            {"voltage": ("voltage", "V"), "current": ("current", "A"), "power": ("power", "W")},
        ),
        estimator=_ratios(readings.messages, flight),
        gps=_columns(
            tables.gps,
            flight,
            {"satellites": ("satellites", ""), "dilution (HDOP)": ("hdop", ""), "accuracy": ("h_acc", "m")},
        ),
        compass=_compass(tables, flight),
        spectrum=vibration_spectrum(tables, flight, tables.parameters),
        motor_limits={"MOT_SPIN_MIN": levels.pwm(levels.spin_min), "MOT_SPIN_MAX": levels.pwm(levels.spin_max)},
    )


def _heights(tables: Tables, flight: Span) -> Iterator[SignalLine | None]:
    """Yield height above the ground that the flight left, by every sensor."""
    shown = Span(flight.start - 2.0, flight.stop + 5.0)
    for source, known in heights(tables):
        yield _line(SOURCES[source], above_ground(known, flight), shown)


def thin(t: Floats, y: Floats, most: int = _MOST) -> tuple[Floats, Floats]:
    """Keep the smallest and the largest y, shape (n,), of each of `most` / 2 stretches, in order; NaN is a gap."""
    if len(t) <= most:
        return t, y
    width = -(-len(t) // (most // 2))
    begins = np.arange(0, len(t), width)
    padded = np.full(len(begins) * width, np.nan)
    padded[: len(y)] = y
    stretches = padded.reshape(len(begins), width)
    kept = (
        np.where(np.isnan(stretches), np.inf, stretches).argmin(axis=1),
        np.where(np.isnan(stretches), -np.inf, stretches).argmax(axis=1),
    )
    rows = np.unique(np.concatenate([begins + offsets for offsets in kept]))
    return t[rows], y[rows]


def _line(name: str, column: pd.Series[float], flight: Span) -> SignalLine | None:
    # Messages are as logged, and damage moves time stamps.
    ordered = column if column.index.is_monotonic_increasing else column.sort_index(kind="stable")
    inside = ordered.iloc[flight.rows(ordered.index)]
    values = inside.to_numpy(np.float64)
    if len(values) < 2 or not np.isfinite(values).any():
        return None
    t: Floats = inside.index.to_numpy(np.float64)
    return SignalLine(name, *thin(t, np.asarray(values, dtype=np.float64)))


def _panel(
    title: str, unit: str, lines: Iterable[SignalLine | None], limits: Mapping[str, float] | None = None
) -> tuple[Panel, ...]:
    drawn = tuple(line for line in lines if line is not None)
    return (Panel(title=title, unit=unit, signals=drawn, limits=limits or {}),) if drawn else ()


def _asked_and_flown(
    tables: Tables, flight: Span, sources: tuple[str, str], names: Mapping[str, tuple[str, str]], unit: str
) -> tuple[Panel, ...]:
    panels: tuple[Panel, ...] = ()
    for title, columns in names.items():
        curves = [None if column is None else column.dropna() for column in map(tables.column, sources, columns)]
        asked, flown = curves if title != "yaw" else _turning(curves[0], curves[1], flight)
        if flown is None:
            continue
        line = _line("flown", flown, flight)
        if line is not None:
            panels += _panel(title, unit, [None if asked is None else _line("asked", asked, flight), line])
    return panels


def _turning(
    asked: pd.Series[float] | None, flown: pd.Series[float] | None, flight: Span
) -> tuple[pd.Series[float] | None, pd.Series[float] | None]:
    """Return headings that run on beyond half a turn instead of jumping, what was asked beside what was flown, rad.

    They are counted so that the flight's middle one lies within half a turn of north.
    """
    if flown is None or not len(flown):
        return asked, flown
    flown = flown[np.isfinite(flown)]
    headings = np.unwrap(flown.to_numpy(np.float64))
    inside = (flown.index >= flight.start) & (flown.index <= flight.stop)
    middle = float(np.median(headings[inside])) if inside.any() else 0.0
    flown = pd.Series(headings - 2.0 * np.pi * np.round(middle / (2.0 * np.pi)), index=flown.index)
    if asked is None or not len(asked) or not len(flown):
        return asked, flown
    ordered = flown if flown.index.is_monotonic_increasing else flown.sort_index(kind="stable")
    beside = np.interp(asked.index.to_numpy(np.float64), ordered.index.to_numpy(np.float64), ordered.to_numpy())
    off = asked.to_numpy(np.float64) - beside
    return pd.Series(beside + np.arctan2(np.sin(off), np.cos(off)), index=asked.index), flown


def _columns(table: pd.DataFrame | None, flight: Span, wanted: Mapping[str, tuple[str, str]]) -> tuple[Panel, ...]:
    if table is None:
        return ()
    panels: tuple[Panel, ...] = ()
    for title, (column, unit) in wanted.items():
        values = table[column].dropna()
        if len(values) and float(values.abs().max()) > 0.0:
            panels += _panel(title, unit, [_line(title, values, flight)])
    return panels


def _vibration(readings: Readings) -> tuple[Panel, ...]:
    measured = readings.vibration
    if measured is None or measured.relative:
        return ()
    limits = {"advised limit": measured.advised, "harmful": measured.harmful}
    names = "xyz" if measured.axes.shape[1] == 3 else ("accelerometer 1",)
    columns = (pd.Series(column, index=measured.t) for column in measured.axes.T)
    lines = [_line(name, column, readings.flight) for name, column in zip(names, columns, strict=True)]
    return _panel("vibration", "m/s²", lines, limits)


#: Columns of test ratios in messages of ArduPilot and of PX4.
_ARDUPILOT = {"SV": "velocity", "SP": "position", "SH": "height", "SM": "compass"}
_PX4 = {"vel": "velocity", "pos": "position", "hgt": "height", "hdg": "heading", "mag": "compass"}


def _ratios(messages: Mapping[str, pd.DataFrame], flight: Span) -> tuple[Panel, ...]:
    name = next((message for message in ("XKF4", "NKF4", "estimator_status") if message in messages), "")
    if not name:
        return ()
    frame, px4 = messages[name], name == "estimator_status"
    lane = next((column for column in ("C", "Core") if column in frame), None)
    if lane is not None:
        frame = frame[frame[lane] == frame[lane].min()]
    columns = {f"{quantity}_test_ratio": title for quantity, title in _PX4.items()} if px4 else _ARDUPILOT
    lines = [_line(title, frame[column], flight) for column, title in columns.items() if column in frame]
    return _panel("test ratio", "", lines, {"refused above": 1.0} if px4 else {"FS_EKF_THRESH": _RATIO})


def _compass(tables: Tables, flight: Span) -> tuple[Panel, ...]:
    throttle = tables.column("setpoints", "throttle")
    if tables.mag is None or throttle is None:
        return ()
    axes = tables.mag[["mag_x", "mag_y", "mag_z"]].dropna()
    field = pd.Series(1e6 * np.linalg.norm(axes.to_numpy(np.float64), axis=1), index=axes.index)
    if not len(field) or not float(field.max()) > 0.0:
        return ()
    return _panel("magnetic field", "µT", [_line("magnetic field", field, flight)]) + _panel(
        "throttle", "", [_line("throttle", throttle.dropna(), flight)]
    )
