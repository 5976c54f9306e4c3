"""What pages show of a report's numbers: tables, formulae and reasons, ready for their templates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from reports import summary
from reports.formula import transfer_function
from reports.numbers import PAPER_AVERAGE, Numbers, average
from reports.quantity import column, complex_numbers, duration, number, uncertain

View = dict[str, Any]


def missing_stages(numbers: Numbers) -> list[tuple[str, str]]:
    """Name each stage that gave nothing with its reason; one reason stands once, at the first stage it stopped."""
    names = {
        "tables": "Tables",
        "flight": "Flight",
        "trajectory": "Trajectory",
        "experiment": "Identification",
        "thrust": "Thrust coefficients",
        "model": "Transfer functions",
        "validation": "Validation",
    }
    seen: set[str] = set()
    rows = []
    for stage, reason in numbers["missing"].items():
        if reason not in seen:
            rows.append((names.get(stage, stage), reason))
        seen.add(reason)
    return rows


def _rmse_lines(rows: Iterable[Numbers]) -> list[list[str]]:
    """Write the cells of RMSE rows with aligned decimal points, one list for each row."""
    rows = list(rows)
    outputs = list(rows[0]["rmse_m"]) if rows else []
    columns = [column([row["rmse_m"][output] for row in rows]) for output in outputs]
    return [list(cells) for cells in zip(*columns, strict=True)]


def flight_rmse(numbers: Numbers, joint_row: Numbers | None) -> View | None:
    """Lay out what the flight's own model and the joint one achieve on it, beside guesses without a model."""
    rows = list(numbers["rmse"])
    if not rows and joint_row is None:
        return None
    lines: list[tuple[str, str, Numbers]] = []
    for row in rows:
        part = "Last" if row["part"] == "held-out" else "First"
        seen = "held out, not used in the fit" if row["part"] == "held-out" else "fitted"
        lines.append(("", f"{part} {duration(row['duration_s'])}: {seen}", row))
        if row["part"] == "held-out":
            lines.append(("baseline", "… always predicting its mean", row | {"rmse_m": row["rmse_mean_m"]}))
            lines.append(("baseline", "… standing still", row | {"rmse_m": row["rmse_constant_position_m"]}))
    if joint_row is not None:
        seen = "which was fitted to it too" if joint_row["part"] == "training" else "which has not seen it"
        lines.append(("", f"Whole flight by the joint model, {seen}", joint_row))
    cells = _rmse_lines(row for _, _, row in lines)
    return {
        "caption": "Root-mean-square error of the free run: position predicted from motor commands and the initial "
        "state alone.",
        "label": "Part of the flight",
        "outputs": list(lines[0][2]["rmse_m"]),
        "rows": [
            {"kind": kind, "label": label, "link": None, "cells": line}
            for (kind, label, _), line in zip(lines, cells, strict=True)
        ],
    }


def group_rmse(group: Numbers, links: dict[str, str]) -> View | None:
    """Lay the joint model's errors out as Table 4 of Elhesasy 2024: a line per held-out flight, and their average."""
    if not group["rmse"]:
        return None
    held = [row for row in group["rmse"] if row["part"] == "held-out"]
    fitted = [row for row in group["rmse"] if row["part"] == "training"]
    outputs = list(group["rmse"][0]["rmse_m"])
    lines: list[tuple[str, str | None, Numbers]] = [("", row["flight"], row) for row in held]
    if held:
        lines.append(("average", "Average", {"rmse_m": group["rmse_average_m"]}))
        lines.append(("baseline", "Average, always predicting the mean", {"rmse_m": average(held, "rmse_mean_m")}))
        if outputs == list(PAPER_AVERAGE):
            lines.append(
                ("baseline", "Elhesasy 2024, average of nine flights of its own craft", {"rmse_m": PAPER_AVERAGE})
            )
    lines += [("", row["flight"], row) for row in fitted]
    cells = _rmse_lines(row for _, _, row in lines)
    rows: list[View] = []
    for number_, ((kind, label, row), line) in enumerate(zip(lines, cells, strict=True)):
        if number_ == 0 and held:
            rows.append({"kind": "part", "label": "Held out: these flights judge the model"})
        if number_ == len(lines) - len(fitted) and fitted:
            rows.append({"kind": "part", "label": "Fitted: these flights show only how closely the model can follow"})
        link = links.get(str(label)) if "part" in row else None
        rows.append({"kind": kind, "label": label, "link": link, "cells": line})
    return {
        "caption": "Root-mean-square error of the joint model’s free run over whole flights, from motor commands and "
        f"the initial state alone. {group['split'][0].upper()}{group['split'][1:]}.",
        "label": "Flight",
        "outputs": outputs,
        "rows": rows,
    }


def group(group: Numbers, links: dict[str, str]) -> View:
    """Gather what the fleet's page shows of one craft."""
    return {
        "name": group["name"],
        "verdict": group["verdict"],
        "sentences": summary.joint_sentences(group),
        "rmse": group_rmse(group, links),
        "thrust": thrust_coefficients(group["thrust"], group["missing"]),
        "model": transfer_functions(group["model"], group["missing"]),
        "findings": group["findings"],
    }


def flight_rows(flights: Sequence[Numbers], links: dict[str, str]) -> list[View]:
    """List every flight with what its own model achieves, or why there is none."""
    held = [next((row for row in flight["rmse"] if row["part"] == "held-out"), None) for flight in flights]
    cells = iter(_rmse_lines(row for row in held if row is not None))
    views = []
    for flight, row in zip(flights, held, strict=True):
        airborne = flight["flight"]["duration_s"] if flight["flight"] else None
        views.append(
            {
                "name": flight["name"],
                "link": links[flight["name"]],
                "craft": summary.frame(flight["vehicle"]),
                "airborne": "–" if airborne is None else duration(airborne),
                "cells": [] if row is None else next(cells),
                "reason": "" if row is not None else summary.first_reason(flight),
                "trust": flight["verdict"]["trust"],
                "word": summary.TRUST_WORDS[flight["verdict"]["trust"]],
            }
        )
    return views


def transfer_functions(model: Numbers | None, missing: Numbers) -> View:
    """Write every transfer function as a formula with poles and zeros, by output; or why there are none."""
    if model is None:
        return {"outputs": [], "reason": missing.get("model") or missing.get("experiment", "")}
    places = {"x": "x, north", "y": "y, east", "z": "z, up"}
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
                        function["num_determined"],
                        function["den_determined"],
                    ),
                    "poles": ", ".join(complex_numbers(function["poles"])) or "none",
                    "zeros": ", ".join(complex_numbers(function["zeros"])) or "none",
                }
            )
        fit = model["fits"][output]
        title = f"Position {places.get(output, output)}: {len(functions)} transfer functions"
        if fit["undetermined"]:
            title += f" ({fit['undetermined']} of {fit['parameters']} coefficients not determined by the data)"
        outputs.append({"title": title, "functions": functions})
    return {
        "outputs": outputs,
        "intro": "Position (m) from the PWM of each motor (µs about its mean), s in rad/s; position is the sum over "
        "the motors. Pale coefficients have a standard deviation of more than half their value: the data do not "
        "determine them.",
    }


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
