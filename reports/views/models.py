"""What pages show of models: which hold and for what, formulae, coefficients, orders, and how each axis was judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from core.quantity import MINUS, number, uncertain
from core.table import Row, Table
from pipeline.results.answer import HOLDS
from pipeline.results.model_report import ModelReport
from pipeline.results.verdict import PredictionUse
from reports.views import log_words, summary
from sysid.rotors.thrust_record import ThrustModel
from sysid.transfer_functions.model_record import FunctionsRecord, TransferFunctionsRecord
from sysid.validation.report import OrderRow, OrderScan

#: Outputs of flights in words.
PLACES = {"x": "x, north", "y": "y, east", "z": "z, up"}
#: Advice that stands on a page; the rest is folded.
MOST_ADVICE = 3


def holding(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Return models that predict for as long as a person needs to react, and for what they are of use."""
    return [(log_words.sentence(each.title)[:-1], _reach(each.uses.prediction)) for each in models if _holds(each)]


def failing(models: Sequence[ModelReport]) -> list[tuple[str, str]]:
    """Return the other models, and why they are of no use."""
    return [(log_words.sentence(each.title)[:-1], _why_not(each)) for each in models if not _holds(each)]


def _reach(use: PredictionUse) -> str:
    errors = ", ".join(f"{number(error, 2)} m in {output}" for output, error in use.rmse_m.items())
    return f"Predicts {use.horizon_s:g} s ahead" + (f", to {errors}." if errors else ".")


def _holds(model: ModelReport) -> bool:
    return model.model is not None and (model.uses.prediction.horizon_s or 0.0) >= HOLDS


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
    told = " ".join(part for part in ("" if unit == "1" else unit, trimmed) if part)
    return (
        f"Position (m) from each input{f' ({told})' if told else ''}, s in rad/s; position is the sum over the inputs. "
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
        sums = (f"{sum(each for each in some if each is not None):.0f}".replace("-", MINUS) for some in criteria)
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
    common, motors = thrust.common, thrust.per_motor
    rows = []
    single = any(value.determined for value in motors.values())
    for label, value in (
        ("All motors alike", common),
        *((f"Motor {name.removeprefix('m')}", motors[name]) for name in motors if single),
    ):
        cells = [uncertain(value.per_mass, value.sigma)]
        if thrust.mass:
            cells.append(uncertain(value.newton, value.newton_sigma))
        rows.append(Row(label, cells))
    reasons = []
    if common.reason:
        reasons.append(f"All motors alike: not determined, {common.reason}.")
    if not single:
        why = "; ".join(dict.fromkeys(value.reason for value in motors.values() if value.reason))
        reasons.append(f"Single motors: not determined, {why or 'the data do not tell them apart'}.")
    else:
        reasons += [
            f"Motor {name.removeprefix('m')}: not determined, {value.reason}."
            for name, value in motors.items()
            if value.reason
        ]
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
            rows=rows,
            caption=f"Thrust of one motor at full command {summary.thrust_conditions(thrust)}, from the accelerometer. "
            f"The uncertainty is that on this flight; on another day {number(100 * thrust.air_sigma, 2)} % come to it "
            f"for the density of the air. {mass}",
        ),
        reasons=reasons,
        facts=f"The craft hovers at {number(thrust.hover_pwm, 4)} µs, {number(hover, 2)} % of full command; "
        f"the model leaves {number(thrust.rmse, 2)} m/s² of the specific force unexplained.",
    )
