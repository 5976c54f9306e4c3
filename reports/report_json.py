"""Reading of report.json, and its JSON Schema, made from the types and the ``#:`` comments of their fields."""

from __future__ import annotations

import inspect
import json
import re
import typing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from core.lazy import lazy
from core.serialization import restored
from pipeline.config import ConfigError
from pipeline.results.model import ModelsFile
from pipeline.results.report import CraftReport, FleetReport, FlightReport

if TYPE_CHECKING:
    from pipeline.flight import table_analysis
else:
    table_analysis = lazy("pipeline.flight.table_analysis")  # reading the report of a flight needs no tables


def schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema (2020-12) of ``report.json`` or ``models.json``, by its name without the ending."""
    roots = (FlightReport, CraftReport, FleetReport, table_analysis.TablesReport) if name == "report" else (ModelsFile,)
    kinds, parts = msgspec.json.schema_components(
        roots, ref_template="#/$defs/{name}", schema_hook=lambda kind: {"description": "Anything."}
    )
    classes: dict[str, type] = {}
    for kind in roots:
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
    """Collect a type's classes by name."""
    for part in typing.get_args(kind):
        _gather(part, classes)
    if inspect.isclass(kind) and hasattr(kind, "__annotations__") and kind.__name__ not in classes:
        classes[kind.__name__] = kind
        for part in typing.get_type_hints(kind).values():
            _gather(part, classes)


def _comments(kind: type) -> dict[str, str]:
    """Return the comments of a class's fields: ``#:`` above or behind each."""
    comments: dict[str, str] = {}
    for base in reversed(kind.__mro__):
        above: list[str] = []
        source = inspect.getsource(base).splitlines() if base.__module__.partition(".")[0] in _OWN else []
        for line in map(str.strip, source):
            if line.startswith("#: "):
                above.append(line.removeprefix("#: "))
                continue
            field = re.match(r"(\w+): [^#]*(?:#: (.*))?$", line)
            if field and (text := field[2] or " ".join(above)):
                comments[field[1]] = text
            above = []
    return comments


#: Packages whose classes have such comments.
_OWN = ("core", "logparse", "pipeline", "sysid")


_KINDS: dict[object, type[FlightReport] | type[FleetReport]] = {"flight": FlightReport, "fleet": FleetReport}


def read_report(path: str | Path) -> FlightReport | FleetReport:
    """Read a report.json or that of a folder; ConfigError if missing, damaged or of another version."""
    path = Path(path)
    file = path / "report.json" if path.is_dir() else path
    try:
        return parse_report(file.read_bytes(), str(file))
    except FileNotFoundError as error:
        raise ConfigError(f"{path} holds no report.json; give a folder that `rotorid analyze` wrote") from error


def parse_report(content: bytes, name: str = "report.json") -> FlightReport | FleetReport:
    """Parse the text of a report.json; ConfigError, with `name` in it, if damaged or of another version."""
    try:
        return report_of(json.loads(content), name)
    except (ValueError, RecursionError) as error:  # the latter: nested too deep
        raise ConfigError(f"{name} is damaged ({error}); analyze the logs again") from error


def report_of(facts: Any, name: str) -> FlightReport | FleetReport:
    """Convert decoded JSON to a report; ConfigError, with `name` in it, if of another version."""
    kind = facts.get("kind") if isinstance(facts, dict) else None
    if kind not in _KINDS:
        what = "of rotorid" if kind is None else f"of a flight or a folder of flights, but of kind {kind!r}"
        raise ConfigError(f"{name} is not a report {what}; give the report.json of `rotorid analyze`")
    try:
        return restored(facts, _KINDS[kind])
    except ValueError as error:
        by = f" (by {facts['rotorid']})" if "rotorid" in facts else ""
        raise ConfigError(f"{name} was written by another version of rotorid{by}; analyze the logs again") from error
