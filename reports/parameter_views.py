"""What pages show of physics: parameters by every method side by side, and how much the inputs can tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from logparse.quantity import column, number, uncertain
from reports import summary
from reports.rows import Numbers

View = dict[str, Any]

#: What stands in a cell whose note, below the table, says why there is no number.
EMPTY = "–"


def parameters(rows: Sequence[Numbers] | None) -> View | None:
    """Tabulate physical parameters, a line each and a column for each method; nothing when no method was applied.

    With the mass given each parameter that the mass turns into SI has a second line.
    """
    if not rows:
        return None
    methods = list(dict.fromkeys(row["method"] for row in rows))
    lines, notes = [], []
    for parameter in dict.fromkeys(row["parameter"] for row in rows):
        found = {row["method"]: row for row in rows if row["parameter"] == parameter}
        unit, _, condition = str(next(iter(found.values()))["unit"]).partition(", ")
        told = f"{_capital(parameter)}, {_written(unit)}" if unit.partition(" ")[0] != "1" else _capital(parameter)
        lines.append(_line(told, condition or _bracket(unit), [_cell(found.get(m), "value", "sigma") for m in methods]))
        si_unit = next((row["si_unit"] for row in found.values() if row["si_value"] is not None), "")
        if si_unit:
            cells = [_cell(found.get(method), "si_value", "si_sigma") for method in methods]
            lines.append(_line(f"… in {_written(si_unit)}", "", cells))
        reasons: dict[str, list[str]] = {}
        for method, row in found.items():
            if row["note"]:
                reasons.setdefault(row["note"], []).append(method)
        notes += [
            (f"{_capital(parameter)}: {', '.join(who)}", summary.sentence(reason)) for reason, who in reasons.items()
        ]
    return {"methods": methods, "rows": lines, "notes": notes}


def _line(label: str, condition: str, cells: list[str]) -> View:
    return {"label": label, "condition": condition, "cells": cells, "known": any(cell != EMPTY for cell in cells)}


def _cell(row: Numbers | None, value: str, sigma: str) -> str:
    return EMPTY if row is None or row[value] is None else uncertain(row[value], row[sigma])


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _bracket(unit: str) -> str:
    return unit.partition("(")[2].rstrip(")") if "(" in unit else ""


def _written(unit: str) -> str:
    return unit.replace("^2", "²").replace("kg m²", "kg·m²")


def coherence(models: Sequence[Numbers]) -> View | None:
    """Tabulate how much of each output is a linear answer to the inputs of each model."""
    told = [result for result in models if result["coherence"]]
    known = [result for result in told if "missing" not in result["coherence"]]
    if not told:
        return None
    outputs = list(dict.fromkeys(output for result in known for output in result["coherence"]["outputs"]))
    heads = [*outputs, "chance"] if known else []
    columns = [
        column([result["coherence"]["outputs"].get(output, {}).get("multiple_median") for result in known], 3, 2)
        for output in outputs
    ]
    if known:
        columns.append(column([result["coherence"]["chance"] for result in known], 3, 2))
    rows = [
        {"kind": "", "label": result["title"], "cells": [cells[place] for cells in columns]}
        for place, result in enumerate(known)
    ]
    return {
        "table": {"caption": "", "label": "Inputs", "heads": heads, "rows": rows} if known else None,
        "sentences": [_worth(result) for result in known]
        + [
            f"{_capital(result['title'])}: {summary.sentence(result['coherence']['missing'])}"
            for result in told
            if "missing" in result["coherence"]
        ],
        "band": " to ".join(number(edge, 2) for edge in (known[0]["coherence"]["band_rad_s"] if known else ())),
    }


def _worth(result: Numbers) -> str:
    """Report of which outputs the inputs tell something at most frequencies of the band, and of which they do not."""
    outputs = result["coherence"]["outputs"]
    good = [name for name, each in outputs.items() if (each["above_chance"] or 0.0) > 0.5]
    poor = [name for name in outputs if name not in good]
    title = _capital(result["title"].partition(" → ")[0])
    if not poor:
        return f"{title}: {_and(good)} answer to them at most frequencies."
    if not good:
        return f"{title}: at most frequencies no answer that chance would not give; slower motion may still follow."
    answers = f"{_and(good)} answer{'s' if len(good) == 1 else ''} to them at most frequencies"
    return f"{title}: {answers}, {_and(poor)} hardly more than by chance."


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
