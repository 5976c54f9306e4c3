"""The plots of one flight: where it went, how high, and what the motors were told."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pymap3d
from numpy.typing import NDArray

from core.quantity import uncertain
from logparse import Finding, Geodetic
from logparse.heights import above_ground
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.span import Span
from reports.figures.figure import (
    MOST_POINTS,
    Drawn,
    Figure,
    Plot,
    Trace,
    band,
    band_label,
    dots,
    line,
    margin,
    marks,
    padded,
    plotly_text,
    rounded,
    suffix,
    time_axis,
)
from reports.numbers.flight import mode_spans
from sysid.rigid_body.conditions.wind import WIND_HEIGHT

#: Colours of the sources of height.
_HEIGHTS = {"barometer": "@baro", "autopilot": "@own", "GPS": "@gps"}
#: Length of the wind's arrow, pixels.
_ARROW = 34

Floats = NDArray[np.float64]
Frame = TypeVar("Frame", pd.DataFrame, "pd.Series[Any]")


def flight_figures(result: FlightResult) -> list[Figure]:
    """Draw what was flown; a plot whose data is missing is left out."""
    candidates = (track(result), altitude(result), motors(result))
    return [figure for figure in candidates if figure is not None]


def track(result: FlightResult) -> Figure | None:
    """Draw the flight seen from above, east to the right and north up, with equal scales."""
    gps = _gps_offsets(result)
    if isinstance(result.trajectory, Failure):
        if gps is None:
            return None
        north, east = gps
        way = line(east, north, "GPS", "@gps", 1.2, time=np.arange(len(east), dtype=float))
        return _map([way], east, north, _wind_arrow(result))
    states = _within(result.trajectory.states, present(result.flight))
    if states.empty or not result.position_known:
        return None
    happened = _happened(result, states)
    over = [] if happened is None else [happened]
    return track_figure(states, [] if gps is None else [dots(gps[1], gps[0], "GPS", "@gps")], over, _wind_arrow(result))


def track_figure(
    states: pd.DataFrame, below: Sequence[Trace] = (), over: Sequence[Trace] = (), notes: Sequence[Drawn] = ()
) -> Figure:
    """Draw the track of a trajectory's states between what is drawn below and over it."""
    north, east = states["p_n"].to_numpy(), states["p_e"].to_numpy()
    hover = "%{x:.1f} m east<br>%{y:.1f} m north"
    way = line(east, north, "flown", "@quiet", 0.8, hover=hover, time=states.index.to_numpy(dtype=float))
    return _map([*below, way, _heights(states), *over], east, north, notes)


def _map(traces: Sequence[Trace], east: Floats, north: Floats, notes: Sequence[Drawn]) -> Figure:
    plot = Plot({"title": {"text": "north (m)"}, "zeroline": False, "scaleanchor": "x", "scaleratio": 1}, x="east (m)")
    for trace in traces:
        plot.add(trace)
    for at, label, symbol in ((0, "start", "circle-open"), (-1, "end", "square")):
        plot.add(marks(east[[at]], north[[at]], label, "@ink", symbol=symbol, size=10), hoverinfo="name")
    plot.axes["xaxis"] |= {"range": padded(plot.data, "x"), "zeroline": False}
    plot.axes["yaxis"] |= {"range": padded(plot.data, "y")}
    plot.notes += notes
    caption = "The flight from above, both axes to the same scale; colour is height above the start."
    return plot.figure("track", caption, 430)


def _heights(states: pd.DataFrame) -> Trace:
    """Colour the track by height, with a scale that also reads in grey."""
    chosen = states.iloc[:: max(1, -(-len(states) // MOST_POINTS))]
    height = float(states["p_d"].iloc[0]) - chosen["p_d"].to_numpy(float)
    trace = dots(chosen["p_e"], chosen["p_n"], "height", "@ink") | {"showlegend": False, "hoverinfo": "all"}
    scale = {"title": {"text": "height (m)", "side": "right"}, "thickness": 8, "outlinewidth": 0}
    colors = {"color": rounded(height, 1), "colorscale": "Cividis", "showscale": True, "colorbar": scale}
    hover = "%{marker.color:.1f} m above the start<extra></extra>"
    return trace | {"marker": {"size": 5} | colors, "hovertemplate": hover}


def _happened(result: FlightResult, states: pd.DataFrame) -> Trace | None:
    """Mark where notable events began."""
    inside = [(each, t) for each, t in notable(result) if states.index[0] <= t <= states.index[-1]][:40]
    if not inside:
        return None
    at = np.clip(states.index.searchsorted([t for _, t in inside]), 0, len(states) - 1)
    east, north = (states[name].to_numpy(float)[at] for name in ("p_e", "p_n"))
    text = [f"{each.id.replace('-', ' ')}, {t:.1f} s" for each, t in inside]
    hover = "%{text}<extra></extra>"
    return marks(east, north, "events", "@bad", symbol="x", size=10, text=text, hover=hover)


def notable(result: FlightResult) -> list[tuple[Finding, float]]:
    """List what happened with its times, the gravest first."""
    account = present(result.account)
    return [(each, each.t) for each in (() if account is None else account.notable) if each.t is not None]


def _wind_arrow(result: FlightResult) -> list[Drawn]:
    """Draw where the wind goes, beside the map's corner; nothing where it is not known better than its error."""
    wind = None if isinstance(result.coverage, Failure) else result.coverage.wind
    if wind is None or wind.sigma is None:
        return []
    speed = wind.speed
    if not np.isfinite(speed) or not speed > 2.0 * wind.sigma:
        return []
    east, north = wind.east / speed, wind.north / speed
    place = {"name": "wind", "xref": "paper", "yref": "paper", "x": 0.03, "y": 0.86, "text": ""}
    arrow = {"ax": -_ARROW * east, "ay": _ARROW * north, "arrowhead": 2, "arrowwidth": 2, "arrowcolor": "@own"}
    arrow |= {"xshift": _ARROW // 2 + _ARROW // 2 * east, "yshift": _ARROW // 2 * north, "showarrow": True}
    # A flight at 40 m in sheared air has met twice as much.
    return [place | arrow | {"hovertext": f"wind {uncertain(speed, wind.sigma, 'm/s')} at {WIND_HEIGHT:g} m"}]


def altitude(result: FlightResult) -> Figure | None:
    """Draw height above the ground that the flight left, by every sensor, and as estimated."""
    span = margin(present(result.flight))
    plot = Plot("height (m)", x=time_axis(span), **mode_bands(result))
    signals = present(result.signals)
    for panel in () if signals is None else signals.height:
        for signal in panel.signals:
            plot.add(line(signal.t, signal.y, signal.name, _HEIGHTS.get(signal.name, "@quiet"), width=1.4))
    reach = padded(plot.data[:1], "y") if plot.data else None
    if not isinstance(result.trajectory, Failure):
        up, flight = -result.trajectory.states["p_d"], present(result.flight)
        above = _within(up - up.iloc[0] if flight is None else above_ground(up, flight), span)
        if len(above) > 1:
            plot.add(line(above.index, above, "estimated", "@ink", width=1.4))
    if not plot.data:
        return None
    if reach is not None:
        # A receiver or an estimate that runs away must not flatten what the barometer shows.
        beyond = 0.5 * (reach[1] - reach[0])
        plot.axes["yaxis"] |= {"range": [reach[0] - beyond, reach[1] + beyond]}
    caption = "Height above the ground that the flight left. Bands are flight modes."
    return plot.figure("altitude", caption, 300, time=True)


def motors(result: FlightResult) -> Figure | None:
    """Draw the commands of every motor in a row of its own."""
    if result.motors is None or result.motors.shape[1] == 0:
        return None
    span = margin(present(result.flight))
    table = _within(result.motors, span)
    if len(table) < 2:
        return None
    count = table.shape[1]
    values = table.to_numpy(dtype=float)
    inside = _within(result.motors, present(result.flight)).to_numpy(dtype=float)
    used = inside[np.isfinite(inside)]
    if used.size == 0:
        return None
    low, high = float(used.min()), float(used.max())
    pad = max(0.15 * (high - low), 10.0)
    axis = {"range": [low - pad, high + pad], "nticks": 3, "tickfont": {"size": 10}}
    plot = Plot(*[axis] * count, x=time_axis(span))
    modes = mode_bands(result)
    plot.shapes, plot.notes = modes["shapes"], modes["annotations"]
    signals = present(result.signals)
    limits = [] if signals is None else [v for v in signals.motor_limits.values() if low - pad < v < high + pad]
    for number in range(count):
        name = str(table.columns[number]).removeprefix("m")
        commands = line(table.index, values[:, number], f"motor {name}", "@ink", width=1.0, decimals=0)
        plot.add(commands, number, legend=False)
        place = {"x": 0, "xref": "paper", "xanchor": "right", "xshift": -40, "y": 0.5}
        place |= {"yref": f"y{suffix(number)} domain", "showarrow": False, "font": {"size": 13}}
        plot.notes.append(place | {"text": plotly_text(name)})
        for value in limits:
            plot.limit(value, number)
    caption = f"PWM command of every motor (µs), all to the same scale{', limits dashed' if limits else ''}."
    return plot.figure("motors", caption, 70 + 58 * count, time=True)


def mode_bands(result: FlightResult) -> Drawn:
    """Draw flight modes as quiet bands, every other one tinted, with their names on top."""
    shapes, labels = [], []
    for number, mode in enumerate(mode_spans(result)):
        span = Span(mode.start_s, mode.stop_s)
        if number % 2 == 1:
            shapes.append(band(span, "@band", 1.0))
        if not isinstance(result.flight, Failure) and span.duration > 0.06 * result.flight.duration:
            labels.append(band_label(span, mode.mode))
    return {"shapes": shapes, "annotations": labels}


def _within(table: Frame, span: Span | None) -> Frame:
    return table if span is None else table.loc[span.start : span.stop]


def _gps_offsets(result: FlightResult) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Return the GPS fixes in metres north and east of the trajectory's origin, else of the first fix."""
    if result.gps is None:
        return None
    table = _within(result.gps[["lat", "lon"]], present(result.flight)).dropna()
    if len(table) < 2:
        return None
    lat, lon = table["lat"].to_numpy(dtype=float), table["lon"].to_numpy(dtype=float)
    origin = Geodetic(lat[0], lon[0], 0.0)
    if not isinstance(result.trajectory, Failure):
        origin = result.trajectory.origin
        if not np.isfinite([origin.lat, origin.lon, origin.alt]).all():
            return None
    north, east, _ = pymap3d.geodetic2ned(lat, lon, origin.alt, origin.lat, origin.lon, origin.alt, deg=False)
    return np.asarray(north), np.asarray(east)
