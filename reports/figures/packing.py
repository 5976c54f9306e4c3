"""Figures as small as they travel: long lines as differences of whole numbers, everything gzipped, text around it.

A line of a flight changes little from sample to sample, so its differences are small whole numbers of the last digit
that the plot shows, and gzip leaves about a byte of each. ``plots.js`` undoes both, one figure at a time, when the
figure comes into view.
"""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

#: Shorter lists are not worth their differences.
FEWEST_VALUES = 24
#: Finest last digit that is tried, as a power of ten; lines are rounded to thousandths (`reports.figures.figure.line`).
MOST_DECIMALS = 3
#: Beyond this, sums of whole numbers would no longer be exact.
LARGEST = 2.0**53 / 10**MOST_DECIMALS


def differences(values: list[float | None]) -> dict[str, Any] | None:
    """Write numbers with few decimals as ``{"scale", "deltas"}``, without loss; None where that cannot be.

    Value k is ``scale`` times the sum of the first k + 1 of ``deltas``; a null is a gap and adds nothing.
    """
    numbers = np.array(values, dtype=float)  # a None becomes NaN
    known = np.isfinite(numbers)
    if not known.any() or float(np.abs(numbers[known]).max()) >= LARGEST:
        return None
    for decimals in range(MOST_DECIMALS + 1):
        scale = 10**decimals
        whole = np.round(numbers[known] * scale)
        if np.array_equal(whole / scale, numbers[known]):
            deltas = np.full(len(numbers), None)
            deltas[known] = np.diff(whole, prepend=0.0).astype(np.int64)
            return {"scale": scale, "deltas": deltas.tolist()}
    return None


def compact(trace: Mapping[str, Any]) -> dict[str, Any]:
    """Return a trace with its long lines as differences."""
    slim = dict(trace)
    for axis in ("x", "y"):
        values = slim.get(axis)
        if isinstance(values, list) and len(values) >= FEWEST_VALUES and not isinstance(values[0], str):
            slim[axis] = differences(values) or values
    return slim


def pack(value: object) -> str:
    """Gzip JSON and write it as base64, which may stand in a page as it is."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    return base64.b64encode(gzip.compress(text.encode("utf-8"), compresslevel=6, mtime=0)).decode("ascii")


def unpack(text: str) -> Any:
    """Read what `pack` wrote."""
    return json.loads(gzip.decompress(base64.b64decode(text)))
