"""`Table`: one table for pages (macro `table` of parts.html), notebooks, Markdown and the terminal."""

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

#: Terminal colours of tones; a tone not listed here is shown on pages only.
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
    """A table cell whose tone (good, care, bad ...) gives its colour."""

    text: str
    tone: str = ""  #: One of `TONES`.
    badge: str = ""  #: On pages: a word in the tone's colour before the text, which is then plain.
    under: str = ""  #: On pages: a smaller second line.

    def __str__(self) -> str:
        return self.text


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table."""

    label: str | Cell
    cells: Sequence[str | Cell] = ()
    #: ``"part"`` heads the rows below it and has no cells; ``"average"``, ``"baseline"`` and ``"strong"`` are styles.
    kind: str = ""
    link: str | None = None  #: Page that the label links to.


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under one header."""

    label: str  #: Header of the label column.
    heads: Sequence[str]  #: Headers of the other columns; no header is shown where all are empty.
    rows: Sequence[Row]
    caption: str = ""
    groups: Sequence[str] = ()  #: Headers that each span equally many of `heads`; empty for none.
    #: Indices into `heads` of text columns: left-aligned, and folded on a narrow terminal. Others hold numbers.
    texts: Collection[int] = ()
    style: str = ""  #: CSS class on pages.
    roomy: Collection[int] = ()  #: Indices into `heads` of columns hidden on a phone.

    @classmethod
    def of_numbers(
        cls,
        label: str,
        heads: Sequence[str],
        rows: Sequence[tuple[Row, Sequence[float | None]]],
        caption: str = "",
        groups: Sequence[str] = (),
        digits: tuple[int, int] = (3, 3),
    ) -> Self:
        """Make a table of numbers aligned at the decimal point; `digits` as of `column`.

        A row without numbers keeps the cells that it has.
        """
        numbered = [values for _, values in rows if values]
        cells = zip(*(column(numbers, *digits) for numbers in zip(*numbered, strict=True)), strict=True)
        filled = [replace(row, cells=(*row.cells, *next(cells))) if values else row for row, values in rows]
        return cls(label, heads, filled, caption, groups)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, caption: str = "") -> Self:
        """Make a table of a DataFrame, its first column as labels, numbers with five digits."""
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
        """Whether any column has a header."""
        return any((self.label, *self.heads))

    def markdown(self) -> str:
        """Return the table as GitHub-flavoured Markdown, rows of kind "part" in bold."""
        caption = [escaped(self.caption), ""] if self.caption else []
        aligned = (" --- |" if place in self.texts else " ---: |" for place in range(len(self.heads)))
        lines = [_line(self.label, self.heads), "| --- |" + "".join(aligned)]
        for row in self.rows:
            part = row.kind == "part"
            lines.append(_line(row.label, [""] * len(self.heads) if part else row.cells, bold=part))
        return "\n".join([*caption, *lines])

    def html(self) -> str:
        """Return the table as HTML for a notebook."""
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
    """Escape characters that Markdown or HTML would interpret."""
    for mark in "\\`*_[]<>#|":
        text = text.replace(mark, {"<": "&lt;", ">": "&gt;"}.get(mark, f"\\{mark}"))
    return " ".join(text.split())


#: First characters that make a spreadsheet take a cell for a formula (OWASP, CSV injection).
_FORMULA = ("=", "+", "-", "@", "\t", "\r")


def as_cell(text: str) -> str:
    """Prefix text that a spreadsheet would take for a formula with an apostrophe."""
    return f"'{text}" if text.startswith(_FORMULA) else text
