"""What pages show of the models themselves: formulae, coefficients, orders, and how they were judged axis by axis."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from logparse.quantity import MINUS, column, complex_numbers, number, uncertain
from reports import summary
from reports.formula import transfer_function
from reports.rows import Numbers

View = dict[str, Any]

#: Outputs of flights in words.
PLACES = {"x": "x, north", "y": "y, east", "z": "z, up"}


def identified(models: Sequence[Numbers]) -> list[View]:
    """Gather what pages show of each model itself: formulae, orders, findings."""
    return [
        {
            "key": result["key"],
            "title": summary.sentence(result["title"])[:-1],
            "note": result["note"],
            "missing": result["missing"],
            "outputs": [],
            "intro": "",
            "orders": orders(result),
            "findings": result["findings"],
        }
        | (transfer_functions(result["model"]) if _has_functions(result) else {})
        for result in models
    ]


def _has_functions(result: Numbers) -> bool:
    return result["model"] is not None and "transfer_functions" in result["model"]


def transfer_functions(model: Numbers) -> View:
    """Write every transfer function as a formula with poles and zeros, by output."""
    outputs = []
    for output, row in model["transfer_functions"].items():
        functions = []
        for source, function in row.items():
            functions.append(
                {
                    "formula": transfer_function(
                        output,
                        source,
                        function["num"],
                        function["den"],
                        function["num_std"],
                        function["den_std"],
                    ),
                    "poles": complex_numbers(function["poles"], function["poles_std"]),
                    "zeros": complex_numbers(function["zeros"], function["zeros_std"]),
                }
            )
        fit = model["fits"][output]
        count = f"{len(functions)} transfer function{'s' if len(functions) != 1 else ''}"
        title = f"Position {PLACES.get(output, output)}: {count}"
        if fit["undetermined"]:
            title += f" ({fit['undetermined']} of {fit['parameters']} coefficients not determined by the data)"
        note = f"Condition number of the fit {number(fit['condition'], 2)}."
        if not fit["converged"]:
            note += " The search was stopped before it had settled."
        outputs.append({"key": output, "title": title, "functions": functions, "note": note})
    units = {model["units"].get(name, "") for name in model["inputs"]}
    unit = {"us": "µs"}.get(next(iter(units)), next(iter(units))) if len(units) == 1 else ""
    # A closed loop takes targets as they are.
    trimmed = "about its mean" if model["kind"] == "transfer-functions" else ""
    told = " ".join(part for part in ("" if unit == "1" else unit, trimmed) if part)
    about = f" ({told})" if told else ""
    return {
        "outputs": outputs,
        "intro": f"Position (m) from each input{about}, s in rad/s; position is the sum over the inputs. Coefficients "
        "carry as many digits as their uncertainty allows. Pale ones have a standard deviation of more than half their "
        "value: the data do not determine them, and only their order of magnitude is printed.",
    }


def orders(result: Numbers) -> View | None:
    """Tabulate a scan of orders: a line for each, errors on the part held back by output."""
    scan = result["orders"]
    if scan is None:
        return None
    outputs = list(dict.fromkeys(row["output"] for row in scan["table"]))
    tried: dict[tuple[int, int], dict[str, Numbers]] = {}
    for row in scan["table"]:
        tried.setdefault((row["poles"], row["zeros"]), {})[row["output"]] = row
    chosen = scan["recommended"] and (scan["recommended"]["poles"], scan["recommended"]["zeros"])
    errors = [column([rows[output]["rmse_held_out"] for rows in tried.values()]) for output in outputs]
    fitted = [column([rows[output]["rmse"] for rows in tried.values()]) for output in outputs]
    lines = []
    for place, (order, rows) in enumerate(tried.items()):
        together = list(rows.values())
        lines.append(
            {
                "kind": "average" if order == chosen else "",
                "label": f"{order[0]} / {order[1]}",
                "cells": [
                    str(max(row["parameters"] for row in together)),
                    f"{sum(row['aic'] for row in together):.0f}".replace("-", MINUS),
                    f"{sum(row['bic'] for row in together):.0f}".replace("-", MINUS),
                    *(cells[place] for cells in fitted),
                    *(cells[place] for cells in errors),
                ],
            }
        )
    return {
        "reason": scan["reason"],
        "heads": [
            "coefficients",
            "AIC",
            "BIC",
            *(f"fitted {output} (m)" for output in outputs),
            *(f"held back {output} (m)" for output in outputs),
        ],
        "rows": lines,
    }


def judgements(models: Sequence[Numbers]) -> list[View]:
    """Report axis by axis what each model is worth, and what the tests of its residuals found."""
    views = []
    for result in models:
        validation = result["validation"]
        if validation is None:
            continue
        tests = [f"{output}: {test['sentence']}." for output, test in validation["residuals"].items()]
        views.append({"title": result["title"], "verdicts": validation["verdicts"], "tests": tests})
    return views


def thrust_coefficients(thrust: Numbers | None, missing: Numbers) -> View:
    """Tabulate thrust coefficients with their uncertainty; or why there are none."""
    if thrust is None:
        return {"rows": [], "reason": missing.get("thrust") or missing.get("experiment", "")}
    common, motors = thrust["common"], thrust["per_motor"]
    heads = ["k/m (m/s²)", "k (N)"] if thrust["mass"] else ["k/m (m/s²)"]
    rows = []
    single = any(value["determined"] for value in motors.values())
    for label, value in (
        ("All motors alike", common),
        *((f"Motor {name.removeprefix('m')}", motors[name]) for name in motors if single),
    ):
        cells = [uncertain(value["per_mass"], value["sigma"])]
        if thrust["mass"]:
            cells.append(uncertain(value["newton"], value["newton_sigma"]))
        rows.append({"label": label, "cells": cells})
    reasons = []
    if common["reason"]:
        reasons.append(f"All motors alike: not determined, {common['reason']}.")
    if not single:
        why = "; ".join(dict.fromkeys(value["reason"] for value in motors.values() if value["reason"]))
        reasons.append(f"Single motors: not determined, {why or 'the data do not tell them apart'}.")
    else:
        reasons += [
            f"Motor {name.removeprefix('m')}: not determined, {value['reason']}."
            for name, value in motors.items()
            if value["reason"]
        ]
    mass = (
        f"k from the given mass of {thrust['mass']:g} kg."
        if thrust["mass"]
        else "Motion alone gives only k/m; give the take-off mass (--mass) to have k in newtons."
    )
    return {
        "rows": rows,
        "head": heads,
        "caption": f"Thrust of one motor at full command {summary.thrust_conditions(thrust)}, from the accelerometer. "
        f"The uncertainty includes {number(100 * thrust['air_sigma'], 2)} % for the density of the air, "
        f"which all motors, and flights at one place, have in common. {mass}",
        "reasons": reasons,
        "facts": f"The craft hovers at {number(thrust['hover_pwm'], 4)} µs, "
        f"{number(100 * thrust['hover_command'], 2)} % of full command; "
        f"the model leaves {number(thrust['rmse'], 2)} m/s² of the specific force unexplained.",
    }
