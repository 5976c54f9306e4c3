"""Averages of errors over flights, without the numerical packages that made them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

#: Results of Elhesasy 2024, Table 4: the average over nine validation flights of its own craft, m.
PAPER_AVERAGE = {"x": 0.3195, "y": 0.2691, "z": 0.2472}


def average(rows: Sequence[Mapping[str, float | None]]) -> dict[str, float]:
    """Average errors over flights, output by output, as the last line of the paper's Table 4 does.

    NaN for an output of which a flight has no number.
    """
    outputs = list(rows[0]) if rows else []
    return {
        output: sum(math.nan if (value := row[output]) is None else value for row in rows) / len(rows)
        for output in outputs
    }
