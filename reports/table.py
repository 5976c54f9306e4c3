"""Tables of a report: made once, shown by pages (macro `table` of parts.html), as Markdown, and in the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import rich.table
from rich.text import Text


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table."""

    label: str
    cells: Sequence[str] = ()
    #: ``"part"`` heads the lines below it and has no cells; ``"average"``, ``"baseline"`` and ``"strong"`` are styles.
    kind: str = ""
    link: str | None = None  #: Page that the label leads to.


@dataclass(frozen=True, slots=True)
class Table:
    """Lines under one head."""

    label: str  #: Head of the labels.
    heads: Sequence[str]  #: Of the cells.
    rows: Sequence[Row]
    caption: str = ""
    groups: Sequence[str] = ()  #: Heads over equally many of `heads` each; empty for none.

    def markdown(self) -> str:
        """Write the table as GitHub-flavoured Markdown, lines of kind "part" in bold."""
        caption = [escaped(self.caption), ""] if self.caption else []
        lines = [_line(self.label, self.heads), "|" + " --- |" + " ---: |" * len(self.heads)]
        for row in self.rows:
            part = row.kind == "part"
            lines.append(_line(row.label, [""] * len(self.heads) if part else row.cells, bold=part))
        return "\n".join([*caption, *lines])

    def html(self) -> str:
        """Write the table for a notebook."""
        head = "".join(f"<th>{escape(each)}</th>" for each in (self.label, *self.heads))
        rows = "".join(
            f"<tr><th>{escape(row.label)}</th>{''.join(f'<td>{escape(cell)}</td>' for cell in row.cells)}</tr>"
            for row in self.rows
        )
        caption = f"<caption>{escape(self.caption)}</caption>" if self.caption else ""
        return f"<table>{caption}<tr>{head}</tr>{rows}</table>"

    def terminal(self, title: str | None = None) -> rich.table.Table:
        """Return the table for the terminal."""
        table = rich.table.Table(
            title=title, box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold", title_justify="left"
        )
        table.add_column(self.label, overflow="fold")
        for head in self.heads:
            table.add_column(head, justify="right", no_wrap=True)
        for row in self.rows:
            style = {"part": "bold", "baseline": "dim"}.get(row.kind)
            table.add_row(Text(row.label), *(Text(cell) for cell in row.cells), style=style)
        return table


def _line(label: str, cells: Sequence[str], *, bold: bool = False) -> str:
    first = f"**{escaped(label)}**" if bold else escaped(label)
    return "| " + " | ".join([first, *map(escaped, cells)]) + " |"


def escaped(text: str) -> str:
    """Escape what Markdown and HTML would take for their own."""
    for mark in "\\`*_[]<>#|":
        text = text.replace(mark, {"<": "&lt;", ">": "&gt;"}.get(mark, f"\\{mark}"))
    return " ".join(text.split())
