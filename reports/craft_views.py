"""What the page on all flights shows of one craft: tables in the paper's form, and tests of residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from logparse.quantity import column, number
from reports import summary, views
from reports.coverage_views import coverage_table, outside
from reports.drift_views import drift_sentences, drift_table
from reports.model_views import identified, judgements, thrust_coefficients
from reports.parameter_views import coherence, parameters
from reports.rows import PAPER_AVERAGE, Numbers, average, held_out
from reports.views import rmse_lines

View = dict[str, Any]

#: The kind of model that the paper's table is about, and what its line is called.
PAPER_KIND = "motors"
PAPER_LINE = "Elhesasy 2024, average of nine flights of its own craft"


def craft(numbers: Numbers, links: dict[str, str]) -> View:
    """Gather what the page shows of one craft.

    Parameters
    ----------
    numbers : dict
        Of the craft.
    links : dict of str to str
        Page of every flight, by its name.
    """
    return {
        "name": numbers["name"],
        "verdict": numbers["verdict"],
        "verdicts": views.verdicts(numbers["models"]),
        "sentences": [*summary.joint_sentences(numbers), *drift_sentences(numbers["drift"])[:1]],
        "split": summary.sentence(numbers["split"]),
        "missing": views.missing_stages(numbers),
        "average": average_table(numbers),
        "validation": validation_table(numbers, links),
        "horizons": views.horizons(numbers["models"]),
        "judgements": judgements(numbers["models"]),
        "residuals": residual_table(numbers["models"]),
        "coverage": coverage_table(numbers["coverage"]),
        "outside": outside(numbers["coverage"]),
        "thrust": thrust_coefficients(numbers["thrust"], numbers["missing"]),
        "parameters": parameters(numbers["parameters"]),
        "drift": drift_table(numbers["drift"]),
        "drift_sentences": [
            sentence
            for sentence in drift_sentences(numbers["drift"])
            if sentence not in [summary.sentence(finding["reason"]) for finding in _findings(numbers["drift"])]
        ],
        "coherence": coherence(numbers["models"]),
        "models": identified(numbers["models"]),
        "advice": numbers["advice"],
        "coverage_findings": _findings(numbers["coverage"]),
        "drift_findings": _findings(numbers["drift"]),
        "findings": [
            finding
            for finding in numbers["findings"]
            if finding not in _findings(numbers["coverage"]) + _findings(numbers["drift"])
        ],
        "vehicle": vehicle_facts(numbers["vehicle"]),
    }


def _findings(part: Numbers | None) -> list[Numbers]:
    return [] if part is None else list(part["findings"])


def average_table(craft: Numbers) -> View | None:
    """Set the models side by side with their average errors over the flights held out: the last line of Table 4."""
    judged = [result for result in craft["models"] if result["rmse_average_m"]]
    if not judged:
        return None
    outputs = list(judged[0]["rmse_average_m"])
    lines = [("", result["title"], {"rmse_m": result["rmse_average_m"]}) for result in judged]
    held = held_out(judged[0])
    lines.append(("baseline", "Always predicting the mean", {"rmse_m": average(held, "rmse_mean_m")}))
    lines.append(("baseline", "Standing still", {"rmse_m": average(held, "rmse_constant_position_m")}))
    if outputs == list(PAPER_AVERAGE):
        lines.append(("baseline", PAPER_LINE, {"rmse_m": PAPER_AVERAGE}))
    cells = rmse_lines(row for _, _, row in lines)
    count = len(held)
    return {
        "caption": "Root-mean-square error of the joint models’ free run over whole flights, from the inputs and the "
        f"initial state alone, averaged over the {count} flight{'s' if count != 1 else ''} held out. "
        f"{craft['split'][0].upper()}{craft['split'][1:]}.",
        "label": "Model",
        "outputs": outputs,
        "rows": [
            {"kind": kind, "label": label, "link": None, "cells": line}
            for (kind, label, _), line in zip(lines, cells, strict=True)
        ],
    }


def validation_table(craft: Numbers, links: dict[str, str]) -> View | None:
    """Lay the joint models' errors out as Table 4 of Elhesasy 2024: a line per held-out flight, and their average."""
    judged = [result for result in craft["models"] if result["rmse"]]
    if not judged:
        return None
    outputs = list(judged[0]["rmse"][0]["rmse_m"])
    flights = {
        part: list(dict.fromkeys(row["flight"] for result in judged for row in result["rmse"] if row["part"] == part))
        for part in ("held-out", "training")
    }
    lines: list[tuple[str, str, str | None, list[Numbers]]] = []
    for part, names in flights.items():
        for name in names:
            lines.append((part, name, links.get(name), [_row(result, name) for result in judged]))
        if part == "held-out" and names:
            lines.append(("average", "Average", None, [result["rmse_average_m"] or {} for result in judged]))
            means = [average(held_out(result), "rmse_mean_m") for result in judged]
            lines.append(("baseline", "Always predicting the mean", None, means))
            if outputs == list(PAPER_AVERAGE):
                papers = [PAPER_AVERAGE if result["key"] == PAPER_KIND else {} for result in judged]
                lines.append(("baseline", PAPER_LINE, None, papers))
    columns = [
        column([cells[place].get(output) for _, _, _, cells in lines])
        for place in range(len(judged))
        for output in outputs
    ]
    said = {
        "held-out": "Held out: these flights judge the models",
        "training": "Fitted: these flights show only how closely the models can follow",
    }
    rows: list[View] = []
    for place, (part, label, link, _) in enumerate(lines):
        if part in said and (place == 0 or lines[place - 1][0] != part):
            rows.append({"kind": "part", "label": said[part]})
        kind = part if part in ("average", "baseline") else ""
        rows.append({"kind": kind, "label": label, "link": link, "cells": [cells[place] for cells in columns]})
    return {
        "caption": "Flight by flight, RMSE of the free run in metres.",
        "label": "Flight",
        "models": [result["title"] for result in judged],
        "outputs": outputs,
        "rows": rows,
    }


def _row(result: Numbers, flight: str) -> Numbers:
    return next((dict(row["rmse_m"]) for row in result["rmse"] if row["flight"] == flight), {})


def residual_table(models: Sequence[Numbers]) -> View | None:
    """Tabulate whether errors one sample ahead are white, and independent of the inputs before them."""
    rows: list[View] = []
    for result in models:
        tests = (result["validation"] or {}).get("residuals") or {}
        if not tests:
            continue
        rows.append({"kind": "part", "label": summary.sentence(result["title"])[:-1]})
        for output, test in tests.items():
            correlations = [value for value in test["autocorrelation"] if value is not None]
            dependent = test["dependent"]
            rows.append(
                {
                    "kind": "",
                    "label": output,
                    "cells": [
                        f"{number(test['whiteness'])} ({number(test['whiteness_limit'])})",
                        f"{number(max(correlations, key=abs, default=None), 2)} (±{number(test['band'], 1)})",
                        "yes" if test["white"] else "no",
                        _some(dependent) or "none",
                    ],
                }
            )
    if not rows:
        return None
    return {
        "caption": "Tested are the errors of predictions one sample ahead on flight time not used in the fit: the "
        "portmanteau statistic and the largest autocorrelation, each with the limit that a right model passes 99 times "
        "in a hundred, and whether earlier inputs foretell the errors.",
        "label": "Output",
        "heads": ["portmanteau (limit)", "autocorrelation (band)", "white", "inputs that foretell"],
        "rows": rows,
    }


def _some(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= 3 else f"{', '.join(names[:2])} and {len(names) - 2} more"


def vehicle_facts(vehicle: Numbers) -> list[tuple[str, str]]:
    """Describe a craft by what its logs say of it."""
    spin = [vehicle[name] for name in ("spin_arm", "spin_min", "spin_max")]
    facts = [
        ("frame", summary.frame(vehicle) + (f", {len(vehicle['motors'])} motors" if vehicle["motors"] else "")),
        ("firmware", summary.firmware(vehicle) or "not described"),
        ("board", str(vehicle["board_id"] or "")),
        ("motor outputs", _pair(vehicle["pwm_min"], vehicle["pwm_max"], "µs")),
        ("spin when armed, least, most", "" if None in spin else ", ".join(number(value, 2) for value in spin)),
        ("thrust curve (MOT_THST_EXPO)", "" if vehicle["thrust_expo"] is None else number(vehicle["thrust_expo"], 3)),
    ]
    return [(name, text) for name, text in facts if text]


def _pair(low: float | None, high: float | None, unit: str) -> str:
    return "" if low is None or high is None else f"{number(low, 4)} to {number(high, 4)} {unit}"
