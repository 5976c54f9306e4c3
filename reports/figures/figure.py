"""The one plot layer: `Plot` puts traces, bands and labels together as Plotly's JSON, `Figure` is what comes of it.

Plain dicts, because Plotly's own objects take a third of a second to import and two milliseconds a trace, which is a
fifth of the analysis of a short log. Colours are names such as ``"@ink"``, the same for the same thing in every plot:
``@ink`` measured, ``@gps``, ``@baro``, and for every kind of model its own (`MODEL_COLORS`). The page replaces them by
those of its light or dark theme, notebooks and image files by those of the light one (`Figure.light`).
"""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from math import isfinite
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core.lazy import lazy
from core.quantity import per_degree
from pipeline.flight.signals import thin
from pipeline.results.signals import Panel
from pipeline.results.span import Span

if TYPE_CHECKING:
    import plotly.graph_objects as go
else:
    go = lazy("plotly.graph_objects")

#: Most points that one line of a plot is drawn with; more cannot be told apart on a screen.
MOST_POINTS = 1500
#: Height of a row of names above a plot, pixels.
_ROW = 18

#: Colour of each kind of model, everywhere; further kinds share the last.
MODEL_COLORS = {"motors": "@own", "mixer": "@mixer", "reference": "@joint", "rigid_body": "@body"}
#: Colours of things of one kind, in their order, and how they are drawn beyond those.
COLORS = tuple(f"@c{k}" for k in range(1, 9))
DASHES = ("solid", "dash", "dot", "dashdot")

#: Part of a figure in Plotly's own JSON: a trace, an axis, a shape, a layout.
Drawn = dict[str, Any]
Trace = Drawn


@dataclass(frozen=True, slots=True)
class Figure:
    """One plot of the page."""

    id: str  #: Of its element in the page.
    caption: str  #: What to see in it.
    #: As Plotly takes them.
    data: list[Trace]
    layout: Drawn
    height: int  #: Pixels.
    time: bool = True  #: Whether its x axis is the time shared by the page.
    place: str = ""  #: Of several figures with one place the page shows one, as its reader chooses; its own when empty.

    def packed(self) -> Drawn:
        """Return what travels in a page: long lines as differences, which gzip leaves a byte a sample of."""
        drawn = {"data": [_slim(trace) for trace in self.data], "layout": self.layout | self._legend()}
        text = json.dumps(drawn, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
        packed = base64.b64encode(gzip.compress(text.encode("utf-8"), compresslevel=6, mtime=0)).decode("ascii")
        place = self.place or self.id
        return {"id": self.id, "place": place, "height": self.height, "time": self.time, "packed": packed}

    def light(self) -> Drawn:
        """Return the figure in the light theme, on white, for image files."""
        white = {"height": self.height, "paper_bgcolor": "white", "plot_bgcolor": "white"} | self._legend()
        return dict(_in_colors({"data": self.data, "layout": self.layout | white}, light_theme()))

    def _legend(self) -> Drawn:
        """Place the legend above a row of names over the plot; Plotly makes room for the rows that it takes."""
        edges = self.layout["margin"]
        inner = max(self.height - edges["t"] - edges["b"], 1)
        return {"legend": self.layout["legend"] | {"y": 1.0 + _ROW / inner, "yanchor": "bottom"}}

    def plotly(self) -> go.Figure:
        """Return Plotly's own figure, for notebooks."""
        return go.Figure(self.light())


def light_theme() -> Mapping[str, str]:
    """Return the colours of the light theme by their names; they stand in the pages' style sheet, first of all."""
    style = (files("reports") / "templates" / "style.css").read_text(encoding="utf-8")
    return dict(reversed(re.findall(r"--([a-z]+[0-9]?): (#[0-9a-f]+);", style)))


def _in_colors(value: Any, colors: Mapping[str, str]) -> Any:
    if isinstance(value, str) and value.startswith("@"):
        return colors.get(value[1:], value)
    if isinstance(value, dict):
        return {key: _in_colors(item, colors) for key, item in value.items()}
    return [_in_colors(item, colors) for item in value] if isinstance(value, list | tuple) else value


def _slim(trace: Trace) -> Trace:
    """Write long lines as ``{"scale", "deltas"}``: value k is the sum of k + 1 of them over the scale, the coarsest."""
    slim = dict(trace)
    for axis in ("x", "y"):
        values = slim.get(axis, ())
        if len(values) < 24 or isinstance(values[0], str):
            continue
        numbers = np.array(values, dtype=float)  # a gap, None, becomes NaN and adds nothing
        known = np.isfinite(numbers)
        for scale in (1, 10, 100, 1000):
            whole = np.round(numbers[known] * scale)
            if np.array_equal(whole / scale, numbers[known]) and np.all(np.abs(whole) < 2.0**53):
                deltas = np.full(len(numbers), None)
                deltas[known] = np.diff(whole, prepend=0.0).astype(np.int64)
                slim[axis] = {"scale": scale, "deltas": deltas.tolist()}
                break
    return slim


class Plot:
    """A plot in the making: panels below each other, the first on top, over one horizontal axis."""

    def __init__(
        self, *panels: str | Drawn, x: str | Drawn, shares: Sequence[float] = (), gap: float = 0.14, **layout: Any
    ) -> None:
        """Begin with the vertical axis of each panel and the horizontal one: their titles, or more of them.

        `shares` are the heights of panels that differ; `gap` is the part of each that is left empty below it.
        """
        self.data: list[Trace] = []
        self.shapes: list[Drawn] = []
        self.notes: list[Drawn] = []
        self.axes: Drawn = {}
        top, whole = 1.0, sum(shares) or len(panels)
        for place, axis in enumerate(panels):
            share = (shares[place] if shares else 1.0) / whole
            below = 0.0 if place == len(panels) - 1 and shares else gap
            domain = {} if len(panels) == 1 else {"domain": [max(top - share * (1.0 - below), 0.0), top]}
            self.axes[f"yaxis{suffix(place)}"] = domain | _axis(axis)
            top -= share
        self.axes["xaxis"] = {"anchor": f"y{suffix(max(len(panels) - 1, 0))}"} | _axis(x)
        self.layout = layout

    def add(self, trace: Trace, panel: int = 0, *, group: str = "", legend: bool | None = None, **style: Any) -> None:
        """Draw a trace in a panel; those of one group are shown and hidden together."""
        named = {} if legend is None else {"showlegend": legend}
        grouped = {"legendgroup": group} if group else {}
        self.data.append(trace | {"yaxis": f"y{suffix(panel)}"} | grouped | named | style)

    def limit(self, value: float, panel: int = 0) -> None:
        """Draw a limit across a panel."""
        self.shapes.append(limit_line(value, f"y{suffix(panel)}"))

    def figure(
        self, name: str, caption: str, height: int, *, time: bool = False, margin: Drawn | None = None
    ) -> Figure:
        """Return the plot as a figure; `margin` replaces some of its edges, pixels."""
        marked = {"shapes": self.shapes, "annotations": self.notes}
        layout = layout_of(**self.axes, **{key: some for key, some in marked.items() if some}, **self.layout)
        layout["margin"] = layout["margin"] | (margin or {})
        return Figure(name, caption, self.data, layout, height, time)


def over_time(
    panels: Sequence[Panel],
    x: Drawn,
    *,
    colors: Mapping[str, str] | None = None,
    named: bool = False,
    grouped: bool = False,
    axis: Drawn | None = None,
    gap: float = 0.14,
    most: int = MOST_POINTS,
    **style: Any,
) -> Plot:
    """Draw panels below each other over one axis of time.

    Lines have `colors` by their names, else by their places; of a single one the axis says what it is, unless all are
    to be `named`. Those of one name are shown and hidden together where they are `grouped`. `axis` is what every
    vertical axis has besides, `style` as of `line`.
    """
    plot = Plot(*(_quantity_axis(panel, axis or {}) for panel in panels), x=x, gap=gap)
    drawn: set[str] = set()
    for level, panel in enumerate(panels):
        factor, several = per_degree(panel.unit)[0], len(panel.signals) > 1
        for place, signal in enumerate(panel.signals):
            color = (colors or {}).get(signal.name, COLORS[place % len(COLORS)] if several else "@ink")
            trace = line(signal.t, factor * signal.y, plotly_text(signal.name), color, most=most, **style)
            shown = (several or named) and signal.name not in drawn
            plot.add(trace, level, group=signal.name if grouped else "", legend=shown)
            drawn.add(signal.name)
        # A limit far above what was measured would flatten the line.
        top = max(float(np.fmax.reduce(signal.y, initial=0.0)) for signal in panel.signals)
        for limit in panel.limits.values():
            if limit < 3.0 * top or limit == min(panel.limits.values()):
                plot.limit(factor * limit, level)
    return plot


def _quantity_axis(panel: Panel, more: Drawn) -> Drawn:
    unit = per_degree(panel.unit)[1]
    title = {"text": plotly_text(f"{panel.title} ({unit})" if unit else panel.title)}
    positive = all(np.fmin.reduce(signal.y, initial=0.0) >= 0.0 for signal in panel.signals)
    return {"rangemode": "nonnegative" if positive else "normal"} | more | {"title": title | more.get("title", {})}


def suffix(panel: int) -> str:
    """Return what Plotly adds to the names of the axes of a panel, counted from 0."""
    return str(panel + 1) if panel else ""


def _axis(axis: str | Drawn) -> Drawn:
    return {"title": {"text": axis}} if isinstance(axis, str) else axis


def model_color(key: str) -> str:
    """Return the colour that a kind of model has everywhere."""
    return MODEL_COLORS.get(key, "@body")


def layout_of(**parts: Any) -> Drawn:
    """Return the common layout of plots: transparent, legend above, quiet grid."""
    base: Drawn = {
        "margin": {"l": 58, "r": 14, "t": 46, "b": 44},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 12, "color": "@text"},
        "legend": {"orientation": "h", "x": 0},
        "hovermode": "closest",
    }
    base.update(parts)
    quiet = {"gridcolor": "@grid", "linecolor": "@grid", "zerolinecolor": "@grid", "automargin": False}
    for name, axis in parts.items():
        if name.startswith("yaxis") and "title" in axis:  # beside the numbers, however long they are
            base[name] = axis | {"title": {"standoff": 6} | axis["title"]}
    return {name: quiet | part if name.startswith(("xaxis", "yaxis")) else part for name, part in base.items()}


def time_axis(span: Span | None, title: str = "time on the log’s clock (s)") -> Drawn:
    """Return a time axis that initially shows a span of it."""
    axis: Drawn = {"title": {"text": title}, "hoverformat": ".1f"}
    return axis if span is None else axis | {"range": [span.start, span.stop]}


def margin(span: Span | None) -> Span | None:
    """Widen a time span a little, so that its ends do not lie on the frame of a plot."""
    return None if span is None else Span(span.start - 0.02 * span.duration, span.stop + 0.02 * span.duration)


def band(span: Span, color: str, opacity: float) -> Drawn:
    """Tint a stretch of the horizontal axis behind the lines."""
    place = {"type": "rect", "xref": "x", "yref": "paper", "x0": span.start, "x1": span.stop, "y0": 0, "y1": 1}
    return place | {"fillcolor": color, "opacity": opacity, "line": {"width": 0}, "layer": "below"}


def mark_line(x: float | str, color: str, width: float = 1.0, dash: str = "dot") -> Drawn:
    """Draw a line over the whole height of a plot."""
    place = {"type": "line", "xref": "x", "yref": "paper", "x0": x, "x1": x, "y0": 0, "y1": 1}
    return place | {"line": {"color": color, "width": width, "dash": dash}}


def limit_line(value: float, axis: str) -> Drawn:
    """Draw a limit across a plot, on one of its vertical axes."""
    place = {"type": "line", "xref": "paper", "yref": axis, "x0": 0, "x1": 1, "y0": value, "y1": value}
    return place | {"line": {"color": "@bad", "width": 1, "dash": "dash"}}


def band_label(span: Span, text: str) -> Drawn:
    """Name a tinted time span above the plot."""
    place = {"x": span.start, "y": 1, "xref": "x", "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
    return place | {"text": plotly_text(text), "showarrow": False, "font": {"size": 11, "color": "@quiet"}}


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
    most: int = MOST_POINTS,
) -> Trace:
    """Draw measured y over x, shape (n,), as a line of `most` points, broken where `time` (x if not given) has a gap.

    Over time, smallest and largest values are kept, so that no peak is lost.
    """
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if time is None:
        xs, ys = thin(xs, ys, most)
        time = xs
    else:
        step = max(1, -(-np.size(x) // most))
        xs, ys, time = xs[::step], ys[::step], time[::step]
    # A line across a gap would show what nobody measured.
    apart = np.diff(time)
    usual = float(np.median(apart)) if len(apart) else 0.0
    # Samples further apart than this, s, are not joined by a line.
    gaps = np.flatnonzero(apart > max(1.5, 5.0 * usual)) + 1
    return {
        "type": "scatter",
        "mode": "lines",
        "x": rounded(np.insert(xs, gaps, np.nan), 3),
        "y": rounded(np.insert(ys, gaps, np.nan), decimals),
        "name": name,
        "line": {"color": color, "width": width},
        "hovertemplate": f"{hover or '%{x:.1f} s: %{y:.4g}'}<extra>{name}</extra>",
    }


def curve(
    x: ArrayLike, y: ArrayLike, name: str, color: str, width: float = 2.0, dash: str = "solid", hover: str = ""
) -> Trace:
    """Draw computed y over x, shape (n,), as a line through every point, with four digits."""
    style = {"color": color, "width": width, "dash": dash}
    trace = {"type": "scatter", "mode": "lines", "x": digits(x, 6), "y": digits(y), "name": plotly_text(name)}
    return trace | {"line": style} | ({"hovertemplate": f"{hover}<extra>{plotly_text(name)}</extra>"} if hover else {})


def marks(
    x: ArrayLike | list[str],
    y: ArrayLike,
    name: str,
    color: str,
    *,
    symbol: str = "circle",
    size: float = 7.0,
    sigma: ArrayLike | None = None,
    text: Sequence[str] = (),
    hover: str = "",
) -> Trace:
    """Draw points with one standard error; `x` may be dates or names, `text` says of each what it is."""
    trace: Trace = {"type": "scatter", "mode": "markers", "x": _places(x)}
    trace |= {"y": digits(y, 5), "name": plotly_text(name)}
    trace["marker"] = {"color": color, "size": size, "symbol": symbol, "line": {"color": color, "width": 2}}
    if sigma is not None:
        trace["error_y"] = {"array": digits(sigma, 5), "color": color, "thickness": 1.2, "width": 0}
    if text:
        trace["text"] = [plotly_text(label) for label in text]
    return trace | ({"hovertemplate": hover} if hover else {})


def _places(x: ArrayLike | list[str]) -> list[Any]:
    return x if isinstance(x, list) and x and isinstance(x[0], str) else digits(x, 6)


def area(
    x: ArrayLike, low: ArrayLike, high: ArrayLike, name: str, color: str, opacity: float = 0.2, **style: Any
) -> Trace:
    """Shade what lies between two curves over x, shape (n,)."""
    around, edge = (np.asarray(array, dtype=float) for array in (x, high))
    outline = curve(
        np.concatenate([around, around[::-1]]), np.concatenate([edge, np.asarray(low)[::-1]]), name, color, 0.0
    )
    filled = {"fill": "toself", "fillcolor": color, "opacity": opacity, "hoverinfo": "skip", "showlegend": False}
    return outline | filled | style


def padded(data: Iterable[Trace], axis: str) -> list[float]:
    """Return the range of an axis with room around what is drawn."""
    values = [value for trace in data for value in trace[axis] if value is not None]
    pad = max(0.06 * (max(values) - min(values)), 0.5)
    return [min(values) - pad, max(values) + pad]


def dots(x: ArrayLike, y: ArrayLike, name: str, color: str) -> Trace:
    """Draw measured points that no line joins, shape (n,)."""
    trace = line(x, y, name, color, time=np.arange(np.size(x), dtype=float))
    del trace["line"]
    # Of many points each is small, or they cover what lies among them.
    # Points from which on dots are drawn small.
    size = 4 if np.size(x) < 1000 else 2
    return trace | {"mode": "markers", "marker": {"color": color, "size": size}, "hoverinfo": "skip"}


def rounded(values: NDArray[np.float64], decimals: int) -> list[float | None]:
    """Round for a plot; what is not finite becomes a gap."""
    short = np.round(values, decimals).astype(object)
    short[~np.isfinite(values)] = None
    return list(short)


def digits(values: ArrayLike, count: int = 4) -> list[float | None]:
    """Keep the significant digits that a plot shows; what is not finite becomes a gap."""
    numbers = np.asarray(values, dtype=float).ravel().tolist()
    return [float(f"{value:.{count}g}") if isfinite(value) else None for value in numbers]
