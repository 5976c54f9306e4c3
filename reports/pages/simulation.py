"""The page of a simulated case.

Reports do not know the simulator; what a case gives is described here as far as the page needs it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import pandas as pd

from core.table import Table
from reports.figures.figure import Figure, layout_of, line
from reports.pages.html import render

#: Colours of the lines of a plot, in their order, and the line style beyond the first eight.
_COLORS = tuple(f"@c{k}" for k in range(1, 9))


class Fact(Protocol):
    """A characteristic of the flight."""

    @property
    def name(self) -> str:
        """What it is."""
        ...

    @property
    def text(self) -> str:
        """Its value with the unit."""
        ...


class Plot(Protocol):
    """Lines over time, one for each column of `lines`, whose index is the time in seconds."""

    @property
    def caption(self) -> str:
        """What to see."""
        ...

    @property
    def axis(self) -> str:
        """Title of the vertical axis, with the unit."""
        ...

    @property
    def lines(self) -> pd.DataFrame:
        """Values, a column for each line."""
        ...


class Rows(Protocol):
    """Rows to read."""

    @property
    def caption(self) -> str:
        """What they tell."""
        ...

    @property
    def frame(self) -> pd.DataFrame:
        """Text and numbers; its columns are named as they are read."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulationPage:
    """What simulation.html shows."""

    name: str
    summary: str
    facts: Sequence[tuple[str, str]]
    tables: Sequence[Table]
    notes: Sequence[str]
    beside: str  #: Files beside the page.


def simulation_page(
    name: str,
    summary: str,
    facts: Sequence[Fact],
    plots: Sequence[Plot],
    tables: Sequence[Rows],
    notes: Sequence[str],
    files: Sequence[str],
) -> str:
    """Render the page.

    Parameters
    ----------
    name, summary : str
        Of the case.
    facts : sequence of Fact
    plots : sequence of Plot
    tables : sequence of Rows
    notes : sequence of str
        Where the simulation differs from what its paper prints.
    files : sequence of str
        Names of the files beside the page.
    """
    figures = [_figure(number, plot) for number, plot in enumerate(plots, start=1)]
    page = SimulationPage(
        name=name,
        summary=summary,
        facts=[(fact.name, fact.text) for fact in facts],
        tables=[Table.from_frame(each.frame, each.caption) for each in tables],
        notes=notes,
        beside=", ".join(files),
    )
    return render("simulation.html", figures, page)


def _figure(number: int, plot: Plot) -> Figure:
    t = plot.lines.index.to_numpy(dtype=float)
    data = [
        line(t, plot.lines[column], str(column), _COLORS[k % len(_COLORS)], width=1.6)
        for k, column in enumerate(plot.lines.columns)
    ]
    layout = layout_of(
        xaxis={"title": {"text": "time (s)"}, "hoverformat": ".2f", "range": [float(t[0]), float(t[-1])]},
        yaxis={"title": {"text": plot.axis}},
    )
    return Figure(f"simulated-{number}", plot.caption, data, layout, 320)
