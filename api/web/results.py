"""The results of an analysis as files, and as part of an answer."""

import json
import mimetypes
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from fastapi import Query
from fastapi.responses import FileResponse

from api.store.ids import new_id
from api.store.resources import Analysis, AnalysisAnswer, Extra
from api.web.dependencies import Parts
from api.web.middleware import REPORT_POLICY
from api.work.outcome import FILE

#: Media types by the ending of a name; browsers need to be told that text is UTF-8.
_MEDIA_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".json": "application/json",
    ".csv": "text/csv; charset=utf-8",
    ".md": "text/markdown; charset=utf-8",
    ".mat": "application/x-matlab-data",
    ".parquet": "application/vnd.apache.parquet",
}


Include = Annotated[
    Sequence[Extra], Query(description="What to answer in full beside answers, RMSE and coefficients; may come again.")
]


def answer(analysis: Analysis, parts: Parts, include: Sequence[Extra] = tuple(Extra)) -> AnalysisAnswer:
    """Add to an analysis what it found, with as much as `include` asks for."""
    report = _contents(analysis, parts, "report.json")
    return AnalysisAnswer(
        **dict(analysis),
        answers=None if report is None else _answers(report),
        rmse=None if report is None else _rmse(report),
        coefficients=None if report is None else _coefficients(report),
        findings=_findings(report) if report is not None and Extra.FINDINGS in include else None,
        report=report if Extra.REPORT in include else None,
        models=_contents(analysis, parts, "models.json") if Extra.MODELS in include else None,
    )


def file_of(analysis: Analysis, name: str, parts: Parts) -> FileResponse | None:
    """Answer with a file of an analysis, or the range of it that was asked for; None when there is none."""
    path = local_copy(parts.catalog.object_of(analysis, name), parts)
    return None if path is None else file_response(path, name)


def file_response(path: Path, name: str) -> FileResponse:
    """Answer with a file of results by its name."""
    kind = mimetypes.guess_type(name)[0] or "application/octet-stream"
    response = FileResponse(path, media_type=_MEDIA_TYPES.get(Path(name).suffix, kind))
    if name.endswith(".html"):
        response.headers["Content-Security-Policy"] = REPORT_POLICY
    return response


def local_copy(key: str | None, parts: Parts) -> Path | None:
    """Return an object as a file of this computer; what was brought from elsewhere stays, for results never change.

    None where there is no such object, or it was deleted at this moment.
    """
    if key is None:
        return None
    if parts.objects.folder is not None:
        path = parts.objects.folder / key
        return path if path.is_file() else None
    path = parts.settings.data / "cache" / key
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        partial = path.with_name(f"{path.name}.{new_id()}")
        try:
            parts.objects.get(key, partial)
            partial.replace(path)
        except FileNotFoundError:
            return None
        finally:
            partial.unlink(missing_ok=True)
    return path


def _contents(analysis: Analysis, parts: Parts, name: str) -> dict[str, Any] | None:
    key = parts.catalog.object_of(analysis, name)
    if key is None:
        return None
    try:
        contents: dict[str, Any] = json.loads(parts.objects.read(key))
    except FileNotFoundError:  # deleted at this moment
        return None
    return contents


def _findings(report: dict[str, Any]) -> list[dict[str, Any]]:
    """Gather the findings of a report: of one flight, or of each flight and craft."""
    places = [report, *report.get("flights", []), *report.get("groups", [])]
    return [finding for place in places for finding in place.get("findings", [])]


def _answers(report: dict[str, Any]) -> dict[str, list[dict[str, Any]]]:
    """Gather the first screen of each flight."""
    flights = report.get("flights", [report])
    return {str(flight.get("name")): (flight.get("answer") or {}).get("lines", []) for flight in flights}


def _rmse(report: dict[str, Any]) -> list[dict[str, Any]]:
    """Gather the errors of all models, joint ones first."""
    return [row for place in (*report.get("groups", []), report) for row in place.get("rmse", [])]


def _coefficients(report: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Gather the numerators and denominators of transfer functions."""
    coefficients: dict[str, dict[str, Any]] = {}
    for place in (*report.get("groups", []), report):
        for result in place.get("models", []):
            functions = (result["model"] or {}).get("transfer_functions")
            if functions:
                coefficients.setdefault(str(place.get("name")), {})[result["key"]] = {
                    output: {name: {part: function[part] for part in ("num", "den")} for name, function in row.items()}
                    for output, row in functions.items()
                }
    return coefficients


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

_FLIGHTS, _TABLES, _REPORT = "flights/", "tables/", "/report.html"


def downloads(analysis: Analysis) -> list[tuple[str, str]]:
    """List the files of an analysis that are offered, each with what it is, those we know by name first.

    Without tables, and without what belongs to single flights and crafts of several.
    """
    offered = [name for name in analysis.files if "/" not in name and name != FILE]
    known = [name for name in _KNOWN if name in offered]
    return [(name, _KNOWN.get(name, "")) for name in (*known, *sorted(set(offered) - set(known)))]


def tables(analysis: Analysis) -> list[str]:
    """List the tables of the logs of an analysis."""
    return sorted(name for name in analysis.files if name.startswith(_TABLES))


def flight_pages(analysis: Analysis) -> dict[str, str]:
    """Return the reports on flights that were analysed together by the flights' names; none for a single flight."""
    pages = [name for name in analysis.files if name.startswith(_FLIGHTS) and name.endswith(_REPORT)]
    return {name.removeprefix(_FLIGHTS).removesuffix(_REPORT): name for name in pages}
