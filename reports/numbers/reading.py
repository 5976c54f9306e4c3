"""Reports as `rotorid analyze` wrote them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from core.serialization import restored
from pipeline.config import ConfigError
from pipeline.results.report import FleetReport, FlightReport

_KINDS: dict[object, type[FlightReport] | type[FleetReport]] = {"flight": FlightReport, "fleet": FleetReport}


def read_report(path: str | Path) -> FlightReport | FleetReport:
    """Read a report.json.

    Parameters
    ----------
    path : path-like
        The file, or the folder that holds it.

    Raises
    ------
    ConfigError
        There is none, it is damaged, or of another version of rotorid.
    """
    path = Path(path)
    file = path / "report.json" if path.is_dir() else path
    try:
        return parse_report(file.read_bytes(), str(file))
    except FileNotFoundError as error:
        raise ConfigError(f"{path} holds no report.json; give a folder that `rotorid analyze` wrote") from error


def parse_report(content: bytes, name: str = "report.json") -> FlightReport | FleetReport:
    """Read the text of a report.json; ConfigError where it is none of this version, calling it by its name."""
    try:
        return report_of(json.loads(content), name)
    except (ValueError, RecursionError) as error:  # the latter: nested too deep
        raise ConfigError(f"{name} is damaged ({error}); analyze the logs again") from error


def report_of(facts: Any, name: str) -> FlightReport | FleetReport:
    """Make the report of what its JSON holds; ConfigError where it is of another version, calling it by its name."""
    kind = facts.get("kind") if isinstance(facts, dict) else None
    if kind not in _KINDS:
        what = "of rotorid" if kind is None else f"of a flight or a folder of flights, but of kind {kind!r}"
        raise ConfigError(f"{name} is not a report {what}; give the report.json of `rotorid analyze`")
    try:
        return restored(facts, _KINDS[kind])
    except ValueError as error:
        by = f" (by {facts['rotorid']})" if "rotorid" in facts else ""
        raise ConfigError(f"{name} was written by another version of rotorid{by}; analyze the logs again") from error
