"""Signals of a log over time as a page that opens offline: one panel for each unit, time shared, no peak lost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from logparse import FlightLog
from logparse.signals import LoggedSignal
from pipeline.names import printable
from pipeline.results.span import Span
from reports.figures.figure import Drawn, Figure, Trace, layout_of, line, plotly_text, time_axis
from reports.pages import html

#: Points of a line: smallest and largest value of each stretch.
_MOST = 8000
_COLORS = ("@c1", "@c2", "@c3", "@c4", "@c5", "@c6", "@c7", "@c8")


@dataclass(frozen=True, slots=True)
class SignalsPage:
    """What signals.html shows."""

    name: str
    facts: str
    titles: Sequence[str]


def write_signal_plot(
    log: FlightLog, signals: Sequence[LoggedSignal], file: str | Path, start: float | None, stop: float | None
) -> Path:
    """Write the page.

    Parameters
    ----------
    log : FlightLog
    signals : sequence of LoggedSignal
    file : path
        Of the page; replaced.
    start, stop : float, optional
        What to show, s on the boot clock.
    """
    file = Path(file)
    file.parent.mkdir(parents=True, exist_ok=True)
    figure = _signal_figure(signals, start, stop)
    name = printable(log.path.name)
    facts = f"{log.vehicle.firmware or log.format} · {log.duration:.0f} s"
    file.write_text(
        html.render("signals.html", [figure], SignalsPage(name, facts, [signal.name for signal in signals])),
        encoding="utf-8",
    )
    return file


def _signal_figure(signals: Sequence[LoggedSignal], start: float | None = None, stop: float | None = None) -> Figure:
    """Draw signals, those of one unit over each other."""
    units = list(dict.fromkeys(signal.unit for signal in signals))
    data: list[Trace] = []
    axes: Drawn = {}
    row = 1.0 / len(units)
    drawn = []
    for place, signal in enumerate(signals):
        inside = (signal.t >= (-np.inf if start is None else start)) & (signal.t <= (np.inf if stop is None else stop))
        t, y = signal.t[inside], signal.y[inside]
        drawn.append(t)
        number = units.index(signal.unit)
        trace = line(t, y, plotly_text(signal.name), _COLORS[place % len(_COLORS)], width=1.2, decimals=6, most=_MOST)
        data.append(trace | {"yaxis": f"y{number + 1 if number else ''}", "showlegend": True})
    for number, unit in enumerate(units):
        upper = 1.0 - number * row
        axes[f"yaxis{number + 1 if number else ''}"] = {
            "domain": [upper - 0.88 * row, upper],
            "title": {"text": plotly_text(unit)},
        }
    times = np.concatenate(drawn)
    span = Span(float(times.min()), float(times.max())) if len(times) else None
    axes["xaxis"] = time_axis(span) | {"anchor": f"y{len(units)}" if len(units) > 1 else "y"}
    caption = (
        "Drag to zoom, double-click to see all. Of many samples the smallest and largest of each stretch are drawn."
    )
    return Figure("signals", caption, data, layout_of(**axes), 160 + 260 * len(units))
