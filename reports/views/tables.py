"""What pages show of a report's numbers: tables, formulae and reasons, ready for their templates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from core.quantity import column, duration, number
from core.table import Row, Table
from pipeline.results.model_report import ByOutput, ModelReport, RmseRow
from pipeline.results.report import CraftReport, FlightReport
from reports.views import summary
from reports.views.models import PLACES


def missing_stages(numbers: FlightReport | CraftReport) -> list[tuple[str, str]]:
    """Name each stage and model that gave nothing with its reason; one reason stands once, where it came first."""
    names = {
        "tables": "Tables",
        "flight": "Flight",
        "rotation": "How it turns",
        "trajectory": "Trajectory",
        "experiment": "Identification",
        "thrust": "Thrust coefficients",
        "parameters": "Physical parameters",
    }
    reasons = [(names.get(stage, stage), reason) for stage, reason in numbers.missing.items()]
    reasons += [(summary.sentence(result.title)[:-1], result.missing) for result in numbers.models]
    seen: set[str] = {""}
    rows = []
    for name, reason in reasons:
        if reason not in seen:
            rows.append((name, reason))
        seen.add(reason)
    return rows


def rmse_lines(rows: Iterable[ByOutput]) -> list[list[str]]:
    """Write errors by output with aligned decimal points, a list for each row."""
    rows = list(rows)
    outputs = list(rows[0]) if rows else []
    columns = [column([row.get(output) for row in rows]) for output in outputs]
    return [list(cells) for cells in zip(*columns, strict=True)]


def rmse_heads(outputs: Iterable[str]) -> list[str]:
    """Head the columns of errors by output."""
    return [f"RMSE {output} (m)" for output in outputs]


def flight_rmse(own: Sequence[ModelReport], others: Sequence[ModelReport] = ()) -> Table | None:
    """Lay out what the flight's own models and those of others achieve on it, beside guesses without a model."""
    lines: list[tuple[str, str, ByOutput | None]] = []
    parted = [(result.title, row) for result in own for row in result.rmse]
    parts = {"held-out": "Last {}: held out, not used in the fit", "training": "First {}: fitted"}
    for part, said in parts.items():
        rows = [(title, row) for title, row in parted if row.part == part]
        if rows:
            lines.append(("part", said.format(duration(rows[0][1].duration_s)), None))
            lines += [("", title, row.rmse_m) for title, row in rows]
            if part == "held-out":
                lines += _guesses(rows[0][1])
    judged = [(result.title, row) for result in others for row in result.rmse]
    for part, said in (("held-out", "which have not seen it"), ("training", "which were fitted to it too")):
        rows = [(title, row) for title, row in judged if row.part == part]
        if rows:
            lines.append(("part", f"Whole flight, by the stored models, {said}", None))
            lines += [("", title, row.rmse_m) for title, row in rows]
            lines += _guesses(rows[0][1])
    if not lines:
        return None
    cells = iter(rmse_lines(row for _, _, row in lines if row is not None))
    outputs = next(list(row) for _, _, row in lines if row is not None)
    return Table(
        label="Model",
        heads=rmse_heads(outputs),
        rows=[Row(label, () if row is None else next(cells), kind) for kind, label, row in lines],
        caption="Root-mean-square error of the free run: position predicted from the inputs and the initial state "
        "alone.",
    )


def _guesses(row: RmseRow) -> list[tuple[str, str, ByOutput | None]]:
    return [
        ("baseline", "… always predicting its mean", row.rmse_mean_m),
        ("baseline", "… standing still", row.rmse_constant_position_m),
    ]


def horizons(models: Sequence[ModelReport]) -> Table | None:
    """Tabulate how far each model errs so many seconds ahead of what was measured, beside guesses without a model."""
    judged = [result for result in models if result.horizons]
    if not judged:
        return None
    seconds = sorted({row.horizon_s for result in judged for row in result.horizons})
    outputs = list(dict.fromkeys(row.output for result in judged for row in result.horizons))
    rows: list[Row] = []
    for output in outputs:
        guesses = {
            "constant position": {r.horizon_s: r.constant_position_m for r in judged[0].horizons if r.output == output},
            "constant velocity": {r.horizon_s: r.constant_velocity_m for r in judged[0].horizons if r.output == output},
        }
        lines = [
            ("", result.title, {r.horizon_s: r.rmse_m for r in result.horizons if r.output == output})
            for result in judged
        ]
        lines += [("baseline", label, curve) for label, curve in guesses.items()]
        columns = [column([curve.get(horizon) for _, _, curve in lines]) for horizon in seconds]
        rows.append(Row(PLACES.get(output, output), kind="part"))
        rows += [Row(label, [cells[place] for cells in columns], kind) for place, (kind, label, _) in enumerate(lines)]
    return Table(
        label="Model",
        heads=[f"{number(horizon, 3)} s" for horizon in seconds],
        rows=rows,
        caption="RMSE in metres of predictions so many seconds ahead, restarted from the measured motion at every "
        "sample, on flight time that the models have not seen; inputs are taken as known.",
    )
