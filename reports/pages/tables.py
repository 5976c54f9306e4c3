"""The page of tables of other origin: the answer, the flight beside its prediction, errors by horizon, parameters."""

from __future__ import annotations

from core.quantity import number, uncertain
from core.table import Row, Table
from pipeline.flight.table_analysis import TableResult, TablesReport
from pipeline.results.signals import Panel, SignalLine
from reports.figures.figure import Figure, Plot, curve, over_time, time_axis
from reports.pages.html import render
from sysid.validation.states import PredictedStates

_UNITS = {"position": "m", "velocity": "m/s", "attitude": "rad", "rates": "rad/s"}


def tables_page(result: TableResult) -> str:
    """Render the page."""
    report = result.report
    by_horizon = [figure for state in _UNITS if (figure := _figure(report, state)) is not None]
    predictions = [] if result.prediction is None else _predictions(result.prediction, result.model.attitude_given)
    parameters, undetermined = _parameters(result)
    return render(
        "tables.html",
        [*predictions, *by_horizon],
        title=report.title,
        facts=_facts(report),
        answer=report.answer.lines,
        predictions=predictions,
        by_horizon=by_horizon,
        errors=_errors(report),
        missed=_missed(report),
        tests=[f"{missed.name}: {missed.test.sentence}" for missed in report.missed if missed.test is not None],
        parameters=parameters,
        undetermined=undetermined,
        findings=report.findings,
    )


def _facts(report: TablesReport) -> str:
    parts = [
        f"{len(report.records)} record{'s' if len(report.records) > 1 else ''}",
        f"{report.duration:.0f} s",
        f"fitted on {', '.join(report.model.training)}",
        f"judged on {', '.join(report.judged)}",
    ]
    return " · ".join(parts)


def _errors(report: TablesReport) -> Table:
    rows: list[Row] = []
    for state, unit in _UNITS.items():
        rows.append(Row(f"{state} ({unit})", kind="part"))
        for horizon in report.horizons:
            cells = [
                "–" if value is None else number(value)
                for value in (report.mean(state, horizon, which) for which in ("model", "held", "carried_on"))
            ]
            rows.append(Row(f"{horizon:g} s", cells))
    return Table(
        label="Horizon",
        heads=["model", "state stays", "constant velocity"],
        rows=rows,
        caption="RMS of the error so far ahead, from every measured state, on what the model has not seen.",
    )


def _missed(report: TablesReport) -> Table:
    rows = [
        Row(missed.name, [f"{number(missed.rms)} {missed.unit}", f"{number(missed.whole)} {missed.unit}"])
        for missed in report.missed
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
    for name, parameter in result.model.parameters.items():
        label = name.replace("_", " ")
        if parameter.value is not None and parameter.sigma is not None:
            si = ""
            if parameter.si_value is not None and parameter.si_sigma is not None:
                si = f"{uncertain(parameter.si_value, parameter.si_sigma)} {parameter.si_unit}"
            rows.append(Row(label, [uncertain(parameter.value, parameter.sigma), parameter.unit, si]))
        elif parameter.reason != "not part of the model for these inputs":
            missing.append((label, parameter.reason))
    table = Table(
        label="Parameter",
        heads=["value", "unit", "in units of the inputs"],
        rows=rows,
        caption="Thrust, drag, effectiveness and delays, with one standard error.",
    )
    return table, missing


def _predictions(states: PredictedStates, given: bool) -> list[Figure]:
    """Draw a record beside its prediction, position and attitude; only position where attitude is an input."""
    groups = [("position", "m", ("north", "east", "up"), 0)]
    if not given:
        groups.append(("attitude", "rad", ("roll", "pitch", "yaw"), 3))
    ahead = f"{states.horizon:g} s ahead"
    figures = []
    for what, unit, names, first in groups:
        panels = [
            Panel(
                title=name,
                unit=unit,
                signals=(
                    SignalLine("measured", states.t, states.measured[:, column]),
                    SignalLine(ahead, states.t, states.predicted[:, column]),
                ),
            )
            for column, name in enumerate(names, start=first)
        ]
        colors = {"measured": "@ink", ahead: "@body"}
        plot = over_time(panels, time_axis(None, "time (s)"), colors=colors, grouped=True, gap=0.13, width=1.6)
        before = f"as predicted from the state {states.horizon:g} s before"
        caption = f"{what.capitalize()} of {states.record} as measured, and {before}."
        figures.append(plot.figure(f"prediction-{what}", caption, 480, time=True))
    return figures


def _figure(report: TablesReport, state: str) -> Figure | None:
    axis = {"title": {"text": f"error of {state} ({_UNITS[state]})"}, "rangemode": "tozero"}
    plot = Plot(axis, x={"title": {"text": "horizon (s)"}, "type": "log"})
    for which, name, color, dash in (
        ("model", "model", "@body", "solid"),
        ("held", "state stays", "@own", "dot"),
        ("carried_on", "constant velocity", "@joint", "dash"),
    ):
        values = [(horizon, report.mean(state, horizon, which)) for horizon in report.horizons]
        known = [(horizon, value) for horizon, value in values if value is not None]
        if known:
            drawn = curve([horizon for horizon, _ in known], [value for _, value in known], name, color, 2.0, dash)
            plot.add(drawn, mode="lines+markers")
    return plot.figure(f"ahead-{state}", f"Error of {state} by horizon; lower is better.", 300) if plot.data else None
