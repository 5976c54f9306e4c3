"""JSON Schemas of the files of a report, made from the types that they hold and what is said beside their fields."""

from __future__ import annotations

import inspect
import re
import typing
from typing import Any

import msgspec

from pipeline.results.model_report import ModelsFile
from pipeline.results.report import CraftReport, FleetReport, FlightReport
from pipeline.results.tables import TablesReport

#: Types that each file may hold.
_FILES: dict[str, tuple[type, ...]] = {
    "report": (FlightReport, CraftReport, FleetReport, TablesReport),
    "models": (ModelsFile,),
}


def schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of ``report.json`` or ``models.json``, by its name without the ending."""
    kinds, parts = msgspec.json.schema_components(
        _FILES[name], ref_template="#/$defs/{name}", schema_hook=lambda kind: {"description": "Anything."}
    )
    classes: dict[str, type] = {}
    for kind in _FILES[name]:
        _gather(kind, classes)
    for title, part in parts.items():
        if "properties" not in part:
            continue
        part["additionalProperties"] = False
        comments = _comments(classes[title])
        for field, described in part["properties"].items():
            if field in comments:
                described["description"] = comments[field]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"{name}.json of rotorid",
        "description": "SI units, time in seconds on the log's boot clock, angles in radians unless a name ends in "
        "_deg; what could not be determined is null.",
        "oneOf": list(kinds),
        "$defs": parts,
    }


def _gather(kind: Any, classes: dict[str, type]) -> None:
    """Collect the classes that a type is made of."""
    for part in typing.get_args(kind):
        _gather(part, classes)
    if inspect.isclass(kind) and hasattr(kind, "__annotations__") and kind.__name__ not in classes:
        classes[kind.__name__] = kind
        for part in typing.get_type_hints(kind).values():
            _gather(part, classes)


def _comments(kind: type) -> dict[str, str]:
    """Return what is said of the fields of a class: ``#:`` above a field, or behind it."""
    found: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        above: list[str] = []
        source = inspect.getsource(base).splitlines() if base.__module__.partition(".")[0] in _OWN else []
        for line in map(str.strip, source):
            if line.startswith("#: "):
                above.append(line.removeprefix("#: "))
                continue
            field = re.match(r"(\w+): [^#]*(?:#: (.*))?$", line)
            if field and (text := field[2] or " ".join(above)):
                found[field[1]] = text
            above = []
    return found


#: Packages of our own.
_OWN = ("core", "logparse", "pipeline", "sysid")
