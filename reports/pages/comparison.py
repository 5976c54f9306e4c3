"""A comparison of two reports as tables, page, Markdown and terminal output, all from the same rows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from rich.console import Group, RenderableType
from rich.text import Text

from core.quantity import counted, number
from core.table import Row, Table, escaped
from pipeline.fleet.comparison import ComparedPair, Facts, ReportComparison
from reports.figures.figure import Figure, Plot, digits, marks
from reports.pages.html import render
from reports.views import summary
from reports.views.fleet import chance, change_table


def error_table(pair: ComparedPair) -> Table:
    """Tabulate the errors of both sides' models on held-out flights."""
    return Table(
        label="Model",
        heads=["before (m)", "after (m)", "after / before", "p"],
        rows=[
            Row(
                f"{row.title}, {row.output}",
                [
                    *(f"{number(side.rmse_m)} ({number(side.mean_m)})" for side in (row.a, row.b)),
                    "–" if row.ratio is None else number(row.ratio),
                    chance(row.p),
                ],
            )
            for row in pair.errors
        ],
        caption="Free-run RMSE on flight time held out, averaged over flights, and in brackets what always "
        "predicting the mean gives. Different flights judge the two sides: livelier ones make all errors larger.",
    )


def verdict_table(pair: ComparedPair) -> Table:
    """Tabulate how far the models of both sides can be trusted."""
    rows = [Row(row.title, [summary.TRUST_WORDS[trust] for trust in (row.a, row.b)]) for row in pair.verdicts]
    return Table("Model", ["before", "after"], rows)


def setting_table(pair: ComparedPair) -> Table:
    """Tabulate what differs in the craft's settings and in those of the analysis."""
    rows = [
        Row(f"{row.name.replace('_', ' ')} ({row.of})", [_setting(value) for value in (row.a, row.b)])
        for row in pair.changed
    ]
    return Table("Setting", ["before", "after"], rows)


def _setting(value: object) -> str:
    if isinstance(value, tuple):
        return f"{len(value)} entries" if value else "none"
    if isinstance(value, float):
        return number(value, 4)
    return "–" if value is None or value == "" else str(value)


def tables(pair: ComparedPair) -> Iterator[tuple[str, Table]]:
    """Yield the tables that have rows, with their headings, what matters most first."""
    for title, table in (
        ("Parameters", change_table(pair.parameters)),
        ("Errors of the models", error_table(pair)),
        ("Verdicts", verdict_table(pair)),
        ("Settings that differ", setting_table(pair)),
    ):
        if table.rows:
            yield title, table


def heading(pair: ComparedPair) -> str:
    """Name what is compared."""
    return pair.a.name if pair.a.name == pair.b.name else f"{pair.a.name} → {pair.b.name}"


def flights(pair: ComparedPair, numbers: ReportComparison) -> str:
    """Name the two sides, with how many flights they hold and when they were."""
    sides = ((numbers.a, pair.a, "Before"), (numbers.b, pair.b, "after"))
    return "; ".join(f"{word}: {side.report}, {_flights(facts)}" for side, facts, word in sides)


def _flights(side: Facts) -> str:
    when = [utc[:10] for utc in (side.first_utc, side.last_utc) if utc]
    days = f" ({' to '.join(dict.fromkeys(when))})" if when else ""
    return f"{counted(side.flights, 'flight')}{days}"


def unpaired(numbers: ReportComparison) -> str:
    """Name the crafts that only one side has; empty when there are none."""
    sides = ((numbers.a, numbers.unpaired.a), (numbers.b, numbers.unpaired.b))
    parts = [f"only in {side.report}: {', '.join(names)}" for side, names in sides if names]
    return f"Not compared, {'; '.join(parts)}." if parts else ""


def comparison_page(numbers: ReportComparison) -> str:
    """Render the page."""
    figures = [_intervals(pair, f"changes-{place}") for place, pair in enumerate(numbers.pairs)]
    sections = [
        (heading(pair), flights(pair, numbers), pair.sentences, figure, list(tables(pair)))
        for pair, figure in zip(numbers.pairs, figures, strict=True)
    ]
    drawn = [figure for figure in figures if figure is not None]
    return render("comparison.html", drawn, title=_title(numbers), pairs=sections, unpaired=unpaired(numbers))


def _title(numbers: ReportComparison) -> str:
    return f"{numbers.a.report} against {numbers.b.report}"


def _intervals(pair: ComparedPair, name: str) -> Figure | None:
    """Draw the difference of every parameter in percent, with its 95 % interval."""
    rows = [
        (row, row.difference_percent, abs(row.interval_percent[1] - row.interval_percent[0]) / 2.0)
        for row in reversed(pair.parameters)
        if row.difference_percent is not None and row.interval_percent is not None and row.difference
    ]
    if not rows:
        return None
    axis = {"title": {"text": "difference, after − before (%)"}, "zeroline": True, "zerolinecolor": "@quiet"}
    plot = Plot({"automargin": True}, x=axis, showlegend=False)
    x, names = [percent for _, percent, _ in rows], [row.parameter for row, *_ in rows]
    points = marks(x, range(len(rows)), "", "@ink", size=9, hover="%{y}: %{x:.3g} %<extra></extra>")
    error = {"type": "data", "array": digits([reach for *_, reach in rows]), "color": "@ink", "thickness": 1.5}
    colors = {"color": ["@joint" if row.significant else "@ink" for row, *_ in rows], "size": 9}
    plot.add(points | {"y": names, "error_x": error, "marker": colors})
    caption = "Difference of each parameter with its 95 % interval: one that crosses zero may be chance."
    room = {"l": 20, "r": 14, "t": 14, "b": 44}
    return plot.figure(name, caption, 110 + 34 * len(rows), margin=room)


def comparison_markdown(numbers: ReportComparison) -> str:
    """Write the comparison for a pull request or a mail."""
    lines = [f"# {escaped(_title(numbers))}", ""]
    for pair in numbers.pairs:
        lines += [f"## {escaped(heading(pair))}", "", flights(pair, numbers), ""]
        lines += [f"{escaped(sentence)}\n" for sentence in pair.sentences]
        for title, table in tables(pair):
            lines += [f"### {title}", "", table.markdown(), ""]
    return "\n".join([*lines, escaped(unpaired(numbers))]).rstrip() + "\n"


def comparison_overview(numbers: ReportComparison) -> RenderableType:
    """Return the comparison for a terminal: what changed, and the tables."""
    parts: list[RenderableType] = []
    for pair in numbers.pairs:
        parts += [
            Text(f"{heading(pair)}: {flights(pair, numbers)}", style="bold"),
            *(Text(sentence) for sentence in pair.sentences),
        ]
        for title, table in tables(pair):
            parts += [Text(), replace(table, label=title).terminal()]
        parts.append(Text())
    return Group(*parts, Text(unpaired(numbers), style="dim"))
