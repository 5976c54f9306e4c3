"""What the page of one craft shows: errors of its joint models, averaged and flight by flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from core.quantity import counted, number
from core.table import Row, Table
from logparse import Vehicle
from pipeline.results.model_report import ByOutput, ModelReport, average
from pipeline.results.report import CraftReport
from reports.views import log_words
from reports.views.tables import rmse_heads


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
    """Lay the joint models' errors out: a line per held-out flight, and their average."""
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
        [(row, [errors.get(output) for errors in found for output in outputs]) for row, found in lines],
        "Flight by flight, RMSE of the free run in metres.",
        groups=[result.title for result in judged],
    )


def _errors(result: ModelReport, flight: str) -> ByOutput:
    return next((row.rmse_m for row in result.rmse if row.flight == flight), {})


def vehicle_facts(vehicle: Vehicle) -> list[tuple[str, str]]:
    """Describe a craft by what its logs say of it."""
    spin = (vehicle.spin_arm, vehicle.spin_min, vehicle.spin_max)
    facts = [
        ("frame", log_words.frame(vehicle) + (f", {len(vehicle.motors)} motors" if vehicle.motors else "")),
        ("firmware", log_words.firmware(vehicle) or "not described"),
        ("board", vehicle.board_id or ""),
        ("motor outputs", _pair(vehicle.pwm_min, vehicle.pwm_max, "µs")),
        ("spin when armed, least, most", ", ".join(number(value, 2) for value in spin)),
        ("thrust curve (MOT_THST_EXPO)", number(vehicle.thrust_expo, 3)),
    ]
    return [(name, text) for name, text in facts if text]


def _pair(low: float | None, high: float | None, unit: str) -> str:
    return "" if low is None or high is None else f"{number(low, 4)} to {number(high, 4)} {unit}"
