"""The page of tables of other origin: the answer, the flight beside its prediction, errors by horizon, parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.quantity import number, uncertain
from core.table import Row, Table
from logparse import Finding
from pipeline.results.tables import TableResult
from reports.figures.figure import Drawn, Figure, Trace, layout_of, line, time_axis
from reports.pages.html import render
from reports.views.summary import ShownAnswer, answer_lines
from sysid.validation.states import PredictedStates

_UNITS = {"position": "m", "velocity": "m/s", "attitude": "rad", "rates": "rad/s"}


@dataclass(frozen=True, slots=True, kw_only=True)
class TablesPage:
    """What tables.html shows."""

    title: str
    facts: str
    answer: Sequence[ShownAnswer]
    predictions: Sequence[Figure]  #: The flight beside its prediction, position and attitude.
    by_horizon: Sequence[Figure]
    errors: Table
    missed: Table
    tests: Sequence[str]
    parameters: Table
    undetermined: Sequence[tuple[str, str]]
    findings: Sequence[Finding]


def tables_page(result: TableResult) -> str:
    """Render the page."""
    by_horizon = [figure for state in _UNITS if (figure := _figure(result, state)) is not None]
    predictions = [] if result.prediction is None else _predictions(result.prediction, result.model.attitude_given)
    parameters, undetermined = _parameters(result)
    page = TablesPage(
        title=result.title,
        facts=_facts(result),
        answer=answer_lines(result.answer),
        predictions=predictions,
        by_horizon=by_horizon,
        errors=_errors(result),
        missed=_missed(result),
        tests=[f"{each.name}: {each.test.sentence}" for each in result.missed if each.test is not None],
        parameters=parameters,
        undetermined=undetermined,
        findings=result.findings,
    )
    return render("tables.html", [*predictions, *by_horizon], page)


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


def _missed(result: TableResult) -> Table:
    rows = [
        Row(each.name, [f"{number(each.rms)} {each.unit}", f"{number(each.whole)} {each.unit}"])
        for each in result.missed
    ]
    return Table(
        label="In body axes",
        heads=["missed", "of"],
        rows=rows,
        caption="Acceleration that the model misses from one sample to the next (RMS), of how much there is (spread); "
        "noise of the sensors is part of both.",
    )


def _parameters(result: TableResult) -> tuple[Table, list[tuple[str, str]]]:
    """Parameters that are determined, and why the others are not."""
    rows, missing = [], []
    for name, each in result.model.parameters.items():
        label = name.replace("_", " ")
        if each.value is not None and each.sigma is not None:
            si = ""
            if each.si_value is not None and each.si_sigma is not None:
                si = f"{uncertain(each.si_value, each.si_sigma)} {each.si_unit}"
            rows.append(Row(label, [uncertain(each.value, each.sigma), each.unit, si]))
        elif each.reason != "not part of the model for these inputs":
            missing.append((label, each.reason))
    table = Table(
        label="Parameter",
        heads=["value", "unit", "in units of the inputs"],
        rows=rows,
        caption="Thrust, drag, effectiveness and delays, with one standard error.",
    )
    return table, missing


def _predictions(found: PredictedStates, given: bool) -> list[Figure]:
    """Draw a record beside its prediction, position and attitude; only position where attitude is an input."""
    groups = [("position", "m", 1.0, ("north", "east", "up"), 0)]
    if not given:
        groups.append(("attitude", "°", float(np.degrees(1.0)), ("roll", "pitch", "yaw"), 3))
    figures = []
    for what, unit, factor, names, first in groups:
        data: list[Trace] = []
        axes: Drawn = {}
        for k, name in enumerate(names):
            axis = "" if k == 0 else str(k + 1)
            label = f"{found.horizon:g} s ahead"
            for values, title, color in ((found.measured, "measured", "@ink"), (found.predicted, label, "@body")):
                style = {"yaxis": f"y{axis}", "legendgroup": title, "showlegend": k == 0}
                data.append(line(found.t, factor * values[:, first + k], title, color, width=1.6) | style)
            top = 1.0 - k / 3.0
            axes[f"yaxis{axis}"] = {"domain": [top - 0.29, top], "title": {"text": f"{name} ({unit})"}}
        axes["xaxis"] = time_axis(None) | {"title": {"text": "time (s)"}, "anchor": "y3"}
        before = f"as predicted from the state {found.horizon:g} s before"
        caption = f"{what.capitalize()} of {found.record} as measured, and {before}."
        figures.append(Figure(f"prediction-{what}", caption, data, layout_of(**axes), 480))
    return figures


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
