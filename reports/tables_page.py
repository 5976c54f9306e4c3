"""The page of tables of other origin: prediction by horizon for each state, parameters, findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from logparse import Finding
from logparse.quantity import number, uncertain
from pipeline.results.tables import TableResult
from reports.figure import Figure, Trace, layout_of
from reports.html import render
from reports.table import Row, Table

_UNITS = {"position": "m", "velocity": "m/s", "attitude": "rad", "rates": "rad/s"}


@dataclass(frozen=True, slots=True, kw_only=True)
class TablesPage:
    """What tables.html shows."""

    title: str
    facts: str
    verdicts: Sequence[str]
    errors: Table
    parameters: Table
    findings: Sequence[Finding]
    state_figures: Sequence[Figure]


def tables_page(result: TableResult) -> str:
    """Render the page."""
    figures = [figure for state in _UNITS if (figure := _figure(result, state)) is not None]
    page = TablesPage(
        title=result.title,
        facts=_facts(result),
        verdicts=result.verdicts,
        errors=_errors(result),
        parameters=_parameters(result),
        findings=result.findings,
        state_figures=figures,
    )
    return render("tables.html", figures, page)


def _facts(result: TableResult) -> str:
    parts = [
        f"{len(result.records)} record{'s' if len(result.records) > 1 else ''}",
        f"{result.duration:.0f} s",
        f"fitted on {', '.join(result.model.training)}",
        f"judged on {', '.join(result.judged)}",
    ]
    return " · ".join(parts)


def _mean(result: TableResult, state: str, horizon: float, which: str) -> float | None:
    values = [getattr(each, which) for each in result.errors if each.state == state and each.horizon == horizon]
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def _horizons(result: TableResult) -> list[float]:
    return sorted({each.horizon for each in result.errors})


def _errors(result: TableResult) -> Table:
    rows: list[Row] = []
    for state, unit in _UNITS.items():
        rows.append(Row(f"{state} ({unit})", kind="part"))
        for horizon in _horizons(result):
            cells = [
                "–" if value is None else number(value)
                for value in (_mean(result, state, horizon, which) for which in ("model", "held", "carried_on"))
            ]
            rows.append(Row(f"{horizon:g} s", cells))
    return Table(
        label="Horizon",
        heads=["model", "state stays", "constant velocity"],
        rows=rows,
        caption="RMS of the error so far ahead, from every measured state, on what the model has not seen.",
    )


def _parameters(result: TableResult) -> Table:
    rows = []
    for name, each in result.model.parameters.items():
        if each.reason == "not part of the model for these inputs":
            continue
        if each.value is None or each.sigma is None:
            cells = [f"not determined: {each.reason}", each.unit, ""]
        else:
            si = ""
            if each.si_value is not None and each.si_sigma is not None:
                si = f"{uncertain(each.si_value, each.si_sigma)} {each.si_unit}"
            cells = [uncertain(each.value, each.sigma), each.unit, si]
        rows.append(Row(name.replace("_", " "), cells))
    return Table(
        label="Parameter",
        heads=["value", "unit", "in units of the inputs"],
        rows=rows,
        caption="Thrust, drag, effectiveness and delays, with one standard error.",
    )


def _figure(result: TableResult, state: str) -> Figure | None:
    horizons = _horizons(result)
    data: list[Trace] = []
    for which, name, color, dash in (
        ("model", "model", "@body", "solid"),
        ("held", "state stays", "@own", "dot"),
        ("carried_on", "constant velocity", "@joint", "dash"),
    ):
        values = [(horizon, _mean(result, state, horizon, which)) for horizon in horizons]
        known = [(horizon, value) for horizon, value in values if value is not None]
        if known:
            data.append(
                {
                    "type": "scatter",
                    "mode": "lines+markers",
                    "name": name,
                    "x": [round(horizon, 3) for horizon, _ in known],
                    "y": [float(f"{value:.4g}") for _, value in known],
                    "line": {"color": color, "dash": dash},
                }
            )
    if not data:
        return None
    layout = layout_of(
        xaxis={"title": {"text": "horizon (s)"}, "type": "log"},
        yaxis={"title": {"text": f"error of {state} ({_UNITS[state]})"}, "rangemode": "tozero"},
    )
    return Figure(f"ahead-{state}", f"Error of {state} by horizon; lower is better.", data, layout, 300, False)
