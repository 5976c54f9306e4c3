"""Plots of one flight: track, height and motor commands, and those of the first screen.

Plots that need the result itself are drawn once and stored, so that pages can be rendered again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pymap3d
from numpy.typing import NDArray

from core.findings import Happening
from core.quantity import uncertain
from logparse import Geodetic
from logparse.heights import above_ground
from pipeline.flight.summary import mode_spans
from pipeline.results.answer import Picture
from pipeline.results.craft import GroupResult
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.report import FlightReport
from pipeline.results.signals import Panel, SignalLine
from pipeline.results.span import Span, within
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
    mark_line,
    marks,
    over_time,
    padded,
    plotly_text,
    rounded,
    suffix,
    time_axis,
)
from reports.figures.models import Board, joint_predictions, model_board, off_by_default, prediction
from reports.figures.signals import signal_figure, signal_figures
from sysid.rigid_body.model_record import WIND_HEIGHT

#: Colours of the sources of height.
_HEIGHTS = {"barometer": "@baro", "autopilot": "@own", "GPS": "@gps"}
#: Length of the wind's arrow, pixels.
_ARROW = 34

Floats = NDArray[np.float64]
Frame = TypeVar("Frame", pd.DataFrame, "pd.Series[Any]")


def flight_figures(result: FlightResult) -> list[Figure]:
    """Draw track, height and motors; a plot whose data is missing is left out."""
    candidates = (track(result), altitude(result), motors(result))
    return [figure for figure in candidates if figure is not None]


def track(result: FlightResult) -> Figure | None:
    """Draw the flight seen from above, east to the right and north up, with equal scales."""
    if isinstance(result.trajectory, Failure):
        account = present(result.account)
        doubtful = () if account is None else account.doubtful
        gps = _gps_offsets(result, doubtful)
        if gps is None:
            return None
        north, east = gps
        name = "GPS, where it is credible" if doubtful else "GPS"
        path = line(east, north, name, "@gps", 1.2, time=np.arange(len(east), dtype=float))
        return _map([path], east, north, _wind_arrow(result))
    gps = _gps_offsets(result)
    states = _within(result.trajectory.states, present(result.flight))
    if states.empty or not result.position_known:
        return None
    events = _event_marks(result, states)
    over = [] if events is None else [events]
    below = [] if gps is None else [dots(gps[1], gps[0], "GPS", "@gps")]
    return track_figure(states, below, over, _wind_arrow(result), _estimated_height(result))


def track_figure(
    states: pd.DataFrame,
    below: Sequence[Trace] = (),
    over: Sequence[Trace] = (),
    notes: Sequence[Drawn] = (),
    height: pd.Series[float] | None = None,
) -> Figure:
    """Draw the track of a trajectory's states, with traces below and over it, coloured by `height` [m]."""
    north, east = states["p_n"].to_numpy(), states["p_e"].to_numpy()
    hover = "%{x:.1f} m east<br>%{y:.1f} m north"
    path = line(east, north, "flown", "@quiet", 0.8, hover=hover, time=states.index.to_numpy(dtype=float))
    return _map([*below, path, _heights(states, height), *over], east, north, notes)


def _map(traces: Sequence[Trace], east: Floats, north: Floats, notes: Sequence[Drawn]) -> Figure:
    plot = Plot({"title": {"text": "north (m)"}, "zeroline": False, "scaleanchor": "x", "scaleratio": 1}, x="east (m)")
    for trace in traces:
        plot.add(trace)
    for at, label, symbol in ((0, "start", "circle-open"), (-1, "end", "square")):
        plot.add(marks(east[[at]], north[[at]], label, "@ink", symbol=symbol, size=10), hoverinfo="name")
    plot.axes["xaxis"] |= {"range": padded(plot.data, "x"), "zeroline": False}
    plot.axes["yaxis"] |= {"range": padded(plot.data, "y")}
    plot.notes += notes
    caption = "The flight from above, both axes to the same scale; colour is height above the ground."
    return plot.figure("track", caption, 430)


def _heights(states: pd.DataFrame, height: pd.Series[float] | None) -> Trace:
    """Colour the track by height, by default above the start, in a colour scale that is readable in grey."""
    chosen = states.iloc[:: max(1, -(-len(states) // MOST_POINTS))]
    above = states["p_d"].iloc[0] - chosen["p_d"] if height is None else height.loc[chosen.index]
    trace = dots(chosen["p_e"], chosen["p_n"], "height", "@ink") | {"showlegend": False, "hoverinfo": "all"}
    scale = {"title": {"text": "height (m)", "side": "right"}, "thickness": 8, "outlinewidth": 0}
    colors = {
        "color": rounded(np.asarray(above, dtype=float), 1),
        "colorscale": "Cividis",
        "showscale": True,
        "colorbar": scale,
    }
    hover = "%{marker.color:.1f} m high<extra></extra>"
    return trace | {"marker": {"size": 5} | colors, "hovertemplate": hover}


def _event_marks(result: FlightResult, states: pd.DataFrame) -> Trace | None:
    """Mark the places where notable events began."""
    inside = [event for event in notable(result) if states.index[0] <= event.t <= states.index[-1]][:40]
    if not inside:
        return None
    at = np.clip(states.index.searchsorted([event.t for event in inside]), 0, len(states) - 1)
    east, north = (states[name].to_numpy(float)[at] for name in ("p_e", "p_n"))
    text = [f"{event.id.replace('-', ' ')}, {event.t:.1f} s" for event in inside]
    hover = "%{text}<extra></extra>"
    return marks(east, north, "events", "@bad", symbol="x", size=10, text=text, hover=hover)


def notable(result: FlightResult) -> tuple[Happening, ...]:
    """Return notable events, the most severe first."""
    account = present(result.account)
    return () if account is None else account.notable


def _wind_arrow(result: FlightResult) -> list[Drawn]:
    """Draw the wind as an arrow in the map's corner; nothing where it is below twice its sigma."""
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
    # In sheared air a flight at 40 m meets twice as much.
    return [place | arrow | {"hovertext": f"wind {uncertain(speed, wind.sigma, 'm/s')} at {WIND_HEIGHT:g} m"}]


def altitude(result: FlightResult) -> Figure | None:
    """Draw height above the take-off ground, by every sensor and as estimated."""
    flight, signals = present(result.flight), present(result.signals)
    span = margin(flight)
    lines = [] if signals is None else [signal for panel in signals.height for signal in panel.signals]
    colors = {signal.name: _HEIGHTS.get(signal.name, "@quiet") for signal in lines} | {"estimated": "@ink"}
    sensor = lines[:1]
    if (estimated := _estimated_height(result)) is not None:
        above = _within(estimated, span)
        if len(above) > 1:
            lines.append(SignalLine("estimated", above.index.to_numpy(float), above.to_numpy(float)))
    if not lines:
        return None
    plot = over_time([Panel(title="height", unit="m", signals=tuple(lines))], time_axis(span), colors=colors, width=1.4)
    plot.shapes, plot.notes = mode_bands(result)
    if sensor:
        # The range is the barometer's, so that a diverging receiver or estimate does not flatten it.
        low, high = padded(plot.data[:1], "y")
        plot.axes["yaxis"] |= {"range": [low - 0.5 * (high - low), high + 0.5 * (high - low)]}
    caption = "Height above the ground that the flight left. Bands are flight modes."
    return plot.figure("altitude", caption, 300, time=True)


def _outputs(result: FlightResult, span: Span | None) -> list[SignalLine]:
    """Return the motors' commands within a span, named by motor number."""
    table = None if result.motors is None else _within(result.motors, span)
    if table is None or len(table) < 2:
        return []
    t = table.index.to_numpy(float)
    return [SignalLine(str(name).removeprefix("m"), t, column.to_numpy(float)) for name, column in table.items()]


def _motor_limits(result: FlightResult) -> Mapping[str, float]:
    signals = present(result.signals)
    return {} if signals is None else signals.motor_limits


def motors(result: FlightResult) -> Figure | None:
    """Draw the commands of each motor in its own row."""
    span = margin(present(result.flight))
    lines = _outputs(result, span)
    flown = np.array([output.y for output in _outputs(result, present(result.flight))])
    finite = flown[np.isfinite(flown)]
    if not lines or finite.size == 0:
        return None
    low, high = float(finite.min()), float(finite.max())
    pad = max(0.15 * (high - low), 10.0)
    limits = {name: value for name, value in _motor_limits(result).items() if low - pad < value < high + pad}
    panels = [Panel(title="", unit="", signals=(signal,), limits=limits) for signal in lines]
    axis = {"range": [low - pad, high + pad], "nticks": 3, "tickfont": {"size": 10}}
    plot = over_time(panels, time_axis(span), axis=axis, width=1.0, decimals=0)
    bands, labels = mode_bands(result)
    plot.shapes = [*bands, *plot.shapes]
    for number, signal in enumerate(lines):
        place = {"x": 0, "xref": "paper", "xanchor": "right", "xshift": -40, "y": 0.5, "text": plotly_text(signal.name)}
        place |= {"yref": f"y{suffix(number)} domain", "showarrow": False, "font": {"size": 13}}
        labels.append(place)
    plot.notes = labels
    caption = f"PWM command of every motor (µs), all to the same scale{', limits dashed' if limits else ''}."
    return plot.figure("motors", caption, 70 + 58 * len(lines), time=True)


def mode_bands(result: FlightResult) -> tuple[list[Drawn], list[Drawn]]:
    """Draw flight modes as bands, every other one tinted, with their names on top."""
    shapes, labels = [], []
    for number, mode in enumerate(mode_spans(result)):
        span = Span(mode.start_s, mode.stop_s)
        if number % 2 == 1:
            shapes.append(band(span, "@band", 1.0))
        if not isinstance(result.flight, Failure) and span.duration > 0.06 * result.flight.duration:
            labels.append(band_label(span, mode.mode))
    return shapes, labels


def _estimated_height(result: FlightResult) -> pd.Series[float] | None:
    """Return the height of the trajectory above the take-off ground, m; None without a trajectory."""
    if isinstance(result.trajectory, Failure):
        return None
    up, flight = -result.trajectory.states["p_d"], present(result.flight)
    return up - up.iloc[0] if flight is None else above_ground(up, flight)


def _within(table: Frame, span: Span | None) -> Frame:
    return table if span is None else table.loc[span.start : span.stop]


def _gps_offsets(result: FlightResult, doubtful: Sequence[Span] = ()) -> tuple[Floats, Floats] | None:
    """Return the GPS fixes in metres north and east of the trajectory's origin, else of the first fix."""
    if result.gps is None:
        return None
    table = _within(result.gps[["lat", "lon"]], present(result.flight)).dropna()
    table = table[~within(table.index.to_numpy(dtype=float), doubtful)]
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


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightFigures:
    """The plots of a flight in the order of its pages."""

    first: tuple[Figure, ...]
    flight: tuple[Figure, ...]
    signals: tuple[Figure, ...]
    predicted: tuple[Figure, ...]
    board: Board


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftFigures:
    """The plots of a craft: of all models, and measured and predicted position by flight."""

    board: Board
    predictions: Mapping[str, Figure]


def draw_flight(result: FlightResult, numbers: FlightReport) -> FlightFigures:
    """Draw the plots of a flight."""
    hidden = off_by_default(numbers.models)
    first = first_figures(result)
    # What the first screen shows of the whole flight is not shown twice.
    shown = {figure.id.removeprefix("first-") for figure in first if figure.time or figure.id == "track"}
    predicted = prediction(result, hidden)
    return FlightFigures(
        first=tuple(first),
        flight=tuple(figure for figure in flight_figures(result) if figure.id not in shown),
        signals=tuple(signal_figures(result)),
        predicted=() if predicted is None else (predicted,),
        board=model_board(result.models, hidden),
    )


def draw_craft(group: GroupResult) -> CraftFigures:
    """Draw the plots of a craft."""
    hidden = off_by_default(group.report.models)
    return CraftFigures(board=model_board(group.models, hidden), predictions=joint_predictions(group, hidden))


#: Number of panels on the first screen.
_PANELS = {Picture.ATTITUDE: 3, Picture.RATES: 3, Picture.BATTERY: 2}
_CAPTIONS = {
    Picture.MOTORS: "Motor outputs.",
    Picture.ATTITUDE: "Attitude asked and flown.",
    Picture.RATES: "Angular rates asked and flown.",
    Picture.VIBRATION: "Vibration.",
    Picture.BATTERY: "Battery.",
    Picture.GPS: "GPS.",
    Picture.ALTITUDE: "",  # its axis says what it is
}


def first_figures(result: FlightResult) -> list[Figure]:
    """Draw the track and the plot that the answer names; each is left out without data."""
    ground_track = track(result)
    figures = [] if ground_track is None else [_with_ends(ground_track)]
    main = _main_plot(result, 420 if ground_track is None else 270)
    return figures if main is None else [*figures, main]


def _with_ends(figure: Figure) -> Figure:
    """Label start and end in the map instead of in a legend."""
    layout = figure.layout | {"showlegend": False, "margin": figure.layout["margin"] | {"t": 12}}
    # Labels of near places must not overlap: the northern one is above its mark. They extend towards the middle, so as
    # not to cover the colour scale.
    ends = sorted(
        (trace for trace in figure.data if trace["name"] in ("start", "end")), key=lambda trace: trace["y"][0]
    )
    middle = float(np.mean(figure.layout["xaxis"]["range"]))
    places = {
        trace["name"]: f"{place} {'left' if trace['x'][0] > middle else 'right'}"
        for trace, place in zip(ends, ("bottom", "top"), strict=False)
    }
    named = {"mode": "markers+text", "cliponaxis": False}
    data = [
        trace | named | {"textposition": places[name], "text": [name]} if name in places else trace
        for trace in figure.data
        for name in (trace["name"],)
    ]
    return replace(figure, height=330, caption=_legend_sentence(figure), data=data, layout=layout)


def _legend_sentence(figure: Figure) -> str:
    """Explain the marks of a map."""
    words = [
        "crosses: what happened"
        if trace["name"] == "events"
        else f"{'lines' if trace['mode'] == 'lines' else 'dots'}: {trace['name']}"
        for trace in figure.data
        if trace["name"] == "events" or trace["name"].startswith("GPS")
    ]
    words += [f"arrow: {note['hovertext']}" for note in figure.layout.get("annotations", ()) if note["name"] == "wind"]
    text = "; ".join(words)
    return f"{text[0].upper()}{text[1:]}." if text else ""


def _main_plot(result: FlightResult, height: int) -> Figure | None:
    """Draw the plot that the answer names."""
    answer = present(result.answer)
    picture = Picture.ALTITUDE if answer is None else answer.picture
    around = None if answer is None else answer.around
    drawn = {
        Picture.MOTORS: lambda: _motors(result, around),
        Picture.ALTITUDE: lambda: altitude(result),
    }.get(picture, lambda: signal_figure(result, str(picture), _PANELS.get(picture, 1)))()
    if drawn is None:
        return None
    layout = dict(drawn.layout)
    if around is not None:
        shown = Span(around.start, _end(drawn, around.stop))
        # Names of modes would cover those of events.
        layout["annotations"] = _event_labels(result, shown)
        events = [mark_line(event.t, "@bad", 1.5) for event in notable(result)[:20]]
        layout["shapes"] = [*_background(result, layout), *events]
        layout["xaxis"] = layout["xaxis"] | {"range": [shown.start, shown.stop]}
    # A plot of a part of the flight does not share its time axis with the others.
    return replace(
        drawn,
        id=f"first-{picture}",
        height=height,
        layout=layout,
        caption=_CAPTIONS[picture],
        time=drawn.time and around is None,
    )


def _background(result: FlightResult, layout: Drawn) -> list[Drawn]:
    """Return the bands of modes, and the plot's own limits."""
    limits = [shape for shape in layout.get("shapes", ()) if shape.get("xref") == "paper"]
    return [*mode_bands(result)[0], *limits]


def _event_labels(result: FlightResult, around: Span) -> list[Drawn]:
    """Label events above their lines, causes first, as many as do not overlap."""
    labels: list[Drawn] = []
    taken: list[tuple[float, float]] = []
    account = present(result.account)
    for event in () if account is None else account.causes_first:
        t, text = event.t, event.id.replace("-", " ")
        # Width of a letter above a plot, as a part of the plot's width.
        width = 0.012 * len(text) * around.duration
        for side, low, high in (("left", t, t + width), ("right", t - width, t)):
            free = all(high <= other[0] or low >= other[1] for other in taken)
            if free and around.start <= low and high <= around.stop:
                taken.append((low, high))
                labels.append(band_label(Span(t, t), text) | {"xanchor": side})
                break
    return labels


def _end(figure: Figure, stop: float) -> float:
    """Return the end of the time axis: soon after the data ends, as at a crash."""
    last = max((float(trace["x"][-1]) for trace in figure.data if len(trace["x"])), default=stop)
    return min(stop, last + 0.3)


def _motors(result: FlightResult, around: Span | None) -> Figure | None:
    """Draw all motor outputs in one plot."""
    span = around or margin(present(result.flight))
    lines = _outputs(result, span)
    if not lines:
        return None
    panel = Panel(title="output", unit="µs", signals=tuple(lines), limits=_motor_limits(result))
    return over_time([panel], time_axis(span), width=1.4, decimals=0).figure("first-motors", "", 270, time=True)
