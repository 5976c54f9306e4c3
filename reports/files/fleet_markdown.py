"""The report on all flights in short, as GitHub-flavoured Markdown: for pull requests and chats."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from core.quantity import counted, uncertain
from core.table import Row, Table, escaped
from pipeline.results.model_report import ModelReport
from pipeline.results.report import CraftReport, FleetReport
from reports.views import fleet as fleet_views
from reports.views import log_words, summary
from reports.views.craft import average_table
from reports.views.drift import drift_sentences
from reports.views.fleet_answer import fleet_answer

_MARKS = {"yes": "✅", "limited": "⚠️", "no": "❌", "unknown": "❔"}
#: Advice, findings and failures that are named.
_MOST = 5


def fleet_markdown(numbers: FleetReport) -> str:
    """Write the summary: what was analysed, each craft, and what went wrong."""
    lines = [f"## {escaped(fleet_views.title(numbers))}", "", escaped(fleet_views.facts(numbers)), ""]
    for craft in numbers.groups:
        lines += _craft(craft, len(numbers.groups) > 1)
    if not numbers.groups:
        lines += [*_answer(numbers), *_flights(numbers), ""] if numbers.flights else ["No log gave a flight.", ""]
    worrying = [finding for finding in numbers.findings if finding.severity != "info"]
    if worrying:
        lines += ["**Health of the logs**", ""]
        lines += [
            f"- {finding.severity}, {counted(len(finding.flights), 'log')}: "
            + escaped(log_words.sentence(finding.reason))
            for finding in worrying[:_MOST]
        ]
        lines += [*_more(worrying, "kinds of findings"), ""]
    failures = numbers.failures
    if failures:
        lines += ["**Logs that gave nothing**", ""]
        lines += [f"- `{each.file.replace('`', '')}`: {escaped(each.reason)}" for each in failures[:_MOST]]
        lines += [*_more(failures, "logs"), ""]
    lines.append(f"<sub>rotorid {numbers.rotorid}; all numbers are in report.json, plots in report.html.</sub>")
    return "\n".join(lines) + "\n"


def _answer(numbers: FleetReport) -> Iterator[str]:
    yield from (f"{escaped(f'{each.purpose}: {each.said}')}  " for each in fleet_answer(numbers))
    yield ""


def _craft(craft: CraftReport, titled: bool) -> Iterator[str]:
    if titled:
        yield from (f"### {escaped(craft.name)}", "")
    yield from (f"{_MARKS[craft.verdict.trust]} **{escaped(craft.verdict.sentence)}**", "")
    yield from (escaped(" ".join(summary.joint_sentences(craft))), "")
    table = average_table(craft)
    if table:
        marks = {model.title: [_predicts(model), _MARKS[model.verdict.trust]] for model in craft.models}
        rows = [
            Row(row.label, [*(str(cell).strip() for cell in row.cells), *marks.get(str(row.label), ["", ""])], row.kind)
            for row in table.rows
        ]
        yield from (Table(table.label, [*table.heads, "predicts", "free run"], rows).markdown(), "")
        yield from (f"<sub>{escaped(table.caption)}</sub>", "")
    uses = [model for model in craft.models if model.model is not None]
    if uses:
        yield from (*(f"- {escaped(model.title)}. {escaped(model.uses.sentence)}" for model in uses), "")
    found = [row for row in craft.parameters or [] if row.value is not None]
    if found:
        yield from ("<details><summary>Parameters</summary>", "")
        rows = [Row(row.parameter, [row.method, uncertain(row.value, row.sigma), row.unit]) for row in found]
        yield from (Table("parameter", ["method", "value", "unit"], rows).markdown(), "", "</details>", "")
    yield from (f"- {escaped(sentence)}" for sentence in drift_sentences(craft.drift))
    yield from (f"- Next time: {escaped(log_words.sentence(each.do))}" for each in craft.advice[:_MOST])
    yield ""


def _flights(numbers: FleetReport) -> Iterator[str]:
    heads = {"Airborne": "airborne", "Height (m)": "height (m)", "What happened": "what happened"}
    heads["Predicts ahead"] = "predicts"
    shown = ((flight.name, fleet_views.flight_cells(flight)) for flight in numbers.flights[: 4 * _MOST])
    rows = [Row(name, [cells[each] for each in heads]) for name, cells in shown]
    yield Table("flight", list(heads.values()), rows).markdown()


def _more(found: Sequence[object], what: str) -> list[str]:
    return [f"- and {len(found) - _MOST} more {what}"] if len(found) > _MOST else []


def _predicts(result: ModelReport) -> str:
    """Write how far ahead a model's predictions are worth having in every axis; a dash where nowhere."""
    horizon = result.uses.prediction.horizon_s
    return "–" if horizon is None else f"{horizon:g} s"
