"""What pages show of a report's numbers: tables, formulae and reasons, ready for their templates."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from logparse.quantity import column, duration, number
from reports import summary
from reports.model_views import PLACES
from reports.rows import Numbers

View = dict[str, Any]


def missing_stages(numbers: Numbers) -> list[tuple[str, str]]:
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
    reasons = [(names.get(stage, stage), reason) for stage, reason in numbers["missing"].items()]
    reasons += [(summary.sentence(result["title"])[:-1], result["missing"]) for result in numbers["models"]]
    seen: set[str] = {""}
    rows = []
    for name, reason in reasons:
        if reason not in seen:
            rows.append((name, reason))
        seen.add(reason)
    return rows


def verdicts(models: Sequence[Numbers]) -> list[View]:
    """Return every model's verdict for the top of a page."""
    return [
        {
            "title": result["title"],
            "note": result["note"],
            "trust": result["verdict"]["trust"],
            "word": summary.TRUST_WORDS[result["verdict"]["trust"]],
            "sentence": result["verdict"]["sentence"],
            "uses": result["uses"]["sentence"],
        }
        for result in models
        if result["model"] is not None
    ]


def rmse_lines(rows: Iterable[Numbers]) -> list[list[str]]:
    """Write the cells of RMSE rows with aligned decimal points, one list for each row."""
    rows = list(rows)
    outputs = list(rows[0]["rmse_m"]) if rows else []
    columns = [column([row["rmse_m"].get(output) for row in rows]) for output in outputs]
    return [list(cells) for cells in zip(*columns, strict=True)]


def flight_rmse(
    own: Sequence[Numbers], others: Sequence[Numbers] = (), whose: str = "the stored models"
) -> View | None:
    """Lay out what the flight's own models and those of others achieve on it, beside guesses without a model.

    Parameters
    ----------
    own : sequence of dict
        Models of this flight.
    others : sequence of dict
        Models fitted elsewhere, with their RMSE rows of this flight only.
    whose : str
        What the others are.
    """
    lines: list[tuple[str, str, Numbers | None]] = []
    parted = [(result["title"], row) for result in own for row in result["rmse"]]
    parts = {"held-out": "Last {}: held out, not used in the fit", "training": "First {}: fitted"}
    for part in parts:
        rows = [(title, row) for title, row in parted if row["part"] == part]
        if rows:
            lines.append(("part", parts[part].format(duration(rows[0][1]["duration_s"])), None))
            lines += [("", title, row) for title, row in rows]
            if part == "held-out":
                lines += _guesses(rows[0][1])
    judged = [(result["title"], row) for result in others for row in result["rmse"]]
    for part, said in (("held-out", "which have not seen it"), ("training", "which were fitted to it too")):
        rows = [(title, row) for title, row in judged if row["part"] == part]
        if rows:
            lines.append(("part", f"Whole flight, by {whose}, {said}", None))
            lines += [("", title, row) for title, row in rows]
            lines += _guesses(rows[0][1])
    if not lines:
        return None
    cells = iter(rmse_lines(row for _, _, row in lines if row is not None))
    outputs = next(list(row["rmse_m"]) for _, _, row in lines if row is not None)
    return {
        "caption": "Root-mean-square error of the free run: position predicted from the inputs and the initial state "
        "alone.",
        "label": "Model",
        "outputs": outputs,
        "rows": [
            {"kind": kind, "label": label, "link": None, "cells": [] if row is None else next(cells)}
            for kind, label, row in lines
        ],
    }


def _guesses(row: Numbers) -> list[tuple[str, str, Numbers]]:
    return [
        ("baseline", "… always predicting its mean", row | {"rmse_m": row["rmse_mean_m"]}),
        ("baseline", "… standing still", row | {"rmse_m": row["rmse_constant_position_m"]}),
    ]


def horizons(models: Sequence[Numbers]) -> View | None:
    """Tabulate how far each model errs so many seconds ahead of what was measured, beside guesses without a model."""
    judged = [result for result in models if result["horizons"]]
    if not judged:
        return None
    seconds = sorted({row["horizon_s"] for result in judged for row in result["horizons"]})
    outputs = list(dict.fromkeys(row["output"] for result in judged for row in result["horizons"]))
    rows: list[View] = []
    for output in outputs:
        guesses = (("constant position", "constant_position_m"), ("constant velocity", "constant_velocity_m"))
        lines = [("", result["title"], _curve(result, output, "rmse_m")) for result in judged]
        lines += [("baseline", label, _curve(judged[0], output, key)) for label, key in guesses]
        columns = [column([curve.get(horizon) for _, _, curve in lines]) for horizon in seconds]
        rows.append({"kind": "part", "label": PLACES.get(output, output)})
        rows += [
            {"kind": kind, "label": label, "link": None, "cells": [cells[place] for cells in columns]}
            for place, (kind, label, _) in enumerate(lines)
        ]
    return {
        "caption": "RMSE in metres of predictions so many seconds ahead, restarted from the measured motion at every "
        "sample, on flight time that the models have not seen; inputs are taken as known.",
        "label": "Model",
        "heads": [f"{number(horizon, 3)} s" for horizon in seconds],
        "rows": rows,
    }


def _curve(result: Numbers, output: str, key: str) -> dict[float, float]:
    return {row["horizon_s"]: row[key] for row in result["horizons"] if row["output"] == output}


def withdrawn(numbers: Numbers) -> str:
    """Return the first sentence of why there is no trajectory; empty where there is one."""
    reason = numbers["missing"].get("trajectory", "")
    first, _, _ = reason.partition(". ")
    clause, _, _ = first.partition("; ")
    return summary.sentence(clause) if clause else ""
