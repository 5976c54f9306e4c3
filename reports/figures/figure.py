"""What all plots of a report are made of: lines, bands and layouts, as Plotly takes them, in plain dicts.

Colours are names such as ``"@ink"`` that the page replaces by those of its light or dark theme; the same name means the
same thing in every plot: ``@ink`` measured, ``@gps``, ``@baro``, and for every kind of model its own (`MODEL_COLORS`).
Figures whose `time` is true share one time axis.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.flight.signals import thin
from pipeline.results.span import Span
from reports.figures.packing import compact, pack

#: Most points that one line of a plot is drawn with; more cannot be told apart on a screen.
MOST_POINTS = 1500
#: Points from which on dots are drawn small.
MANY_POINTS = 1000
#: Samples further apart than this, s, are not joined by a line.
LONGEST_JOIN = 1.5
TIME_TITLE = "time on the log’s clock (s)"

#: Colour of each kind of model, everywhere; further kinds share the last.
MODEL_COLORS = {"motors": "@own", "mixer": "@mixer", "reference": "@joint", "rigid_body": "@body"}

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

    def to_dict(self) -> Drawn:
        """Return what JSON can hold, long lines as differences (`reports.figures.packing`)."""
        return {
            "id": self.id,
            "caption": self.caption,
            "data": [compact(trace) for trace in self.data],
            "layout": self.layout,
            "height": self.height,
            "time": self.time,
            "place": self.place,
        }

    def packed(self) -> Drawn:
        """Return what travels in a page."""
        drawing = self.to_dict()
        return {
            "id": self.id,
            "place": self.place or self.id,
            "height": self.height,
            "time": self.time,
            "packed": pack({"data": drawing["data"], "layout": self.layout}),
        }


def short(title: str) -> str:
    """Leave out of a model's title what legends have no room for: where it leads to."""
    return title.partition(" →")[0]


def model_color(key: str) -> str:
    """Return the colour that a kind of model has everywhere."""
    return MODEL_COLORS.get(key, "@body")


def layout_of(**parts: Any) -> Drawn:
    """Lay a plot out as all of a report are: transparent, legend above, quiet grid."""
    base: Drawn = {
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


def time_axis(span: Span | None) -> Drawn:
    """Lay out an axis of time that begins by showing a stretch of it."""
    axis: Drawn = {"title": {"text": TIME_TITLE}, "hoverformat": ".1f"}
    return axis if span is None else axis | {"range": [span.start, span.stop]}


def margin(span: Span | None) -> Span | None:
    """Widen a stretch of time a little, so that its ends do not lie on the frame of a plot."""
    return None if span is None else Span(span.start - 0.02 * span.duration, span.stop + 0.02 * span.duration)


def band(span: Span, color: str, opacity: float) -> Drawn:
    """Tint a stretch of time behind the lines.

    Parameters
    ----------
    span : Span
        s.
    color : str
        Name of a colour.
    opacity : float
        From 0 to 1.
    """
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


def limit_line(value: float, axis: str) -> Drawn:
    """Draw a limit across a plot, on one of its vertical axes."""
    return {
        "type": "line",
        "xref": "paper",
        "yref": axis,
        "x0": 0,
        "x1": 1,
        "y0": value,
        "y1": value,
        "line": {"color": "@bad", "width": 1, "dash": "dash"},
    }


def band_label(span: Span, text: str) -> Drawn:
    """Name a tinted stretch of time above the plot."""
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
    most: int = MOST_POINTS,
) -> Trace:
    """Draw y over x as a line of `most` points, broken where `time` (x when not given) has a gap.

    Over time, smallest and largest values are kept, so that no peak is lost.

    Parameters
    ----------
    x, y : array_like, shape (n,)
        The points.
    name : str
        Name in the legend.
    color : str
        Name of a colour.
    width : float
        px.
    decimals : int
        Digits behind the point of what is stored.
    hover : str, optional
        Template of the text at the pointer.
    time : ndarray, shape (n,), optional
        s.
    most : int
        Most points.
    """
    xs, ys = np.asarray(x, dtype=float), np.asarray(y, dtype=float)
    if time is None:
        xs, ys = thin(xs, ys, most)
        time = xs
    else:
        step = max(1, -(-np.size(x) // most))
        xs, ys, time = xs[::step], ys[::step], time[::step]
    # A line across a gap would show what nobody measured.
    gaps = np.flatnonzero(np.diff(time) > max(LONGEST_JOIN, 5.0 * float(np.median(np.diff(time))))) + 1
    return {
        "type": "scatter",
        "mode": "lines",
        "x": rounded(np.insert(xs, gaps, np.nan), 3),
        "y": rounded(np.insert(ys, gaps, np.nan), decimals),
        "name": name,
        "line": {"color": color, "width": width},
        "hovertemplate": f"{hover or '%{x:.1f} s: %{y:.4g}'}<extra>{name}</extra>",
    }


def padded(data: Iterable[Trace], axis: str) -> list[float]:
    """Return the range of an axis with room around what is drawn."""
    values = [value for trace in data for value in trace[axis] if value is not None]
    pad = max(0.06 * (max(values) - min(values)), 0.5)
    return [min(values) - pad, max(values) + pad]


def dots(x: ArrayLike, y: ArrayLike, name: str, color: str) -> Trace:
    """Draw points that no line joins.

    Parameters
    ----------
    x, y : array_like, shape (n,)
        The points.
    name : str
        Name in the legend.
    color : str
        Name of a colour.
    """
    trace = line(x, y, name, color, time=np.arange(np.size(x), dtype=float))
    del trace["line"]
    # Of many points each is small, or they cover what lies among them.
    size = 4 if np.size(x) < MANY_POINTS else 2
    return trace | {"mode": "markers", "marker": {"color": color, "size": size}, "hoverinfo": "skip"}


def rounded(values: NDArray[np.float64], decimals: int) -> list[float | None]:
    """Round for a plot; what is not finite becomes a gap."""
    short = np.round(values, decimals).astype(object)
    short[~np.isfinite(values)] = None
    return list(short)
