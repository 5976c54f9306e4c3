"""Tables of a report as GitHub-flavoured Markdown."""

from __future__ import annotations

from collections.abc import Sequence

from reports.rows import Numbers


def markdown_table(table: Numbers) -> str:
    """Write a table that a page shows by the macro `plain_table`: caption, head, rows; rows of kind "part" in bold."""
    caption = [escaped(table["caption"]), ""] if table["caption"] else []
    lines = [_row(table["label"], table["heads"]), "|" + " --- |" + " ---: |" * len(table["heads"])]
    for row in table["rows"]:
        part = row["kind"] == "part"
        lines.append(_row(row["label"], [""] * len(table["heads"]) if part else row["cells"], bold=part))
    return "\n".join([*caption, *lines])


def _row(label: str, cells: Sequence[str], *, bold: bool = False) -> str:
    first = f"**{escaped(label)}**" if bold else escaped(label)
    return "| " + " | ".join([first, *map(escaped, cells)]) + " |"


def escaped(text: str) -> str:
    """Escape what Markdown and HTML would take for their own."""
    for mark in "\\`*_[]<>#|":
        text = text.replace(mark, {"<": "&lt;", ">": "&gt;"}.get(mark, f"\\{mark}"))
    return " ".join(text.split())
