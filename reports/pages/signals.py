"""Signals of a log over time as a page that opens offline: one panel for each unit, time shared, no peak lost."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from logparse import FlightLog
from logparse.signals import LoggedSignal
from pipeline.names import printable
from reports.figures.figure import COLORS, Figure, Plot, line, plotly_text, time_axis
from reports.pages import html


def write_signal_plot(
    log: FlightLog, signals: Sequence[LoggedSignal], file: str | Path, start: float | None, stop: float | None
) -> Path:
    """Write the page."""
    file = Path(file)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure = signal_figure(signals, start, stop)
    name = printable(log.path.name)
    facts = f"{log.vehicle.firmware or log.format} · {log.duration:.0f} s"
    file.write_text(
        html.render("signals.html", [figure], name=name, facts=facts, titles=[signal.name for signal in signals]),
        encoding="utf-8",
    )
    return file


def signal_figure(signals: Sequence[LoggedSignal], start: float | None = None, stop: float | None = None) -> Figure:
    """Draw signals, those of one unit over each other."""
    units = list(dict.fromkeys(signal.unit for signal in signals))
    plot = Plot(*(plotly_text(unit) for unit in units), x=time_axis(None), gap=0.12)
    drawn = []
    for place, signal in enumerate(signals):
        inside = (signal.t >= (-np.inf if start is None else start)) & (signal.t <= (np.inf if stop is None else stop))
        t, y = signal.t[inside], signal.y[inside]
        drawn.append(t)
        color = COLORS[place % len(COLORS)]
        # Points of a line: smallest and largest value of each stretch.
        trace = line(t, y, plotly_text(signal.name), color, width=1.2, decimals=6, most=8000)
        plot.add(trace, units.index(signal.unit), legend=True)
    times = np.concatenate(drawn)
    if len(times):
        plot.axes["xaxis"] |= {"range": [float(times.min()), float(times.max())]}
    caption = (
        "Drag to zoom, double-click to see all. Of many samples the smallest and largest of each stretch are drawn."
    )
    return plot.figure("signals", caption, 160 + 260 * len(units), time=True)
