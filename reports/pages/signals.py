"""Lines over time as pages that open offline: signals of a log, time shared and no peak lost, and simulated cases.

Reports do not know the simulator; what a case gives is described here as far as the page needs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from core.table import Table
from logparse import FlightLog
from logparse.signals import LoggedSignal
from pipeline.names import printable
from pipeline.results.signals import Panel, SignalLine
from reports.figures.figure import COLORS, Figure, over_time, time_axis
from reports.pages import html
from reports.pages.html import render


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
    begin, end = -np.inf if start is None else start, np.inf if stop is None else stop
    units: dict[str, list[SignalLine]] = {}
    for signal in signals:
        inside = (signal.t >= begin) & (signal.t <= end)
        units.setdefault(signal.unit, []).append(SignalLine(signal.name, signal.t[inside], signal.y[inside]))
    panels = [Panel(title=unit, unit="", signals=tuple(lines)) for unit, lines in units.items()]
    colors = {signal.name: COLORS[place % len(COLORS)] for place, signal in enumerate(signals)}
    # Points of a line: smallest and largest value of each stretch.
    plot = over_time(panels, time_axis(None), colors=colors, named=True, gap=0.12, width=1.2, decimals=6, most=8000)
    times = np.concatenate([line.t for lines in units.values() for line in lines])
    if len(times):
        plot.axes["xaxis"] |= {"range": [float(times.min()), float(times.max())]}
    caption = (
        "Drag to zoom, double-click to see all. Of many samples the smallest and largest of each stretch are drawn."
    )
    return plot.figure("signals", caption, 160 + 260 * len(units), time=True)


def simulation_page(
    name: str,
    summary: str,
    facts: Sequence[tuple[str, str]],
    plots: Sequence[tuple[str, str, pd.DataFrame]],
    tables: Sequence[tuple[str, pd.DataFrame]],
    notes: Sequence[str],
    files: Sequence[str],
) -> str:
    """Render the page."""
    return render(
        "simulation.html",
        [_figure(number, *plot) for number, plot in enumerate(plots, start=1)],
        name=name,
        summary=summary,
        facts=facts,
        tables=[Table.from_frame(frame, caption) for caption, frame in tables],
        notes=notes,
        beside=", ".join(files),
    )


def _figure(number: int, caption: str, axis: str, table: pd.DataFrame) -> Figure:
    t = table.index.to_numpy(dtype=float)
    lines = tuple(SignalLine(str(name), t, column.to_numpy()) for name, column in table.items())
    shown = {"title": {"text": "time (s)"}, "hoverformat": ".2f", "range": [float(t[0]), float(t[-1])]}
    plot = over_time([Panel(title=axis, unit="", signals=lines)], shown, width=1.6)
    return plot.figure(f"simulated-{number}", caption, 320, time=True)
