"""The plots of a report, as Plotly figures in plain dicts.

Colours are names such as ``"@ink"`` that the page replaces by those of its light or dark theme; the same name means the
same thing in every plot: ``@ink`` measured, ``@gps``, ``@baro``, and for every kind of model its own (`MODEL_COLORS`),
drawn through for joint models and dotted for those of a single flight. Figures whose `time` is true share one time
axis.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import pandas as pd
import pymap3d
from numpy.typing import ArrayLike, NDArray

from logparse import Geodetic
from pipeline.results import FlightResult, ModelResult, Prediction, Span
from reports.numbers import mode_spans
from sysid import Experiment

#: Most points that one line of a plot is drawn with; more cannot be told apart on a screen.
MOST_POINTS = 1500
#: Samples further apart than this, s, are not joined by a line.
LONGEST_JOIN = 1.5
TIME_TITLE = "time on the log’s clock (s)"


#: Colour of each kind of model, everywhere; further kinds share the last.
MODEL_COLORS = {"motors": "@own", "mixer": "@mixer", "reference": "@joint", "rigid_body": "@body"}

Trace = dict[str, Any]
Frame = TypeVar("Frame", pd.DataFrame, "pd.Series[Any]")


@dataclass(frozen=True, slots=True)
class Figure:
    """One plot of the page.

    Attributes
    ----------
    id : str
        Of its element in the page.
    caption : str
        What to see in it.
    data, layout : list and dict
        As Plotly takes them.
    height : int
        Pixels.
    time : bool
        Whether its x axis is the time shared by the page.
    """

    id: str
    caption: str
    data: list[Trace]
    layout: dict[str, Any]
    height: int
    time: bool = True


def flight_figures(result: FlightResult, joint: Sequence[ModelResult] = ()) -> list[Figure]:
    """Draw what was flown and how the models did; a plot whose data is missing is left out.

    Parameters
    ----------
    result : FlightResult
    joint : sequence of ModelResult
        Models of the craft, with their predictions of this flight only.
    """
    candidates = (track(result), altitude(result), motors(result), prediction(result, joint))
    return [figure for figure in candidates if figure is not None]


def track(result: FlightResult) -> Figure | None:
    """Draw the flight seen from above, east to the right and north up, with equal scales."""
    data: list[Trace] = []
    span = result.flight
    if result.trajectory is not None and not result.position_known:
        return None
    if result.trajectory is not None:
        states = _within(result.trajectory.states, span)
        if states.empty:
            return None
        north, east = states["p_n"].to_numpy(), states["p_e"].to_numpy()
        gps = _gps_offsets(result)
        if gps is not None:
            data.append(_dots(gps[1], gps[0], "GPS", "@gps"))
        hover = "%{x:.1f} m east<br>%{y:.1f} m north"
        data.append(line(east, north, "flown", "@ink", hover=hover, time=states.index.to_numpy(dtype=float)))
        for at, label, symbol in ((0, "start", "circle-open"), (-1, "end", "square")):
            data.append(
                {
                    "type": "scatter",
                    "mode": "markers",
                    "x": _rounded(east[[at]], 2),
                    "y": _rounded(north[[at]], 2),
                    "name": label,
                    "marker": {"symbol": symbol, "size": 10, "color": "@ink", "line": {"width": 2}},
                    "hoverinfo": "name",
                }
            )
    else:
        gps = _gps_offsets(result)
        if gps is None:
            return None
        data.append(_dots(gps[1], gps[0], "GPS", "@gps"))
    layout = layout_of(
        xaxis={"title": {"text": "east (m)"}, "zeroline": False, "range": _padded(data, "x")},
        yaxis={
            "title": {"text": "north (m)"},
            "zeroline": False,
            "range": _padded(data, "y"),
            "scaleanchor": "x",
            "scaleratio": 1,
        },
    )
    return Figure(
        "track",
        "The flight from above, both axes to the same scale, metres from the origin of the local frame.",
        data,
        layout,
        430,
        time=False,
    )


def altitude(result: FlightResult) -> Figure | None:
    """Draw height above the start of the flight as estimated and as the sensors saw it."""
    data: list[Trace] = []
    span = _margin(result.flight)
    for table, column, name, color in (
        (result.baro, "alt", "barometer", "@baro"),
        (result.gps, "alt", "GPS", "@gps"),
    ):
        if table is not None and column in table:
            values = _within(table[column], span).dropna()
            if len(values) > 1:
                data.append(line(values.index, values - _start(values, result.flight), name, color, width=1.2))
    if result.trajectory is not None:
        up = -_within(result.trajectory.states["p_d"], span)
        if len(up) > 1:
            data.append(line(up.index, up - _start(up, result.flight), "estimated", "@ink"))
    if not data:
        return None
    layout = layout_of(
        xaxis=_time_axis(span),
        yaxis={"title": {"text": "height (m)"}},
        **_modes(result),
    )
    caption = (
        "Height above the start of the flight. The estimate should run between barometer and GPS. "
        "Bands are flight modes."
    )
    return Figure("altitude", caption, data, layout, 300)


def motors(result: FlightResult) -> Figure | None:
    """Draw the commands of every motor in a row of its own."""
    if result.motors is None or result.motors.shape[1] == 0:
        return None
    span = _margin(result.flight)
    table = _within(result.motors, span)
    if len(table) < 2:
        return None
    count = table.shape[1]
    values = table.to_numpy(dtype=float)
    inside = _within(result.motors, result.flight).to_numpy(dtype=float)
    used = inside[np.isfinite(inside)]
    if used.size == 0:
        return None
    low, high = (float(v) for v in np.percentile(used, [0.5, 99.5]))
    pad = max(0.15 * (high - low), 10.0)
    row = 1.0 / count
    data: list[Trace] = []
    axes: dict[str, Any] = {}
    labels = []
    for number in range(count):
        suffix = "" if number == 0 else str(number + 1)
        name = str(table.columns[number]).removeprefix("m")
        data.append(
            line(table.index, values[:, number], f"motor {name}", "@ink", width=1.0, decimals=0)
            | {"yaxis": f"y{suffix}", "showlegend": False}
        )
        top = 1.0 - number * row
        axes[f"yaxis{suffix}"] = {
            "domain": [top - row * 0.86, top],
            "range": [low - pad, high + pad],
            "nticks": 3,
            "tickfont": {"size": 10},
        }
        labels.append(
            {
                "text": plotly_text(name),
                "x": 0,
                "xref": "paper",
                "xanchor": "right",
                "xshift": -40,
                "y": 0.5,
                "yref": f"y{suffix} domain",
                "showarrow": False,
                "font": {"size": 13},
            }
        )
    axes["xaxis"] = _time_axis(span) | {"anchor": f"y{count}" if count > 1 else "y"}
    modes = _modes(result)
    modes["annotations"] += labels
    layout = layout_of(**axes, **modes)
    caption = (
        "PWM command of every motor (µs), one row for each motor number, all to the same scale. "
        "Motors of a healthy craft in hover stay close to each other and away from their limits."
    )
    return Figure("motors", caption, data, layout, 70 + 58 * count)


def prediction(result: FlightResult, joint: Sequence[ModelResult] = ()) -> Figure | None:
    """Draw measured and predicted x, y and z, each with its residual below; nothing without a prediction."""
    parts = [part for each in (*result.models, *joint) for part in each.predictions]
    if not parts:
        return None
    return compare(result.experiment or parts[0].experiment, result.models, joint, result.flight)


def compare(
    whole: Experiment,
    models: Sequence[ModelResult],
    joint: Sequence[ModelResult] = (),
    span: Span | None = None,
    *,
    measured: bool = True,
) -> Figure:
    """Draw free runs beside what was measured.

    Parameters
    ----------
    whole : Experiment
        The flight, whose first sample is the zero of what is drawn.
    models, joint : sequence of ModelResult
        Of the flight alone, and of its craft.
    span : Span, optional
        The time shown.
    measured : bool
        Whether the experiment's outputs were measured; if not, predictions stand alone.
    """
    drawn = list(_drawn(models, joint))
    outputs = whole.output_names
    block = 1.0 / len(outputs)
    data: list[Trace] = []
    axes: dict[str, Any] = {}
    for number, output in enumerate(outputs):
        main = "" if number == 0 else str(2 * number + 1)
        below = str(2 * number + 2)
        top = 1.0 - number * block
        first = number == 0
        truth = whole.y[:, number] if measured else drawn[0].part.y_hat[:, number]
        if measured:
            data.append(
                line(whole.t, truth, "measured", "@ink", width=2.2)
                | {"yaxis": f"y{main}", "legendgroup": "measured", "showlegend": first}
            )
        shown = [truth]
        for run in drawn:
            part = run.part
            offset = _alignment(whole, part, number)
            y_hat = part.y_hat[:, number] + offset
            y = part.experiment.y[:, number] + offset
            style: Trace = {"legendgroup": run.name, "visible": True if run.visible else "legendonly"}
            for values, name, axis, width in (
                (y_hat, run.name, main, 1.6),
                (y - y_hat, f"residual, {run.name}", below, 1.2),
            )[: 2 if measured else 1]:
                run_line = line(part.experiment.t, values, name, run.color, width=width)
                run_line["line"]["dash"] = run.dash
                legend = first and axis == main and run.first
                data.append(run_line | {"yaxis": f"y{axis}", "showlegend": legend} | style)
            shown.append(y_hat)
        axes[f"yaxis{main}"] = {
            "domain": [top - block * (0.60 if measured else 0.90), top],
            "title": {"text": f"{output} (m)"},
            "range": _readable_range(truth, shown),
        }
        if not measured:
            continue
        axes[f"yaxis{below}"] = {
            "domain": [top - block * 0.90, top - block * 0.65],
            "title": {"text": "residual (m)", "font": {"size": 10}},
            "nticks": 4,
            "zeroline": True,
        }
    last = 2 * len(outputs) - (0 if measured else 1)
    axes["xaxis"] = _time_axis(_margin(span)) | {"anchor": f"y{last}" if last > 1 else "y"}
    split = any(run.own and run.part.training for run in drawn)
    held = next((run.part for run in drawn if split and run.own and not run.part.training), None)
    bands = [] if held is None else [_band(held.span, "@held", 0.10)]
    labels = [] if held is None else [_band_label(held.span, "held out")]
    layout = layout_of(**axes, shapes=bands, annotations=labels)
    layout["margin"] = layout["margin"] | {"t": 46 + 20 * (len({run.name for run in drawn}) // 3)}
    caption = (
        "Position x (north), y (east) and z (up) as measured, and as the models predict it from their inputs and the "
        "initial state alone; below each its residual."
        if measured
        else "Position as the models predict it from the inputs, from rest."
    )
    if held is not None:
        caption += " Judge a flight’s own models by the shaded part, which the fit has not seen."
    if any(not run.visible for run in drawn):
        caption += " Click a name in the legend to show or hide it."
    return Figure("prediction", caption, data, layout, 240 * len(outputs))


@dataclass(frozen=True, slots=True)
class _Run:
    """A free run as a line: `own` of this flight's model, else of the craft's joint one."""

    part: Prediction
    name: str
    color: str
    dash: str
    own: bool
    visible: bool
    first: bool


def _drawn(own: Sequence[ModelResult], joint: Sequence[ModelResult]) -> Iterable[_Run]:
    """Joint models stand for the craft; where there are any, a flight's own models wait in the legend."""
    any_joint = any(result.predictions for result in joint)
    for result in own:
        for number, part in enumerate(result.predictions):
            name = f"{short(result.title)}, own" if any_joint else short(result.title)
            dash = "dot" if any_joint else "solid"
            yield _Run(part, name, model_color(result.key), dash, True, not any_joint, number == 0)
    for result in joint:
        for part in result.predictions:
            yield _Run(part, f"{short(result.title)}, joint", model_color(result.key), "solid", False, True, True)


def short(title: str) -> str:
    """Leave out of a model's title what legends have no room for: where it leads to."""
    return title.partition(" →")[0]


def model_color(key: str) -> str:
    """Give the colour that a kind of model has everywhere."""
    return MODEL_COLORS.get(key, "@body")


def _alignment(whole: Any, part: Prediction, column: int) -> float:
    """Offset between the zero of a part's outputs and that of the whole flight's, m."""
    at = int(np.searchsorted(whole.t, part.experiment.t[0] - 1e-6))
    return float(whole.y[min(at, len(whole.t) - 1), column] - part.experiment.y[0, column])


def _readable_range(measured: NDArray[np.float64], shown: Sequence[NDArray[np.float64]]) -> list[float]:
    """Keep the measured signal readable when a prediction runs away: at most three times its span."""
    low, high = float(np.nanmin(measured)), float(np.nanmax(measured))
    span = max(high - low, 0.5)
    values = np.concatenate(shown)
    values = values[np.isfinite(values)]
    low_all, high_all = max(float(values.min()), low - span), min(float(values.max()), high + span)
    return [min(low, low_all) - 0.06 * span, max(high, high_all) + 0.06 * span]


def layout_of(**parts: Any) -> dict[str, Any]:
    """Lay a plot out as all of a report are: transparent, legend above, quiet grid."""
    base: dict[str, Any] = {
        "margin": {"l": 58, "r": 14, "t": 46, "b": 44},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": "@text"},
        "legend": {"orientation": "h", "x": 0, "y": 1, "yref": "container", "yanchor": "top"},
        "hovermode": "closest",
    }
    base.update(parts)
    for name, axis in base.items():
        if name.startswith(("xaxis", "yaxis")):
            base[name] = {
                "gridcolor": "@grid",
                "linecolor": "@grid",
                "zerolinecolor": "@grid",
                "automargin": False,
            } | axis
    return base


def _time_axis(span: Span | None) -> dict[str, Any]:
    axis: dict[str, Any] = {"title": {"text": TIME_TITLE}, "hoverformat": ".1f"}
    return axis if span is None else axis | {"range": [span.start, span.stop]}


def _modes(result: FlightResult) -> dict[str, Any]:
    """Draw flight modes as quiet bands, every other one tinted, with their names on top."""
    shapes, labels = [], []
    for number, mode in enumerate(mode_spans(result)):
        span = Span(mode["start_s"], mode["stop_s"])
        if number % 2 == 1:
            shapes.append(_band(span, "@band", 1.0))
        if result.flight is not None and span.duration > 0.06 * result.flight.duration:
            labels.append(_band_label(span, str(mode["mode"])))
    return {"shapes": shapes, "annotations": labels}


def _band(span: Span, color: str, opacity: float) -> dict[str, Any]:
    return {
        "type": "rect",
        "xref": "x",
        "yref": "paper",
        "x0": span.start,
        "x1": span.stop,
        "y0": 0,
        "y1": 1,
        "fillcolor": color,
        "opacity": opacity,
        "line": {"width": 0},
        "layer": "below",
    }


def _band_label(span: Span, text: str) -> dict[str, Any]:
    return {
        "x": span.start,
        "y": 1,
        "xref": "x",
        "yref": "paper",
        "xanchor": "left",
        "yanchor": "bottom",
        "text": plotly_text(text),
        "showarrow": False,
        "font": {"size": 11, "color": "@quiet"},
    }


def plotly_text(text: str) -> str:
    """Escape text for Plotly, which reads some HTML in labels."""
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def line(
    x: ArrayLike,
    y: ArrayLike,
    name: str,
    color: str,
    width: float = 2.0,
    decimals: int = 3,
    hover: str | None = None,
    time: NDArray[np.float64] | None = None,
) -> Trace:
    """Draw y over x as a line, broken where `time` (x when not given) has a gap."""
    step = max(1, -(-np.size(x) // MOST_POINTS))
    xs, ys = np.asarray(x, dtype=float)[::step], np.asarray(y, dtype=float)[::step]
    time = xs if time is None else time[::step]
    # A line across a gap would show what nobody measured.
    gaps = np.flatnonzero(np.diff(time) > max(LONGEST_JOIN, 5.0 * float(np.median(np.diff(time))))) + 1
    return {
        "type": "scatter",
        "mode": "lines",
        "x": _rounded(np.insert(xs, gaps, np.nan), 3),
        "y": _rounded(np.insert(ys, gaps, np.nan), decimals),
        "name": name,
        "line": {"color": color, "width": width},
        "hovertemplate": f"{hover or '%{x:.1f} s: %{y:.4g}'}<extra>{name}</extra>",
    }


def _padded(data: Iterable[Trace], axis: str) -> list[float]:
    """Range of an axis with room around what is drawn."""
    values = [value for trace in data for value in trace[axis] if value is not None]
    pad = max(0.06 * (max(values) - min(values)), 0.5)
    return [min(values) - pad, max(values) + pad]


def _dots(x: ArrayLike, y: ArrayLike, name: str, color: str) -> Trace:
    trace = line(x, y, name, color, time=np.arange(np.size(x), dtype=float))
    del trace["line"]
    return trace | {"mode": "markers", "marker": {"color": color, "size": 4}, "hoverinfo": "skip"}


def _rounded(values: NDArray[np.float64], decimals: int) -> list[float | None]:
    return [float(value) if np.isfinite(value) else None for value in np.round(values, decimals)]


def _within(table: Frame, span: Span | None) -> Frame:
    return table if span is None else table.loc[span.start : span.stop]


def _margin(span: Span | None) -> Span | None:
    return None if span is None else Span(span.start - 0.02 * span.duration, span.stop + 0.02 * span.duration)


def _start(values: pd.Series, flight: Span | None) -> float:
    """Value at the start of the flight: heights are drawn relative to it."""
    if flight is None:
        return float(values.iloc[0])
    return float(values.iloc[min(int(values.index.searchsorted(flight.start)), len(values) - 1)])


def _gps_offsets(result: FlightResult) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
    """Give the GPS fixes in metres north and east of the trajectory's origin, else of the first fix."""
    if result.gps is None:
        return None
    table = _within(result.gps[["lat", "lon"]], result.flight).dropna()
    if len(table) < 2:
        return None
    lat, lon = table["lat"].to_numpy(dtype=float), table["lon"].to_numpy(dtype=float)
    origin = Geodetic(lat[0], lon[0], 0.0)
    if result.trajectory is not None:
        origin = result.trajectory.origin
        if not np.isfinite([origin.lat, origin.lon, origin.alt]).all():
            return None
    north, east, _ = pymap3d.geodetic2ned(lat, lon, origin.alt, origin.lat, origin.lon, origin.alt, deg=False)
    return np.asarray(north), np.asarray(east)
