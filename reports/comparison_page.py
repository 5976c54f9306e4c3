"""A comparison of two reports as tables, as a page, as Markdown and for the terminal: all from the same rows."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from logparse.quantity import number, uncertain
from reports import summary
from reports.comparison import change
from reports.figure import Figure, layout_of
from reports.html import render
from reports.markdown import escaped, markdown_table
from reports.rows import Numbers

_WORDS = {True: "changed", False: "no change seen"}


def parameter_table(pair: Numbers) -> Numbers:
    """Lay out the parameters: before, after, difference, and whether it is more than chance."""
    return {
        "caption": "Means over the flights of each side with one standard error, which holds how much flights differ. "
        "p is the chance of such a difference when nothing changed, corrected for the number of parameters.",
        "label": "Parameter",
        "heads": ["before", "after", "difference", "p", "verdict"],
        "rows": [
            {
                "kind": "strong" if row["significant"] else "",
                "label": f"{row['parameter']}{_unit(row['unit'])}, {row['method']}",
                "cells": [
                    uncertain(row["a"]["value"], row["a"]["sigma"]),
                    uncertain(row["b"]["value"], row["b"]["sigma"]),
                    change(row),
                    chance(row["p_adjusted"]),
                    _WORDS[row["significant"]],
                ],
            }
            for row in pair["parameters"]
        ],
    }


def _unit(unit: str) -> str:
    """Return the unit in brackets without the conditions behind it; nothing for a pure number."""
    return "" if unit.startswith("1 (") else f" ({unit.partition(',')[0]})"


def error_table(pair: Numbers) -> Numbers:
    """Lay out what the models of both sides err on flights that they were not fitted to."""
    return {
        "caption": "Free-run RMSE on flight time held out, averaged over flights, and in brackets what always "
        "predicting the mean gives. Different flights judge the two sides: livelier ones make all errors larger.",
        "label": "Model",
        "heads": ["before (m)", "after (m)", "after / before", "p"],
        "rows": [
            {
                "kind": "",
                "label": f"{row['title']}, {row['output']}",
                "cells": [
                    *(f"{number(row[side]['rmse_m'])} ({number(row[side]['mean_m'])})" for side in "ab"),
                    number(row["b"]["rmse_m"] / row["a"]["rmse_m"])
                    if row["a"]["rmse_m"] and row["b"]["rmse_m"]
                    else "–",
                    chance(row["p"]),
                ],
            }
            for row in pair["errors"]
        ],
    }


def verdict_table(pair: Numbers) -> Numbers:
    """Lay out what the models of both sides are worth."""
    return {
        "caption": "",
        "label": "Model",
        "heads": ["before", "after"],
        "rows": [
            {"kind": "", "label": row["title"], "cells": [summary.TRUST_WORDS[row[side]] for side in "ab"]}
            for row in pair["verdicts"]
        ],
    }


def setting_table(pair: Numbers) -> Numbers:
    """Lay out what differs in the craft's settings and in those of the analysis."""
    return {
        "caption": "",
        "label": "Setting",
        "heads": ["before", "after"],
        "rows": [
            {
                "kind": "",
                "label": f"{row['name'].replace('_', ' ')} ({row['of']})",
                "cells": [_setting(row[side]) for side in "ab"],
            }
            for row in pair["changed"]
        ],
    }


def _setting(value: Any) -> str:
    if isinstance(value, list):
        return f"{len(value)} entries" if value else "none"
    if isinstance(value, float):
        return number(value, 4)
    return "–" if value is None or value == "" else str(value)


def chance(p: float | None) -> str:
    """Write a probability: three digits are more than anybody needs."""
    if p is None:
        return "–"
    return "< 0.001" if p < 0.001 else f"{p:.2g}" if p < 0.1 else f"{p:.2f}"


def tables(pair: Numbers) -> Iterator[tuple[str, Numbers]]:
    """Yield the tables that have rows, with their headings, what matters most first."""
    for title, table in (
        ("Parameters", parameter_table(pair)),
        ("Errors of the models", error_table(pair)),
        ("Verdicts", verdict_table(pair)),
        ("Settings that differ", setting_table(pair)),
    ):
        if table["rows"]:
            yield title, table


def heading(pair: Numbers) -> str:
    """Name what is compared."""
    a, b = pair["a"]["name"], pair["b"]["name"]
    return str(a if a == b else f"{a} → {b}")


def flights(pair: Numbers) -> str:
    """Report how many flights the two sides hold, and when they were."""
    return f"{_flights(pair['a'])} before, {_flights(pair['b'])} after"


def _flights(side: Numbers) -> str:
    when = [side[key][:10] for key in ("first_utc", "last_utc") if side[key]]
    days = f" ({' to '.join(dict.fromkeys(when))})" if when else ""
    return f"{side['flights']} flight{'s' if side['flights'] != 1 else ''}{days}"


def unpaired(numbers: Numbers) -> str:
    """Report which crafts have nobody to be compared with; empty when all have."""
    parts = [
        f"only in {numbers[side]['report']}: {', '.join(numbers['unpaired'][side])}"
        for side in "ab"
        if numbers["unpaired"][side]
    ]
    return f"Not compared, {'; '.join(parts)}." if parts else ""


def comparison_page(numbers: Numbers) -> str:
    """Render the page.

    Parameters
    ----------
    numbers : dict
        What `reports.comparison.compare_reports` gave.
    """
    pairs, figures = [], []
    for place, pair in enumerate(numbers["pairs"]):
        figure = _intervals(pair, f"changes-{place}")
        figures += [figure] if figure else []
        pairs.append(
            {
                "heading": heading(pair),
                "flights": flights(pair),
                "sentences": pair["sentences"],
                "figure": figure,
                "tables": list(tables(pair)),
            }
        )
    return render(
        "comparison.html",
        figures,
        numbers=numbers,
        title=f"{numbers['a']['report']} against {numbers['b']['report']}",
        pairs=pairs,
        unpaired=unpaired(numbers),
    )


def _intervals(pair: Numbers, name: str) -> Figure | None:
    """Draw the difference of every parameter in percent, with its 95 % interval."""
    rows = [row for row in reversed(pair["parameters"]) if row["difference_percent"] is not None and row["difference"]]
    if not rows:
        return None
    reach = [abs(row["interval_percent"][1] - row["interval_percent"][0]) / 2.0 for row in rows]
    trace = {
        "type": "scatter",
        "mode": "markers",
        "x": [round(row["difference_percent"], 3) for row in rows],
        "y": [row["parameter"] for row in rows],
        "error_x": {"type": "data", "array": [round(each, 3) for each in reach], "color": "@ink", "thickness": 1.5},
        "marker": {"color": ["@joint" if row["significant"] else "@ink" for row in rows], "size": 9},
        "hovertemplate": "%{y}: %{x:.3g} %<extra></extra>",
    }
    layout = layout_of(
        xaxis={"title": {"text": "difference, after − before (%)"}, "zeroline": True, "zerolinecolor": "@quiet"},
        yaxis={"automargin": True},
        margin={"l": 20, "r": 14, "t": 14, "b": 44},
        showlegend=False,
    )
    caption = "Difference of each parameter with its 95 % interval: one that crosses zero may be chance."
    return Figure(name, caption, [trace], layout, 110 + 34 * len(rows), time=False)


def comparison_markdown(numbers: Numbers) -> str:
    """Write the comparison for a pull request or a mail."""
    title = f"{numbers['a']['report']} against {numbers['b']['report']}"
    lines = [f"# {escaped(title)}", ""]
    for pair in numbers["pairs"]:
        lines += [f"## {escaped(heading(pair))}", "", flights(pair), ""]
        lines += [f"{escaped(sentence)}\n" for sentence in pair["sentences"]]
        for title, table in tables(pair):
            lines += [f"### {title}", "", markdown_table(table), ""]
    return "\n".join([*lines, escaped(unpaired(numbers))]).rstrip() + "\n"


def comparison_overview(numbers: Numbers) -> RenderableType:
    """Lay the comparison out for a terminal: what changed, and the tables of parameters and errors."""
    parts: list[RenderableType] = []
    for pair in numbers["pairs"]:
        parts += [
            Text(f"{heading(pair)}: {flights(pair)}", style="bold"),
            *(Text(sentence) for sentence in pair["sentences"]),
        ]
        for title, table in tables(pair):
            grid = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
            grid.add_column(title, overflow="fold")
            for head in table["heads"]:
                grid.add_column(head, justify="right")
            for row in table["rows"]:
                grid.add_row(*map(Text, (row["label"], *row["cells"])), style="yellow" if row["kind"] else "")
            parts += [Text(), grid]
        parts.append(Text())
    return Group(*parts, Text(unpaired(numbers), style="dim"))
