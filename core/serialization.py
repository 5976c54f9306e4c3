"""Results as JSON and back: dataclasses by msgspec, arrays as lists, null for what is not finite."""

from __future__ import annotations

import math
import threading
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec

T = TypeVar("T")

#: msgspec analyses a type at its first use, and crashes the process where two threads make it do so at once.
_learning = threading.RLock()


def plain(value: object, text: Callable[[str], str] = str) -> Any:
    """Return a value as dicts, lists, strings and numbers; None for what is not finite. `text` rewrites strings."""
    return _finite(msgspec.to_builtins(value, str_keys=True, enc_hook=_unpacked), text)


def restored(value: object, kind: type[T]) -> T:
    """Return plain values as a type again; ValueError where they are of another.

    None in the place of a number becomes NaN: the number was not finite, which JSON cannot express.
    """
    with _learning:
        try:
            return msgspec.convert(value, kind)
        except msgspec.ValidationError:
            return msgspec.convert(_with_nan(value, kind), kind)


def cleaned(value: object, kind: type[T], text: Callable[[str], str] = str) -> T:
    """Return a value as JSON would bring it back as a type: what is shown is what is written."""
    return restored(plain(value, text), kind)


def as_json(value: object, indent: int | None = 1) -> str:
    """Write strict JSON, null for what is not finite; on one line without an indent."""
    text = msgspec.json.encode(value, enc_hook=_unpacked)
    return msgspec.json.format(text, indent=indent or 0).decode() + "\n"


def from_json(content: str | bytes, kind: type[T]) -> T:
    """Read JSON as a type; ValueError where it is no JSON or of another type."""
    with _learning:
        try:
            return msgspec.json.decode(content, type=kind)
        except msgspec.ValidationError:
            return restored(msgspec.json.decode(content), kind)


def _unpacked(value: Any) -> Any:
    """Return arrays, their numbers, tables, complex numbers and paths as what msgspec can encode."""
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, complex):
        return [value.real, value.imag]
    if hasattr(value, "tolist"):
        return value.tolist()
    if hasattr(value, "reset_index"):
        return value.reset_index().to_dict("records")
    raise TypeError(f"{type(value).__name__} is no part of a result")


def _finite(value: Any, text: Callable[[str], str]) -> Any:
    # What there is most of comes first: a result holds tens of thousands of numbers.
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str):
        return text(value)
    if isinstance(value, dict):
        return {text(key): _finite(item, text) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item, text) for item in value]
    return value


def _with_nan(value: Any, kind: Any) -> Any:
    """Return plain values with NaN where the type has a number and there is none."""
    if value is None:
        return math.nan if kind is float else None
    arguments = typing.get_args(kind)
    if isinstance(value, dict) and not arguments and isinstance(kind, type):
        hints, written = typing.get_type_hints(kind), getattr(kind, "__struct_encode_fields__", ())
        hints |= {
            name: hints[field] for field, name in zip(getattr(kind, "__struct_fields__", ()), written, strict=True)
        }
        return {name: _with_nan(item, hints.get(name)) for name, item in value.items()}
    if isinstance(value, dict) and typing.get_origin(kind) is Mapping:
        return {key: _with_nan(item, arguments[1]) for key, item in value.items()}
    if isinstance(value, list) and typing.get_origin(kind) is tuple:
        kinds = arguments[:1] * len(value) if Ellipsis in arguments else arguments
        return [_with_nan(item, part) for item, part in zip(value, kinds, strict=True)]
    parts = [part for part in arguments if part is not type(None)]
    if len(parts) > 1 and isinstance(value, dict) and "kind" in value:  # several kinds of models
        tagged = (part for part in parts if hasattr(part, "__struct_config__"))
        parts = [part for part in tagged if part.__struct_config__.tag == value["kind"]]
    return _with_nan(value, parts[0]) if len(parts) == 1 else value
