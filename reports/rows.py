"""Rows of a report's numbers: what any table or text is drawn from, without the numerical packages that made them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

#: A plain structure of numbers and text, as JSON has it.
Numbers = dict[str, Any]

#: Results of Elhesasy 2024, Table 4: the average over nine validation flights of its own craft, m.
PAPER_AVERAGE = {"x": 0.3195, "y": 0.2691, "z": 0.2472}


def average(rows: Sequence[Numbers], key: str = "rmse_m") -> Numbers:
    """Average a column of RMSE rows over flights, output by output, as the last line of the paper's Table 4 does.

    NaN for an output of which a flight has no number.
    """
    outputs = list(rows[0][key]) if rows else []
    return {
        output: sum(math.nan if row[key][output] is None else row[key][output] for row in rows) / len(rows)
        for output in outputs
    }


def held_out(result: Numbers) -> list[Numbers]:
    """Return the RMSE rows of a model on flight time that it was not fitted to."""
    return [row for row in result["rmse"] if row["part"] == "held-out"]
