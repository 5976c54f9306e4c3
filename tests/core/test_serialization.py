"""Results survive JSON: what is not finite is null and comes back, what is of another version is refused."""

import dataclasses
import json
import math
from collections.abc import Mapping

import msgspec
import numpy as np
import pytest

from core.serialization import as_json, cleaned, from_json, plain, restored


class Curve(msgspec.Struct, frozen=True, tag_field="kind", tag="curve"):
    x: tuple[float, ...]


class Line(msgspec.Struct, frozen=True, tag_field="kind", tag="line"):
    slope: float


@dataclasses.dataclass(frozen=True)
class Part:
    kind: str
    size: float


@dataclasses.dataclass(frozen=True)
class Result:
    name: str
    value: float
    sigma: float | None
    pair: tuple[float, str]
    table: Mapping[str, tuple[float, ...]]
    model: Curve | Line | None = None
    part: Part | None = None


@pytest.mark.parametrize("model", [None, Line(math.nan), Curve((1.0, math.inf))])
def test_what_is_not_finite_is_null_and_a_number_again(model):
    result = Result("a", math.nan, math.inf, (-math.inf, "x"), {"t": (1.0, math.nan)}, model, Part("p", math.nan))
    text = as_json(result)
    assert json.loads(text)["value"] is None
    for again in (from_json(text, Result), restored(plain(result), Result), cleaned(result, Result)):
        assert math.isnan(again.value)
        assert again.sigma is None
        assert math.isnan(again.pair[0])
        assert again.table["t"][0] == 1.0
        assert math.isnan(again.table["t"][1])
        assert type(again.model) is type(model)
        assert again.part is not None
        assert math.isnan(again.part.size)


def test_arrays_and_their_numbers_are_lists_and_numbers():
    result = Result("a", np.float32(1.5), None, (np.float64(2.0), "x"), {"t": np.array([1.0, 2.0])})
    assert cleaned(result, Result) == Result("a", 1.5, None, (2.0, "x"), {"t": (1.0, 2.0)})


@pytest.mark.parametrize("change", [{"value": "high"}, {"name": None}, {"pair": [1.0]}, {"table": []}, {"model": {}}])
def test_what_is_of_another_type_is_refused(change):
    whole = plain(Result("a", 1.0, None, (1.0, "x"), {}))
    with pytest.raises(ValueError, match=r"Expected|missing|Object|shorter|longer"):
        restored(whole | change, Result)
    with pytest.raises(ValueError, match="missing"):
        restored({"name": "a"}, Result)


@dataclasses.dataclass(frozen=True)
class _Told:
    about: str | int
    value: float = 0.0


def test_an_object_where_a_text_or_a_number_stands_is_refused():
    with pytest.raises(ValueError, match="about"):
        restored({"about": {"kind": "x"}, "value": None}, _Told)
