"""Starting analyses, following them and fetching their results."""

import json
from http import HTTPStatus
from typing import Any

from fastapi import APIRouter, Response
from fastapi.responses import FileResponse

from api import problems
from api.dependencies import RunnerPart, StoragePart, from_our_pages
from api.headers import REPORT_POLICY
from api.jobs import Runner
from api.problems import Problem, ProblemError
from api.resources import Analysis, AnalysisAnswer, AnalysisOrder
from api.storage import RESULTS, Storage

router = APIRouter(prefix="/analyses", tags=["analyses"], responses=problems.RESPONSES)


@router.post("", status_code=HTTPStatus.ACCEPTED, summary="Analyse an uploaded log", dependencies=[from_our_pages])
def start_analysis(
    order: AnalysisOrder, response: Response, storage: StoragePart, runner: RunnerPart
) -> AnalysisAnswer:
    """Start an analysis and answer at once; `Location` is where to follow it."""
    log = storage.load_log(order.log)
    if log is None:
        raise ProblemError(
            Problem.named("unknown-log", "Unknown log", HTTPStatus.UNPROCESSABLE_ENTITY, "There is no log of this id.")
        )
    analysis = runner.submit(log)
    response.headers["Location"] = f"/api/v1/analyses/{analysis.id}"
    return answer(analysis, storage)


@router.get("/{analysis_id}", summary="How far an analysis is and, once it is done, its models and report")
def show_analysis(analysis_id: str, storage: StoragePart, runner: RunnerPart) -> AnalysisAnswer:
    """Show an analysis."""
    return answer(find_analysis(analysis_id, runner), storage)


@router.head("/{analysis_id}/{name}", include_in_schema=False)
@router.get("/{analysis_id}/{name}", response_class=FileResponse, summary="A file of a finished analysis")
def fetch_result(analysis_id: str, name: str, storage: StoragePart, runner: RunnerPart) -> Response:
    """Fetch `report.html`, `report.json`, `models.json` or `rmse.csv`."""
    analysis = find_analysis(analysis_id, runner)
    path = storage.result(analysis, name)
    if path is None:
        detail = f"This analysis has no {name}." if analysis.state.ended else "This analysis is not done yet."
        raise ProblemError(Problem.of_status(HTTPStatus.NOT_FOUND, detail))
    response = FileResponse(path, media_type=RESULTS[name])
    if name == "report.html":
        response.headers["Content-Security-Policy"] = REPORT_POLICY
    return response


def find_analysis(analysis_id: str, runner: Runner) -> Analysis:
    """Look an analysis up, with its present state; a problem when there is none of this id."""
    analysis = runner.find(analysis_id)
    if analysis is None:
        raise ProblemError(Problem.of_status(HTTPStatus.NOT_FOUND, "There is no analysis of this id."))
    return analysis


def answer(analysis: Analysis, storage: Storage) -> AnalysisAnswer:
    """Add to an analysis what it found and where its files are."""
    return AnalysisAnswer(
        **dict(analysis),
        links=links_of(analysis, storage),
        report=_contents(analysis, storage, "report.json"),
        models=_contents(analysis, storage, "models.json"),
    )


def links_of(analysis: Analysis, storage: Storage) -> dict[str, str]:
    """Give the addresses of an analysis, of its page and log and, once it is done, of its files."""
    here = f"/api/v1/analyses/{analysis.id}"
    links = {"self": here, "log": f"/api/v1/logs/{analysis.log.id}", "page": f"/analyses/{analysis.id}"}
    return links | {name: f"{here}/{name}" for name in RESULTS if storage.result(analysis, name)}


def _contents(analysis: Analysis, storage: Storage, name: str) -> dict[str, Any] | None:
    path = storage.result(analysis, name)
    if path is None:
        return None
    contents: dict[str, Any] = json.loads(path.read_bytes())
    return contents
