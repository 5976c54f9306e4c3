"""What pages show of a report's numbers: tables, formulae and reasons, ready for their templates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from core.quantity import duration, number
from core.table import Row, Table
from pipeline.results.model_report import ByOutput, ModelReport, RmseRow
from pipeline.results.report import CraftReport, FlightReport
from reports.views import log_words
from reports.views.models import PLACES, thrust_coefficients
from reports.views.parameters import coherence, parameters


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
    reasons += [(log_words.sentence(result.title)[:-1], result.missing) for result in numbers.models]
    seen: set[str] = {""}
    rows = []
    for name, reason in reasons:
        if reason not in seen:
            rows.append((name, reason))
        seen.add(reason)
    return rows


def flight_rmse(own: Sequence[ModelReport], others: Sequence[ModelReport] = ()) -> Table | None:
    """Lay out what the flight's own models and those of others achieve on it, beside guesses without a model."""
    lines: list[tuple[Row, Sequence[float | None]]] = []
    for models, heads in (
        (own, {"held-out": "Last {}: held out, not used in the fit", "training": "First {}: fitted"}),
        (
            others,
            {
                part: f"Whole flight, by the stored models, {said}"
                for part, said in (("held-out", "which have not seen it"), ("training", "which were fitted to it too"))
            },
        ),
    ):
        judged = [(result.title, row) for result in models for row in result.rmse]
        for part, said in heads.items():
            rows = [(title, row) for title, row in judged if row.part == part]
            if rows:
                first = rows[0][1]
                lines.append((Row(said.format(duration(first.duration_s)), kind="part"), ()))
                lines += [(Row(title), _by(first, row.rmse_m)) for title, row in rows]
                if part == "held-out" or models is others:
                    lines.append((Row("… always predicting its mean", kind="baseline"), _by(first, first.rmse_mean_m)))
                    standing = _by(first, first.rmse_constant_position_m)
                    lines.append((Row("… standing still", kind="baseline"), standing))
    if not lines:
        return None
    outputs = next(row.rmse_m for result in (*own, *others) for row in result.rmse)
    return Table.of_numbers(
        "Model",
        rmse_heads(outputs),
        lines,
        "Root-mean-square error of the free run: position predicted from the inputs and the initial state alone.",
    )


def _by(row: RmseRow, errors: ByOutput) -> list[float | None]:
    return [errors.get(output) for output in row.rmse_m]


def of_models(numbers: FlightReport | CraftReport) -> dict[str, object]:
    """Return what the pages on the models of a flight and of a craft have in common."""
    return {
        "missing": missing_stages(numbers),
        "verdicts": [each for each in numbers.models if each.model is not None],
        "horizons": horizons(numbers.models),
        "coherence": coherence(numbers.models),
        "thrust": thrust_coefficients(numbers.thrust, numbers.missing),
        "parameters": parameters(numbers.parameters),
        "models": numbers.models,
    }


def rmse_heads(outputs: Iterable[str]) -> list[str]:
    """Head the columns of errors by output."""
    return [f"RMSE {output} (m)" for output in outputs]


def horizons(models: Sequence[ModelReport]) -> Table | None:
    """Tabulate how far each model errs so many seconds ahead of what was measured, beside guesses without a model."""
    judged = [result for result in models if result.horizons]
    if not judged:
        return None
    seconds = sorted({row.horizon_s for result in judged for row in result.horizons})
    lines: list[tuple[Row, Sequence[float | None]]] = []
    for output in dict.fromkeys(row.output for result in judged for row in result.horizons):
        lines.append((Row(PLACES.get(output, output), kind="part"), ()))
        for row, result, which in (
            *((Row(result.title), result, "rmse_m") for result in judged),
            (Row("constant position", kind="baseline"), judged[0], "constant_position_m"),
            (Row("constant velocity", kind="baseline"), judged[0], "constant_velocity_m"),
        ):
            errors = {each.horizon_s: getattr(each, which) for each in result.horizons if each.output == output}
            lines.append((row, [errors.get(horizon) for horizon in seconds]))
    return Table.of_numbers(
        "Model",
        [f"{number(horizon, 3)} s" for horizon in seconds],
        lines,
        "RMSE in metres of predictions so many seconds ahead, restarted from the measured motion at every sample, on "
        "flight time that the models have not seen; inputs are taken as known.",
    )
