"""`Table`: made once, shown on pages (macro `table` of parts.html), in notebooks, as Markdown, and in the terminal."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from html import escape
from typing import TYPE_CHECKING, Self

from core.lazy import lazy
from core.quantity import column

if TYPE_CHECKING:
    import pandas as pd
    from rich import table as rich_table
    from rich import text as rich_text
else:
    rich_table, rich_text = lazy("rich.table"), lazy("rich.text")

#: Colours of tones on a terminal; a tone without one is for pages alone.
TONES: Mapping[str, str] = {
    "good": "green",
    "care": "yellow",
    "bad": "red",
    "unknown": "dim",
    "part": "bold",
    "strong": "bold",
    "baseline": "dim",
}


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell whose tone says what to make of it."""

    text: str
    tone: str = ""  #: One of `TONES`.
    badge: str = ""  #: On pages: a word in the colour of the tone before the text, which is then plain.
    under: str = ""  #: On pages: what a smaller line below says besides.

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class Row:
    """A line of a table."""

    label: str | Cell
    cells: Sequence[str | Cell] = ()
    #: ``"part"`` heads the lines below it and has no cells; ``"average"``, ``"baseline"`` and ``"strong"`` are styles.
    kind: str = ""
    link: str | None = None  #: Page that the label leads to.


@dataclass(frozen=True, slots=True)
class Table:
    """Lines under one head."""

    label: str  #: Head of the labels.
    heads: Sequence[str]  #: Of the cells; where all heads are empty none is shown.
    rows: Sequence[Row]
    caption: str = ""
    groups: Sequence[str] = ()  #: Heads over equally many of `heads` each; empty for none.
    #: Places in `heads` of columns of text: aligned to the left and folded on a narrow terminal; others hold numbers.
    texts: Collection[int] = ()
    style: str = ""  #: Class on pages.
    roomy: Collection[int] = ()  #: Places in `heads` of columns that a phone has no room for.

    @classmethod
    def of_numbers(
        cls,
        label: str,
        heads: Sequence[str],
        lines: Sequence[tuple[Row, Sequence[float | None]]],
        caption: str = "",
        groups: Sequence[str] = (),
        digits: tuple[int, int] = (3, 3),
    ) -> Self:
        """Lay out numbers whose decimal points stand below each other; `digits` as of `column`.

        A line without numbers has no cells, unless its row brings some.
        """
        numbered = [values for _, values in lines if values]
        cells = zip(*(column(numbers, *digits) for numbers in zip(*numbered, strict=True)), strict=True)
        rows = [replace(row, cells=(*row.cells, *next(cells))) if values else row for row, values in lines]
        return cls(label, heads, rows, caption, groups)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, caption: str = "") -> Self:
        """Show the rows of a table of numbers and texts, the first column as labels; numbers with five digits."""
        columns = [
            [f"{value:.5g}" if frame[name].dtype.kind in "iuf" else str(value) for value in frame[name]]
            for name in frame.columns
        ]
        texts = [place for place, name in enumerate(frame.columns[1:]) if frame[name].dtype.kind not in "iuf"]
        label, *heads = map(str, frame.columns)
        return cls(
            label, heads, [Row(first, rest) for first, *rest in zip(*columns, strict=True)], caption, texts=texts
        )

    @property
    def headed(self) -> bool:
        """Whether any column has a head."""
        return any((self.label, *self.heads))

    def markdown(self) -> str:
        """Write the table as GitHub-flavoured Markdown, lines of kind "part" in bold."""
        caption = [escaped(self.caption), ""] if self.caption else []
        aligned = (" --- |" if place in self.texts else " ---: |" for place in range(len(self.heads)))
        lines = [_line(self.label, self.heads), "| --- |" + "".join(aligned)]
        for row in self.rows:
            part = row.kind == "part"
            lines.append(_line(row.label, [""] * len(self.heads) if part else row.cells, bold=part))
        return "\n".join([*caption, *lines])

    def html(self) -> str:
        """Write the table for a notebook."""
        left = " style='text-align:left'"
        head = "".join(f"<th>{escape(title)}</th>" for title in (self.label, *self.heads))
        rows = (
            f"<tr><th{left}>{escape(str(row.label))}</th>"
            + "".join(
                f"<td{left if place in self.texts else ''}>{escape(str(cell))}</td>"
                for place, cell in enumerate(row.cells)
            )
            + "</tr>"
            for row in self.rows
        )
        caption = f"<caption>{escape(self.caption)}</caption>" if self.caption else ""
        return f"<table>{caption}{f'<tr>{head}</tr>' if self.headed else ''}{''.join(rows)}</table>"

    def terminal(self, title: str | None = None, *, fold_labels: bool = True) -> rich_table.Table:
        """Return the table for the terminal."""
        table = rich_table.Table(
            title=title,
            box=None,
            pad_edge=False,
            padding=(0, 2, 0, 0),
            header_style="bold",
            title_justify="left",
            show_header=self.headed,
        )
        table.add_column(self.label, overflow="fold", no_wrap=not fold_labels)
        for place, head in enumerate(self.heads):
            text = place in self.texts
            table.add_column(head, justify="left" if text else "right", no_wrap=not text, overflow="fold")
        for row in self.rows:
            table.add_row(*map(_terminal, (row.label, *row.cells)), style=TONES.get(row.kind))
        return table


def _terminal(cell: str | Cell) -> rich_text.Text:
    return rich_text.Text(str(cell), style=TONES.get(cell.tone, "") if isinstance(cell, Cell) else "")


def _line(label: str | Cell, cells: Sequence[str | Cell], *, bold: bool = False) -> str:
    first = f"**{escaped(str(label))}**" if bold else escaped(str(label))
    return "| " + " | ".join([first, *(escaped(str(cell)) for cell in cells)]) + " |"


def escaped(text: str) -> str:
    """Escape what Markdown and HTML would take for their own."""
    for mark in "\\`*_[]<>#|":
        text = text.replace(mark, {"<": "&lt;", ">": "&gt;"}.get(mark, f"\\{mark}"))
    return " ".join(text.split())


#: First characters of what a spreadsheet calculates (OWASP, CSV injection).
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def as_cell(text: str) -> str:
    """Return text that a spreadsheet shows as it is: what it would take for a formula gets an apostrophe before it."""
    return f"'{text}" if text.startswith(_FORMULA) else text
