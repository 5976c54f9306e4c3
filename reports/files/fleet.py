"""The report on a folder of logs, composed of the products of its flights and crafts, and its summary as Markdown."""

from __future__ import annotations

import io
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from typing import Any

from scipy.io import loadmat, savemat

from core.findings import WORST_FIRST, apart
from core.quantity import counted, uncertain
from core.serialization import as_json, cleaned, from_json
from core.table import Row, Table, escaped
from logparse import Finding
from pipeline.fleet.result import FleetResult
from pipeline.names import printable
from pipeline.results.fleet import LogFailure
from pipeline.results.model import ModelReport, ModelsFile
from pipeline.results.report import CommonFinding, CraftReport, FleetReport, FlightReport, LeftOut
from pipeline.storage.manifest import CRAFTS, FLIGHTS
from pipeline.storage.store import Store
from reports import SHARED_SCRIPT
from reports.figures.flight import CraftFigures
from reports.files.folder import FIGURES, page_or_excuse, rmse_table
from reports.pages import html
from reports.pages.fleet import Shown, craft_file, craft_models_page, fleet_page
from reports.views import fleet as fleet_views
from reports.views import log_words, summary
from reports.views.models import average_table


def write_fleet(fleet: FleetResult) -> None:
    """Compose the report on all flights from the products in the fleet's store, unless it is there already.

    ``report.html`` (complete in itself but for the pages of flights and crafts, which it links), ``craft1.html`` and
    so on with the models of each craft, ``report.json`` (crafts in full, flights in short), ``report.md``;
    ``rmse.csv``, ``coefficients.csv`` and ``parameters.csv`` of all; ``models.json`` and ``models.mat`` with the
    models of crafts and of those flights that belong to none; ``plotly.min.js`` for the other pages.
    """
    if fleet.reported:
        return
    store = fleet.store
    flights = [f"{FLIGHTS}/{entry.folder}" for entry in fleet.flights]
    crafts = [f"{CRAFTS}/{entry.folder}" for entry in fleet.groups]
    shown_crafts = _told_apart([_craft(store, folder) for folder in crafts])
    craft_reports = tuple(report for report, _ in shown_crafts)
    rows = [row for craft in craft_reports for row in craft.rmse]
    flight_reports: list[FlightReport] = []
    findings: dict[str, tuple[Finding, ...]] = {}
    for folder in flights:
        report = from_json(store.read(f"{folder}/report.json"), FlightReport)
        flight_reports.append(report.in_short(folder))  # whole reports of many flights would not fit into memory
        findings[report.name] = report.findings
        rows += report.rmse
    numbers = cleaned(
        FleetReport(
            rotorid=version("rotorid"),
            config=fleet.config,
            groups=craft_reports,
            flights=tuple(flight_reports),
            findings=_common_findings(findings),
            failures=_reasons(fleet.failures),
            passed_over=_reasons(fleet.passed_over),
            duplicates=_reasons(fleet.duplicates),
            removed=_reasons(fleet.removed),
            again=fleet.again,
            timings_s=fleet.timings,
        ),
        FleetReport,
        printable,
    )
    joint = {name for craft in numbers.groups for name in (*craft.training, *craft.held_out)}
    alone = [flight.folder for flight in flight_reports if flight.name not in joint]
    store.write("report.json", as_json(numbers).encode())
    store.write("rmse.csv", rmse_table(rows).encode())
    store.write("coefficients.csv", _joined(store, [*crafts, *flights], "coefficients.csv"))
    store.write("parameters.csv", _joined(store, [*crafts, *flights], "parameters.csv"))
    store.write("models.json", as_json(_models(store, [*crafts, *alone]), indent=None).encode())
    store.write("models.mat", _matlab(store, crafts, alone))
    store.write("report.md", fleet_markdown(numbers).encode())
    if flights:
        store.write(SHARED_SCRIPT, html.plotly_script())
    script_file = SHARED_SCRIPT if flights else ""
    for place, craft in enumerate(shown_crafts, start=1):
        page = page_or_excuse(partial(craft_models_page, craft, numbers, place, script_file), craft_file(place))
        store.write(craft_file(place), page.encode())
    page = page_or_excuse(lambda: fleet_page(numbers, craft_reports), "report.html")
    store.write("report.html", page.encode())
    fleet.confirm_report()


def _reasons(failures: Iterable[LogFailure]) -> tuple[LeftOut, ...]:
    return tuple(LeftOut(file=printable(failure.file), reason=printable(failure.reason)) for failure in failures)


def _common_findings(flights: Mapping[str, Sequence[Finding]]) -> tuple[CommonFinding, ...]:
    """Gather the findings of all flights by kind, each with its gravest part, worst and most frequent first."""
    common: dict[str, CommonFinding] = {}
    pairs = [(finding, flight) for flight, findings in flights.items() for finding in findings]
    for finding, flight in sorted(pairs, key=lambda pair: WORST_FIRST.index(pair[0].severity)):
        gravest = next(apart([finding]))
        entry = common.setdefault(
            finding.id,
            CommonFinding(
                id=finding.id,
                severity=gravest.severity,
                reason=gravest.reason,
                advice=gravest.advice,
                example=flight,
                flights=(),
            ),
        )
        common[finding.id] = replace(entry, flights=tuple(dict.fromkeys((*entry.flights, flight))))
    return tuple(
        sorted(common.values(), key=lambda finding: (WORST_FIRST.index(finding.severity), -len(finding.flights)))
    )


def _craft(store: Store, folder: str) -> Shown:
    drawn = from_json(store.read(f"{folder}/{FIGURES}"), CraftFigures)
    report = from_json(store.read(f"{folder}/report.json"), CraftReport)
    return replace(report, folder=folder), drawn


def _told_apart(crafts: Sequence[Shown]) -> list[Shown]:
    """Distinguish crafts of one name by a number: many logs name no more than firmware and frame."""
    count = Counter(craft.name for craft, _ in crafts)
    seen: Counter[str] = Counter()
    apart = []
    for craft, drawn in crafts:
        seen[craft.name] += 1
        name = craft.name if count[craft.name] == 1 else f"{craft.name}, craft {seen[craft.name]}"
        apart.append((replace(craft, name=name), drawn))
    return apart


def _models(store: Store, folders: Iterable[str]) -> ModelsFile:
    files = [from_json(store.read(f"{folder}/models.json"), ModelsFile) for folder in folders]
    return ModelsFile(
        rotorid=version("rotorid"),
        joint=tuple(owner for file in files for owner in file.joint),
        flights=tuple(owner for file in files for owner in file.flights),
    )


def _matlab(store: Store, crafts: Sequence[str], flights: Sequence[str]) -> bytes:
    """Write the models of crafts as structs ``craft1 ...`` and of flights as ``flight1 ...``, in the report's order."""
    structs = {}
    for kind, folders in (("craft", crafts), ("flight", flights)):
        for number, folder in enumerate(folders, start=1):
            variables: dict[str, Any] = loadmat(_file(store.read(f"{folder}/models.mat")))
            models = {name: value for name, value in variables.items() if not name.startswith("__")}
            if models:
                structs[f"{kind}{number}"] = models
    file = _file(b"")
    savemat(file, structs, long_field_names=True, oned_as="row")
    return bytes(file.getvalue())


def _file(content: bytes) -> Any:
    """Return a file in memory; SciPy's annotations know paths only."""
    return io.BytesIO(content)


def _joined(store: Store, folders: Sequence[str], name: str) -> bytes:
    """Join tables that have the same head."""
    lines: list[bytes] = []
    for folder in folders:
        head, *rows = store.read(f"{folder}/{name}").splitlines(keepends=True)
        lines += [head, *rows] if not lines else rows
    return b"".join(lines)


_MARKS = {"yes": "✅", "limited": "⚠️", "no": "❌", "unknown": "❔"}
#: How many pieces of advice, findings and failures are listed.
_MOST = 5


def fleet_markdown(numbers: FleetReport) -> str:
    """Write a summary of what was analysed, of each craft, and of what went wrong."""
    lines = [f"## {escaped(fleet_views.title(numbers))}", "", escaped(fleet_views.facts(numbers)), ""]
    for craft in numbers.groups:
        lines += _craft_in_short(craft, len(numbers.groups) > 1)
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
        lines += [f"- `{failure.file.replace('`', '')}`: {escaped(failure.reason)}" for failure in failures[:_MOST]]
        lines += [*_more(failures, "logs"), ""]
    lines.append(f"<sub>rotorid {numbers.rotorid}; all numbers are in report.json, plots in report.html.</sub>")
    return "\n".join(lines) + "\n"


def _answer(numbers: FleetReport) -> Iterator[str]:
    yield from (f"{escaped(f'{line.purpose}: {line.said}')}  " for line in fleet_views.fleet_answer(numbers))
    yield ""


def _craft_in_short(craft: CraftReport, titled: bool) -> Iterator[str]:
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
    determined = [row for row in craft.parameters or [] if row.value is not None]
    if determined:
        yield from ("<details><summary>Parameters</summary>", "")
        rows = [Row(row.parameter, [row.method, uncertain(row.value, row.sigma), row.unit]) for row in determined]
        yield from (Table("parameter", ["method", "value", "unit"], rows).markdown(), "", "</details>", "")
    yield from (f"- {escaped(sentence)}" for sentence in fleet_views.drift_sentences(craft.drift))
    yield from (f"- Next time: {escaped(log_words.sentence(advice.do))}" for advice in craft.advice[:_MOST])
    yield ""


def _flights(numbers: FleetReport) -> Iterator[str]:
    heads = {"Airborne": "airborne", "Height (m)": "height (m)", "What happened": "what happened"}
    heads["Predicts ahead"] = "predicts"
    shown = ((flight.name, fleet_views.flight_cells(flight)) for flight in numbers.flights[: 4 * _MOST])
    rows = [Row(name, [cells[head] for head in heads]) for name, cells in shown]
    yield Table("flight", list(heads.values()), rows).markdown()


def _more(entries: Sequence[object], what: str) -> list[str]:
    return [f"- and {len(entries) - _MOST} more {what}"] if len(entries) > _MOST else []


def _predicts(result: ModelReport) -> str:
    """Write how far ahead a model's predictions are worth having in every axis; a dash if at no horizon."""
    horizon = result.uses.prediction.horizon_s
    return "–" if horizon is None else f"{horizon:g} s"
