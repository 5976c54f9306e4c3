"""Change the parameters of a case by name: from options or from a YAML or TOML file."""

import dataclasses
import difflib
import math
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import yaml

from simulation.errors import ParameterError
from simulation.vehicle import Vector

Settings = TypeVar("Settings")


def changed(settings: Settings, changes: Mapping[str, object]) -> Settings:
    """Return settings with some of them changed."""
    kinds = get_type_hints(type(settings))
    values = {}
    for name, value in changes.items():
        if name not in kinds:
            raise ParameterError(f"there is no setting {name!r}{nearest(name, kinds)}; there are: {', '.join(kinds)}")
        values[name] = _converted(name, value, kinds[name])
    return dataclasses.replace(settings, **values)  # type: ignore[type-var]


def nearest(name: str, names: Iterable[str]) -> str:
    """Suggest the names that look like a wrong one, as the end of a sentence."""
    found = difflib.get_close_matches(name, list(names), n=2, cutoff=0.5)
    return f" (did you mean {' or '.join(found)}?)" if found else ""


def read(path: Path) -> dict[str, object]:
    """Read settings from a YAML file, or a TOML file by its ending.

    Raises
    ------
    ParameterError
        The file cannot be read, is malformed, or is not a list of names with values.
    """
    try:
        text = path.read_text(encoding="utf-8")
        values = tomllib.loads(text) if path.suffix == ".toml" else yaml.safe_load(text)
    except OSError as error:
        raise ParameterError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        reason, form = " ".join(str(error).split()), "TOML" if path.suffix == ".toml" else "YAML"
        raise ParameterError(f"{path} is not well-formed {form}: {reason}") from error
    if values is None:
        return {}
    if not isinstance(values, dict) or not all(isinstance(name, str) for name in values):
        raise ParameterError(f"{path}: wants a name and a value in each line, such as `wind: 3.0`")
    return values


def parse(options: Iterable[str]) -> dict[str, object]:
    """Read options of the form ``name=value``; vectors are numbers with commas, points are vectors with semicolons.

    Raises
    ------
    ParameterError
        An option has another form.
    """
    values: dict[str, object] = {}
    for option in options:
        name, equals, value = option.partition("=")
        if not (equals and name.strip() and value.strip()):
            raise ParameterError(f"{option!r}: wants name=value, such as wind=3 or target=48,35,81")
        values[name.strip()] = value.strip()
    return values


def _converted(name: str, value: object, kind: Any) -> object:
    if kind is float:
        return _number(name, value)
    if kind is int:
        number = _number(name, value)
        if number != round(number):
            raise ParameterError(f"{name} must be a whole number, not {value}")
        return round(number)
    if kind is str:
        return str(value)
    if kind == Vector:
        if name == "wind" and (
            not isinstance(value, str | list | tuple) or (isinstance(value, str) and "," not in value)
        ):
            # The papers' wind blows along x, and is given by its speed.
            return _number(name, value), 0.0, 0.0
        return _vector(name, value)
    points = value.split(";") if isinstance(value, str) else value
    if not isinstance(points, list | tuple):
        raise ParameterError(f"{name} must be a list of points of three numbers, not {value!r}")
    return tuple(_vector(name, point) for point in points)


def _number(name: str, value: object) -> float:
    try:
        if isinstance(value, bool) or not isinstance(value, str | float | int):
            raise ValueError
        number = float(value)
    except ValueError as error:
        raise ParameterError(f"{name} must be a number, not {value!r}") from error
    if not math.isfinite(number):
        raise ParameterError(f"{name} must be a finite number, not {value!r}")
    return number


def _vector(name: str, value: object) -> Vector:
    parts = value.split(",") if isinstance(value, str) else value
    if not (isinstance(parts, list | tuple) and len(parts) == 3):
        raise ParameterError(f"{name} must be three numbers, such as 48,35,81, not {value!r}")
    x, y, z = (_number(name, part) for part in parts)
    return x, y, z
