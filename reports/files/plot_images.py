"""The plots of a page as PNG or SVG files, for documents and mails: drawn by matplotlib from the same figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Sheet

from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult
from reports.figures.figure import Drawn, Figure
from reports.figures.flight import flight_figures
from reports.figures.prediction import prediction
from reports.figures.signals import signal_figures

#: Colours of the page's names on white paper (templates/style.css).
_COLORS = {
    "@ink": "#1c2126",
    "@text": "#1c2126",
    "@quiet": "#66707a",
    "@own": "#0072b2",
    "@joint": "#d55e00",
    "@mixer": "#009e73",
    "@body": "#cc79a7",
    "@gps": "#9aa3ab",
    "@baro": "#009e73",
    "@held": "#0072b2",
    "@fitted": "#4a9fd4",
    "@judged": "#c47f00",
    "@band": "#f0f2f5",
    "@grid": "#e4e8ec",
    "@c1": "#0072b2",
    "@c2": "#d55e00",
    "@c3": "#009e73",
    "@c4": "#cc79a7",
    "@c5": "#56b4e9",
    "@c6": "#b8860b",
    "@c7": "#1c2126",
    "@c8": "#7a5fb5",
    "@bad": "#b3261e",
    "@good": "#00724f",
    "@care": "#8a5a00",
}
_DASHES = {"dash": "--", "dot": ":", "dashdot": "-."}
#: Pixels of a page's column, and pixels per inch of the page and of a file.
_WIDTH, _PAGE_DPI, _FILE_DPI = 900, 100, 200

ImageFormat = Literal["png", "svg"]


def write_plots(result: FlightResult | GroupResult, folder: Path, image_format: ImageFormat) -> None:
    """Write the plots of a flight's page as files; nothing of a craft, whose plots are on the page of all flights.

    Parameters
    ----------
    result : FlightResult or GroupResult
        The flight.
    folder : Path
        Where to.
    image_format : {"png", "svg"}
        Format of the files.
    """
    if isinstance(result, FlightResult):
        predicted = [each for each in (prediction(result),) if each is not None]
        write_images([*flight_figures(result), *predicted, *signal_figures(result)], folder, image_format)


def write_images(figures: Sequence[Figure], folder: Path, image_format: ImageFormat) -> tuple[Path, ...]:
    """Write each figure as ``plots/NAME.png`` or ``.svg``.

    Parameters
    ----------
    figures : sequence of Figure
    folder : Path
        Of the report.
    image_format : {"png", "svg"}

    Returns
    -------
    tuple of Path
        In the order of the page.
    """
    target = folder / "plots"
    target.mkdir(parents=True, exist_ok=True)
    files = []
    with mpl.rc_context({"svg.fonttype": "none", "font.size": 8, "svg.hashsalt": "rotorid"}):
        for figure in figures:
            file = target / f"{figure.id}.{image_format}"
            draw(figure).savefig(file, dpi=_FILE_DPI, metadata={"Date": None} if image_format == "svg" else None)
            files.append(file)
    return tuple(files)


def draw(figure: Figure) -> Sheet:
    """Draw one figure; panels below each other keep their places."""
    sheet = Sheet(figsize=(_WIDTH / _PAGE_DPI, max(figure.height, 200) / _PAGE_DPI), layout=None)
    layout = figure.layout
    names = sorted({str(trace.get("yaxis", "y")) for trace in figure.data} | {"y"}, key=lambda name: (len(name), name))
    panels = {name: _axes(sheet, layout, name) for name in names}
    for trace in figure.data:
        _trace(panels[str(trace.get("yaxis", "y"))], trace)
    for shape in layout.get("shapes", ()):
        _shape(panels, shape)
    lowest = min(panels.values(), key=lambda axes: axes.get_position().y0)
    for label in layout.get("annotations", ()):
        name, _, inside = str(label.get("yref", "")).partition(" ")
        if inside == "domain" and name in panels:
            panels[name].text(-0.085, 0.5, _plain(str(label.get("text", ""))), transform=panels[name].transAxes)
    for name, axes in panels.items():
        if not layout.get(f"yaxis{name[1:]}", {}).get("scaleanchor"):
            _scale(axes, layout.get("xaxis", {}), "x")
        if axes is not lowest:
            axes.tick_params(labelbottom=False)
    lowest.set_xlabel(_title(layout.get("xaxis", {})))
    handles, labels = [], []
    for axes in panels.values():
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            if label not in labels:
                handles.append(handle)
                labels.append(label)
    if len(labels) > 1:
        sheet.legend(handles, labels, loc="upper left", ncols=6, frameon=False, bbox_to_anchor=(0.08, 1.0))
    return sheet


def _axes(sheet: Sheet, layout: Drawn, name: str) -> Axes:
    described = layout.get(f"yaxis{name[1:]}", {})
    low, high = described.get("domain", (0.0, 1.0))
    height = max(sheet.get_figheight(), 1.0)
    bottom, top = 0.5 / height, 1.0 - 0.35 / height
    axes = sheet.add_axes((0.1, bottom + low * (top - bottom), 0.87, (high - low) * (top - bottom)))
    axes.grid(visible=True, color=_COLORS["@grid"], linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.set_ylabel(_title(described))
    if described.get("scaleanchor"):
        axes.set_aspect("equal", adjustable="datalim")
    else:
        _scale(axes, described, "y")
    return axes


def _title(axis: Drawn) -> str:
    title = axis.get("title", "")
    return _plain(str(title.get("text", "") if isinstance(title, dict) else title))


def _plain(text: str) -> str:
    """Undo Plotly's escapes, and keep matplotlib from reading formulae."""
    return text.replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&").replace("$", r"\$")


def _scale(axes: Axes, described: Drawn, which: str) -> None:
    logarithmic = described.get("type") == "log"
    if logarithmic:
        (axes.set_xscale if which == "x" else axes.set_yscale)("log")
    bounds = described.get("range")
    if bounds is not None and None not in bounds:
        low, high = (10.0 ** float(v) if logarithmic else float(v) for v in bounds)
        (axes.set_xlim if which == "x" else axes.set_ylim)(low, high)


def _trace(axes: Axes, trace: Drawn) -> None:
    if trace.get("type", "scatter") not in ("scatter", "scattergl"):
        return
    x, y = (np.array([np.nan if v is None else v for v in trace.get(name, ())], dtype=float) for name in "xy")
    if len(x) == 0 or len(x) != len(y):
        return
    mode = str(trace.get("mode", "lines"))
    style, marker = trace.get("line") or {}, trace.get("marker") or {}
    color = _color(style.get("color") if "lines" in mode else marker.get("color"))
    label = str(trace.get("name", "")) if trace.get("showlegend", True) else None
    if trace.get("fill") in ("toself", "tonext", "tonexty"):
        axes.fill(x, y, color=_color(trace.get("fillcolor") or style.get("color")), alpha=0.2, linewidth=0)
        return
    axes.plot(
        x,
        y,
        color=color,
        linewidth=0.7 * float(style.get("width", 1.5)) if "lines" in mode else 0.0,
        linestyle=_DASHES.get(str(style.get("dash")), "-") if "lines" in mode else "none",
        marker="o" if "markers" in mode else None,
        markersize=0.5 * float(marker.get("size", 6)) if isinstance(marker.get("size", 6), (int, float)) else 3.0,
        label=_plain(label) if label else None,
    )


def _shape(panels: dict[str, Axes], shape: Drawn) -> None:
    line = shape.get("line", {})
    style: Drawn = {
        "color": _color(line.get("color")),
        "linewidth": 0.8,
        "linestyle": _DASHES.get(str(line.get("dash")), "-"),
    }
    if shape.get("type") == "rect" and shape.get("xref") == "x":
        for axes in panels.values():
            axes.axvspan(shape["x0"], shape["x1"], color=_color(shape.get("fillcolor")), zorder=0, linewidth=0)
    elif shape.get("type") == "line" and shape.get("yref") == "paper":
        for axes in panels.values():
            axes.axvline(shape["x0"], **style)
    elif shape.get("type") == "line" and shape.get("xref") == "paper" and shape.get("yref") in panels:
        panels[str(shape["yref"])].axhline(shape["y0"], **style)


def _color(name: object) -> str:
    text = str(name) if isinstance(name, str) else "@ink"
    return _COLORS.get(text, _COLORS["@ink"] if text.startswith("@") or text.startswith("rgba") else text)
