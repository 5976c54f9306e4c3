"""What pages show of models: which hold and for what, formulae, coefficients, orders, and how each axis was judged."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from core.quantity import MINUS, counted, duration, number, uncertain
from core.table import Row, Table
from pipeline.results.model import ByOutput, ModelReport, RmseRow, average
from pipeline.results.report import CraftReport, FlightReport
from reports.views import log_words, summary
from reports.views.parameters import coherence, parameters
from sysid.rotors.thrust_record import ThrustModel
from sysid.transfer_functions.model_record import FunctionsRecord, TransferFunctionsRecord
from sysid.validation.report import OrderRow, OrderScan
from sysid.validation.uses import PredictionUse

#: Outputs of flights in words.
PLACES = {"x": "x, north", "y": "y, east", "z": "z, up"}
#: Advice that stands on a page; the rest is folded.
MOST_ADVICE = 3


def holding(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Return models that predict for as long as a person needs to react, and for what they are of use."""
    return [(log_words.sentence(model.title)[:-1], _reach(model.uses.prediction)) for model in models if _holds(model)]


def failing(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Return the other models, and why they are of no use."""
    return [(log_words.sentence(model.title)[:-1], _why_not(model)) for model in models if not _holds(model)]


def _reach(use: PredictionUse) -> str:
    errors = ", ".join(f"{number(error, 2)} m in {output}" for output, error in use.rmse_m.items())
    return f"Predicts {use.horizon_s:g} s ahead" + (f", to {errors}." if errors else ".")


def _holds(model: ModelReport) -> bool:
    return model.model is not None and model.uses.prediction.holds


def _why_not(model: ModelReport) -> str:
    if model.model is None:
        return log_words.sentence(model.missing)
    horizon = model.uses.prediction.horizon_s
    return f"Predicts {horizon:g} s ahead only." if horizon else "Does not predict this flight."


def functions_intro(model: FunctionsRecord) -> str:
    """Explain what the formulae of a model stand for."""
    units = {model.units.get(name, "") for name in model.input_names}
    unit = {"us": "µs"}.get(next(iter(units)), next(iter(units))) if len(units) == 1 else ""
    # A closed loop takes targets as they are.
    trimmed = "about its mean" if isinstance(model, TransferFunctionsRecord) else ""
    note = " ".join(part for part in ("" if unit == "1" else unit, trimmed) if part)
    return (
        f"Position (m) from each input{f' ({note})' if note else ''}, s in rad/s; position is the sum over the inputs. "
        "Coefficients carry as many digits as their uncertainty allows. Pale ones have a standard deviation of more "
        "than half their value: the data do not determine them, and only their order of magnitude is printed."
    )


def orders(scan: OrderScan) -> Table:
    """Tabulate a scan of orders: a line for each, errors on the part held back by output."""
    outputs = list(dict.fromkeys(row.output for row in scan.rows))
    tried: dict[tuple[int, int], dict[str, OrderRow]] = {}
    for row in scan.rows:
        tried.setdefault((row.poles, row.zeros), {})[row.output] = row
    lines = []
    for order, rows in tried.items():
        criteria = ([getattr(row, name) for row in rows.values()] for name in ("aic", "bic"))
        sums = (f"{sum(value for value in some if value is not None):.0f}".replace("-", MINUS) for some in criteria)
        first = [str(max(row.parameters for row in rows.values())), *sums]
        kind = "average" if order == scan.recommended else ""
        errors = [getattr(rows[output], name) for name in ("rmse", "rmse_held_out") for output in outputs]
        lines.append((Row(f"{order[0]} / {order[1]}", first, kind), errors))
    return Table.of_numbers(
        "Order",
        [
            *("coefficients", "AIC", "BIC"),
            *(f"fitted {output} (m)" for output in outputs),
            *(f"held back {output} (m)" for output in outputs),
        ],
        lines,
        "Poles / zeros, each fitted to a part of the training data and judged on the rest of it, RMSE in metres. AIC "
        "and BIC are for comparison: they take residuals for white and lean towards high orders.",
    )


@dataclass(frozen=True, slots=True)
class ShownThrust:
    """Thrust coefficients as a table with what a reader must know of it; or why there are none."""

    table: Table | None = None
    reasons: Sequence[str] = ()
    facts: str = ""
    missing: str = ""


def thrust_coefficients(thrust: ThrustModel | None, missing: Mapping[str, str]) -> ShownThrust:
    """Tabulate thrust coefficients with their uncertainty; or report why there are none."""
    if thrust is None:
        return ShownThrust(missing=missing.get("thrust") or missing.get("experiment", ""))
    common = thrust.common
    cells = [uncertain(common.per_mass, common.sigma)]
    if thrust.mass:
        cells.append(uncertain(common.newton, common.newton_sigma))
    mass = (
        f"Newtons are by the given mass of {thrust.mass:g} kg."
        if thrust.mass
        else "Motion alone gives only thrust over mass; give the take-off mass (--mass) to have newtons."
    )
    hover = None if thrust.hover_command is None else 100.0 * thrust.hover_command
    return ShownThrust(
        table=Table(
            label="",
            heads=["thrust/mass (m/s²)", "thrust (N)"] if thrust.mass else ["thrust/mass (m/s²)"],
            rows=[Row("All motors alike", cells)],
            caption=f"Thrust of one motor at full command {summary.thrust_conditions(thrust)}, from the accelerometer. "
            f"The uncertainty is that on this flight; on another day {number(100 * thrust.air_sigma, 2)} % come to it "
            f"for the density of the air. {mass}",
        ),
        reasons=[f"Not determined: {common.reason}."] if common.reason else [],
        facts=f"The craft hovers at {number(thrust.hover_pwm, 4)} µs, {number(hover, 2)} % of full command; "
        f"the model leaves {number(thrust.rmse, 2)} m/s² of the specific force unexplained.",
    )


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


#: What heads the errors of a flight's own models, and of stored ones that were run on it.
_OWN = {"held-out": "Last {}: held out, not used in the fit", "training": "First {}: fitted"}
STORED = {
    "held-out": "Whole flight, by the stored models, which have not seen it",
    "training": "Whole flight, by the stored models, which were fitted to it too",
}


def flight_rmse(models: Sequence[ModelReport], heads: Mapping[str, str] = _OWN) -> Table | None:
    """Tabulate errors of models on a flight, beside baselines without a model."""
    judged = [(result.title, row) for result in models for row in result.rmse]
    lines: list[tuple[Row, Sequence[float | None]]] = []
    for part, said in heads.items():
        rows = [(title, row) for title, row in judged if row.part == part]
        if not rows:
            continue
        first = rows[0][1]
        lines.append((Row(said.format(duration(first.duration_s)), kind="part"), ()))
        lines += [(Row(title), _by(first, row.rmse_m)) for title, row in rows]
        if part == "held-out" or heads is STORED:
            lines.append((Row("… always predicting its mean", kind="baseline"), _by(first, first.rmse_mean_m)))
            lines.append((Row("… standing still", kind="baseline"), _by(first, first.rmse_constant_position_m)))
    return (
        Table.of_numbers(
            "Model",
            rmse_heads(judged[0][1].rmse_m),
            lines,
            "Root-mean-square error of the free run: position predicted from the inputs and the initial state alone.",
        )
        if lines
        else None
    )


def _by(row: RmseRow, errors: ByOutput) -> list[float | None]:
    return [errors.get(output) for output in row.rmse_m]


def of_models(numbers: FlightReport | CraftReport) -> dict[str, object]:
    """Return what the pages on the models of a flight and of a craft have in common."""
    return {
        "missing": missing_stages(numbers),
        "verdicts": [model for model in numbers.models if model.model is not None],
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
            errors = {
                horizon.horizon_s: getattr(horizon, which) for horizon in result.horizons if horizon.output == output
            }
            lines.append((row, [errors.get(horizon) for horizon in seconds]))
    return Table.of_numbers(
        "Model",
        [f"{number(horizon, 3)} s" for horizon in seconds],
        lines,
        "RMSE in metres of predictions so many seconds ahead, restarted from the measured motion at every sample, on "
        "flight time that the models have not seen; inputs are taken as known.",
    )


def average_table(craft: CraftReport) -> Table | None:
    """Set the models side by side with their average errors over the flights held out."""
    judged = [result for result in craft.models if result.rmse_average_m]
    if not judged:
        return None
    outputs = list(judged[0].rmse_average_m)
    held = judged[0].held_out
    lines: list[tuple[Row, ByOutput]] = [(Row(result.title), result.rmse_average_m) for result in judged]
    lines.append((Row("Always predicting the mean", kind="baseline"), average([row.rmse_mean_m for row in held])))
    lines.append((Row("Standing still", kind="baseline"), average([row.rmse_constant_position_m for row in held])))
    return Table.of_numbers(
        "Model",
        rmse_heads(outputs),
        [(row, [errors.get(output) for output in outputs]) for row, errors in lines],
        "Root-mean-square error of the joint models’ free run over whole flights, from the inputs and the initial "
        f"state alone, averaged over the {counted(len(held), 'flight')} held out. "
        f"{craft.split[0].upper()}{craft.split[1:]}.",
    )


def validation_table(craft: CraftReport, links: Mapping[str, str]) -> Table | None:
    """Tabulate errors of joint models: a row per held-out flight, and their average."""
    judged = [result for result in craft.models if result.rmse]
    if not judged:
        return None
    outputs = list(judged[0].rmse[0].rmse_m)
    lines: list[tuple[Row, Sequence[ByOutput]]] = []
    for part, said in (
        ("held-out", "Held out: these flights judge the models"),
        ("training", "Fitted: these flights show only how closely the models can follow"),
    ):
        names = list(dict.fromkeys(row.flight for result in judged for row in result.rmse if row.part == part))
        if names:
            lines.append((Row(said, kind="part"), ()))
        lines += [(Row(name, link=links.get(name)), [_errors(result, name) for result in judged]) for name in names]
        if part == "held-out" and names:
            lines.append((Row("Average", kind="average"), [result.rmse_average_m for result in judged]))
            means = [average([row.rmse_mean_m for row in result.held_out]) for result in judged]
            lines.append((Row("Always predicting the mean", kind="baseline"), means))
    return Table.of_numbers(
        "Flight",
        outputs * len(judged),
        [(row, [errors.get(output) for errors in line for output in outputs]) for row, line in lines],
        "Flight by flight, RMSE of the free run in metres.",
        groups=[result.title for result in judged],
    )


def _errors(result: ModelReport, flight: str) -> ByOutput:
    return next((row.rmse_m for row in result.rmse if row.flight == flight), {})
