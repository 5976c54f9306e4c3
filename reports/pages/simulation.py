"""The page of a simulated case.

Reports do not know the simulator; what a case gives is described here as far as the page needs it.
"""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from core.table import Table
from reports.figures.figure import COLORS, Figure, Plot, line
from reports.pages.html import render


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


def _figure(number: int, caption: str, axis: str, lines: pd.DataFrame) -> Figure:
    t = lines.index.to_numpy(dtype=float)
    reach = [float(t[0]), float(t[-1])]
    plot = Plot(axis, x={"title": {"text": "time (s)"}, "hoverformat": ".2f", "range": reach})
    for k, column in enumerate(lines.columns):
        plot.add(line(t, lines[column], str(column), COLORS[k % len(COLORS)], width=1.6))
    return plot.figure(f"simulated-{number}", caption, 320, time=True)
