"""Averages of errors over flights, without the numerical packages that made them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence


def average(rows: Sequence[Mapping[str, float | None]]) -> dict[str, float]:
    """Average errors over flights, output by output.

    NaN for an output of which a flight has no number.
    """
    outputs = list(rows[0]) if rows else []
    return {
        output: sum(math.nan if (value := row[output]) is None else value for row in rows) / len(rows)
        for output in outputs
    }
