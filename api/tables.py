"""The canonical tables of analysed logs as Parquet, beside the report."""

import logging
from pathlib import Path

import logparse
from logparse.export import export
from pipeline import FleetResult, FlightResult
from pipeline.names import folder_names

_log = logging.getLogger("rotorid.api")


def write_tables(result: FlightResult | FleetResult, folder: Path) -> None:
    """Write ``tables/NAME.parquet`` of a flight, or ``tables/FLIGHT/NAME.parquet`` of each flight of several.

    A log whose tables cannot be written has none here: that must not cost its report.
    """
    if isinstance(result, FlightResult):
        _write(result.log.path, folder, "tables")
        return
    folders = folder_names([flight.name for flight in result.flights])
    for flight in result.flights:
        _write(flight.log.path, folder, f"tables/{folders[flight.name]}")


def _write(log: Path, folder: Path, place: str) -> None:
    try:
        read = logparse.read_log(log)
        names = [name for name in logparse.COLUMNS if getattr(read.tables, name) is not None]
        if names:
            made = folder / "exported"
            export(read, made, messages=names)
            (folder / place).parent.mkdir(parents=True, exist_ok=True)
            (made / "tables").rename(folder / place)
            made.rmdir()
    except Exception:
        _log.exception("the tables of %s cannot be written", log.name)
