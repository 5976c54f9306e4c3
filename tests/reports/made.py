"""Parts of reports for tests: what a test says, and nothing in all other fields."""

import dataclasses
import enum
import types
import typing
from collections.abc import Mapping
from functools import cache
from typing import Any, TypeVar

T = TypeVar("T")


def made(kind: type[T], /, **facts: Any) -> T:
    """Return a report, or a part of one, with these fields; mappings become the dataclasses that stand there."""
    return _made(kind, facts)


def _made(kind: Any, value: Any) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        if value is None:
            return None
        return _made(next(argument for argument in arguments if argument is not type(None)), value)
    if dataclasses.is_dataclass(kind) and isinstance(value, dict):
        hints = _hints(kind)
        fields = {field.name: field for field in dataclasses.fields(kind)}
        assert value.keys() <= fields.keys(), value.keys() - fields.keys()
        given = {name: _made(hints[name], part) for name, part in value.items()}
        return kind(**{n: _nothing(hints[n]) for n, f in fields.items() if _required(f) and n not in given} | given)
    if origin is tuple and len(arguments) == 2 and arguments[1] is Ellipsis:
        return tuple(_made(arguments[0], part) for part in value)
    if origin is Mapping:
        return {key: _made(arguments[1], part) for key, part in value.items()}
    return kind(value) if isinstance(kind, type) and issubclass(kind, enum.Enum) else value


#: Types of the fields of a dataclass, evaluated once.
_hints = cache(typing.get_type_hints)


def _required(field: Any) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def _nothing(kind: Any) -> Any:
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if type(None) in arguments:
        return None
    if dataclasses.is_dataclass(kind):
        return _made(kind, {})
    if origin is tuple:
        return () if Ellipsis in arguments else tuple(map(_nothing, arguments))
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return list(kind)[-1]
    return {} if origin is Mapping else kind()
