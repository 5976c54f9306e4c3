"""Figures on their way into a page: small, and the same when they arrive."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from reports.figures.figure import line
from reports.figures.packing import FEWEST_VALUES, compact, differences, pack, unpack

decimals = st.integers(-(10**9), 10**9).map(lambda whole: whole / 1000)


def undone(packed: dict) -> list[float | None]:
    """Undo differences as the page's script does."""
    total, values = 0, []
    for delta in packed["deltas"]:
        total += delta or 0
        values.append(None if delta is None else total / packed["scale"])
    return values


@given(st.lists(st.one_of(st.none(), decimals), min_size=1))
def test_differences_lose_nothing(values):
    packed = differences(values)
    assert (packed is None) == all(value is None for value in values)
    assert packed is None or undone(json.loads(json.dumps(packed))) == values


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=FEWEST_VALUES))
def test_what_is_not_decimal_stays_as_it_is_or_the_same(values):
    trace = compact({"x": values})
    kept = trace["x"]
    assert (undone(kept) if isinstance(kept, dict) else kept) == pytest.approx(values, rel=1e-15, abs=0.0)


def test_a_flight_takes_little_more_than_a_byte_a_sample():
    """The paper's page budget: eight megabytes for twelve flights of four models."""
    t = np.arange(0.0, 150.0, 0.1)
    rng = np.random.default_rng(3)
    y = 20.0 * np.sin(0.1 * t) + np.cumsum(rng.normal(0.0, 0.003, len(t)))
    trace = compact(line(t, y, "x", "@ink"))
    assert len(pack(trace)) < 2.5 * len(t)
    assert undone(unpack(pack(trace))["y"]) == pytest.approx(y, abs=5.1e-4)
