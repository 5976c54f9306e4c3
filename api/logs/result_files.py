"""The files of an analysis as its page offers them."""

from typing import NamedTuple
from urllib.parse import quote

from api.store import sizes
from api.store.resources import Analysis
from api.work.flown import FILE

#: What people call our files, in the order in which they are offered.
_KNOWN = {
    "report.html": "Report in one file, for mailing and printing",
    "models.html": "All models and parameters, and how they were judged",
    "models.json": "Models",
    "models.mat": "Models for MATLAB",
    "rmse.csv": "RMSE table",
    "coefficients.csv": "Coefficients of the models",
    "parameters.csv": "Physical parameters by every method",
    "track.geojson": "Track for maps (GeoJSON)",
    "track.kml": "Track for Google Earth (KML)",
    "track.gpx": "Track for GPS programs (GPX)",
    "report.json": "All numbers of the report",
    "report.md": "Report in short, as Markdown",
    "proposed.param": "Proposed gains and filters",
    "rollback.param": "Gains and filters as flown, to go back to",
    "sitl_frame.json": "Frame for ArduPilot's simulator",
    "craft.json": "Rigid body with its covariance, and linear hover model",
    "craft.mat": "The same for MATLAB",
}

_FLIGHTS, _TABLES = "flights/", "tables/"


class Download(NamedTuple):
    """A file to download."""

    name: str
    what: str
    size: str
    address: str
    #: What it is called on the visitor's computer.
    saved_as: str


class FlightPage(NamedTuple):
    """The report on one flight of several."""

    name: str
    address: str


def downloads(analysis: Analysis, address: str) -> list[Download]:
    """List the files of an analysis whose resource has this address, those we know by name first.

    Without tables, and without what belongs to single flights and crafts of several.
    """
    order = list(_KNOWN)
    offered = [name for name in analysis.files if "/" not in name and name != FILE]
    offered.sort(key=lambda name: (order.index(name) if name in _KNOWN else len(order), name))
    return _files(analysis, address, offered)


def tables(analysis: Analysis, address: str) -> list[Download]:
    """List the tables of the logs of an analysis."""
    return _files(analysis, address, sorted(name for name in analysis.files if name.startswith(_TABLES)))


def _files(analysis: Analysis, address: str, names: list[str]) -> list[Download]:
    return [
        Download(
            name,
            _KNOWN.get(name, ""),
            sizes.in_words(analysis.files[name]),
            f"{address}/{quote(name)}",
            f"{analysis.log.name}.{name.replace('/', '.')}",
        )
        for name in names
    ]


def flight_pages(analysis: Analysis, address: str) -> list[FlightPage]:
    """List the pages of the flights that were analysed together; none for a single flight."""
    ending = "/report.html"
    names = [name for name in analysis.files if name.startswith(_FLIGHTS) and name.endswith(ending)]
    return [FlightPage(name.removeprefix(_FLIGHTS).removesuffix(ending), f"{address}/{quote(name)}") for name in names]
