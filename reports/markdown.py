"""Tables of a report as GitHub-flavoured Markdown."""

from __future__ import annotations

from reports.rows import Numbers


def markdown_table(table: Numbers) -> str:
    """Write a table that a page shows by the macro `plain_table`: caption, head, rows; rows of kind "part" in bold."""
    caption = [table["caption"], ""] if table["caption"] else []
    heads = [table["label"], *table["heads"]]
    lines = [_row(heads), "|" + " --- |" + " ---: |" * len(table["heads"])]
    for row in table["rows"]:
        cells = [""] * len(table["heads"]) if row["kind"] == "part" else row["cells"]
        lines.append(_row([f"**{row['label']}**" if row["kind"] == "part" else row["label"], *cells]))
    return "\n".join([*caption, *lines])


def _row(cells: list[str]) -> str:
    return "| " + " | ".join(" ".join(cell.replace("|", "\\|").split()) for cell in cells) + " |"
