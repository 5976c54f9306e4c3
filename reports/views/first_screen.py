"""The first screen of a flight: an answer for each purpose, beside the track and the plot that matters most."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from core.findings import Finding
from pipeline.results.answer import Picture
from pipeline.results.failure import present
from pipeline.results.flight import FlightResult
from pipeline.results.span import Span
from reports.figures.figure import (
    Drawn,
    Figure,
    Trace,
    band,
    band_label,
    layout_of,
    limit_line,
    line,
    margin,
    model_color,
    short,
    time_axis,
)
from reports.figures.flight import altitude, track
from reports.figures.signals import signal_figure

_HEIGHT = 270
_SIDE_HEIGHT = 330
#: Width of a letter above a plot, as a part of the plot's width.
_LETTER = 0.012
_PLACES = {"x": "north x", "y": "east y", "z": "up z"}
_CAPTIONS = {
    "motors": "Motor outputs (µs): who parts from the others, and when; limits dashed.",
    "attitude": "Attitude asked and flown.",
    "altitude": "Height above the start.",
}


def first_figures(result: FlightResult) -> list[Figure]:
    """Draw where it flew and what matters most; each is left out where nothing is known of it."""
    beside = track(result)
    figures = [] if beside is None else [_map(beside)]
    matters = _matters(result)
    if matters is not None:
        figures.append(matters)
    return figures


def _map(figure: Figure) -> Figure:
    """Leave the map's legend to its caption, which takes less room."""
    wind = next((note["hovertext"] for note in figure.layout["annotations"] if note.get("name") == "wind"), "")
    events = any(trace["name"] == "events" for trace in figure.data)
    measured = any(trace["name"] == "GPS" for trace in figure.data)
    marks = [
        "Coloured by height",
        f"○ start, ■ end{', × events' if events else ''}{', grey dots GPS' if measured else ''}",
        *([f"arrow: {wind}"] if wind else []),
    ]
    layout = figure.layout | {"showlegend": False, "margin": figure.layout["margin"] | {"t": 12}}
    return replace(figure, height=_SIDE_HEIGHT, caption="; ".join(marks) + ".", layout=layout)


def _matters(result: FlightResult) -> Figure | None:
    answer = present(result.answer)
    picture = Picture.ALTITUDE if answer is None else answer.picture
    around = None if answer is None else answer.around
    drawn = {
        Picture.MOTORS: lambda: _motors(result),
        Picture.PREDICTION: lambda: _prediction(result),
        Picture.ALTITUDE: lambda: altitude(result),
    }.get(picture, lambda: signal_figure(result, str(picture)))()
    if drawn is None:
        return None
    layout = dict(drawn.layout)
    if around is not None:
        shown = Span(around.start, _end(drawn, around.stop))
        layout["annotations"] = [*layout.get("annotations", ()), *_names(result, shown)]
        layout["xaxis"] = layout["xaxis"] | {"range": [shown.start, shown.stop]}
    caption = drawn.caption
    if picture is not Picture.ATTITUDE or any(trace["name"] == "asked" for trace in drawn.data):
        caption = _CAPTIONS.get(str(picture), caption)
    flight = present(result.flight)
    if around is not None and flight is not None and around.duration < 0.9 * flight.duration:
        caption += f" {around.duration:.0f} of {flight.duration:.0f} s are shown."
    # A stretch of its own must not pull the other plots along, nor be pulled by them.
    return replace(
        drawn, id=f"first-{picture}", height=_HEIGHT, layout=layout, caption=caption, time=drawn.time and around is None
    )


def _names(result: FlightResult, around: Span) -> list[Drawn]:
    """Name what happened above its line, the gravest first, as many as do not cover each other."""
    names: list[Drawn] = []
    taken: list[tuple[float, float]] = []
    for event, t in _notable(result):
        text = event.id.replace("-", " ")
        width = _LETTER * len(text) * around.duration
        ends = t + width > around.stop
        low, high = (t - width, t) if ends else (t, t + width)
        if around.start <= t <= around.stop and all(high <= other[0] or low >= other[1] for other in taken):
            taken.append((low, high))
            names.append(band_label(Span(t, t), text) | {"xanchor": "right" if ends else "left"})
    return names


def _end(figure: Figure, stop: float) -> float:
    """Return where a stretch of time ends that is drawn: a crash ends many lines, and nothing is to be seen after."""
    last = max((float(trace["x"][-1]) for trace in figure.data if len(trace["x"])), default=stop)
    return min(stop, last + 0.3)


def _motors(result: FlightResult) -> Figure | None:
    """Draw all motor outputs in one plot, and when it happened."""
    if result.motors is None or result.motors.shape[1] == 0:
        return None
    answer = present(result.answer)
    around = None if answer is None else answer.around
    span = around or margin(present(result.flight))
    table = result.motors if span is None else result.motors.loc[span.start : span.stop]
    if len(table) < 2:
        return None
    data = [
        line(table.index, table.iloc[:, k].to_numpy(float), str(name).removeprefix("m"), f"@c{k % 8 + 1}", 1.4, 0)
        for k, name in enumerate(table.columns)
    ]
    signals = present(result.signals)
    shapes = [] if signals is None else [limit_line(each, "y") for each in signals.motor_limits.values()]
    shapes += _happened(result)
    layout = layout_of(xaxis=time_axis(span), yaxis={"title": {"text": "output (µs)"}}, shapes=shapes)
    return Figure("first-motors", _CAPTIONS["motors"], data, layout, _HEIGHT)


def _notable(result: FlightResult) -> list[tuple[Finding, float]]:
    """List what happened with its times, the gravest first."""
    account = present(result.account)
    return [(each, each.t) for each in (() if account is None else account.notable) if each.t is not None]


def _happened(result: FlightResult) -> list[Drawn]:
    """Draw a line at each happening that endangered the flight."""
    return [
        {
            "type": "line",
            "xref": "x",
            "yref": "paper",
            "x0": t,
            "x1": t,
            "y0": 0,
            "y1": 1,
            "line": {"color": "@bad", "width": 1.5, "dash": "dot"},
        }
        for event, t in _notable(result)[:20]
        if str(event.severity) == "error"
    ]


def _prediction(result: FlightResult) -> Figure | None:
    """Draw measured position and the free run of the model with the least error, on what it was not fitted to."""
    answer = present(result.answer)
    key = "" if answer is None else answer.model
    model = next((each for each in result.models if each.key == key and each.predictions), None)
    if model is None:
        return None
    part = next((each for each in model.predictions if not each.training), model.predictions[0])
    outputs = part.experiment.output_names
    row = 1.0 / len(outputs)
    data: list[Trace] = []
    axes: Drawn = {}
    for k, output in enumerate(outputs):
        suffix = "" if k == 0 else str(k + 1)
        truth, predicted = part.experiment.y[:, k], part.y_hat[:, k]
        for values, name, color in (
            (truth, "measured", "@ink"),
            (predicted, short(model.title), model_color(model.key)),
        ):
            trace = line(part.experiment.t, values, name, color, 1.8)
            data.append(trace | {"yaxis": f"y{suffix}", "showlegend": k == 0})
        low, high = float(np.nanmin(truth)), float(np.nanmax(truth))
        reach = max(high - low, 0.5)
        axes[f"yaxis{suffix}"] = {
            "domain": [1.0 - (k + 0.86) * row, 1.0 - k * row],
            "title": {"text": f"{_PLACES.get(output, output)} (m)", "font": {"size": 10}},
            "nticks": 3,
            # A free run that leaves must not flatten what was measured.
            "range": [low - 0.6 * reach, high + 0.6 * reach],
        }
    axes["xaxis"] = time_axis(part.span) | {"anchor": f"y{len(outputs)}" if len(outputs) > 1 else "y"}
    shapes = [] if not part.training else [band(part.span, "@band", 1.0)]
    layout = layout_of(**axes, shapes=shapes)
    where = "fitted to" if part.training else "held out"
    caption = f"Position in the part {where}: measured, and free run of the model from its inputs alone."
    return Figure("first-prediction", caption, data, layout, _HEIGHT, time=False)
