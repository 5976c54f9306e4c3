"""Starting analyses, following and cancelling them, and fetching their results."""

import json
from collections.abc import AsyncIterator
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import FileResponse, StreamingResponse
from pydantic import ValidationError

from api import problems
from api.logs.catalog import changes
from api.problems import ProblemError
from api.store.resources import Analysis, AnalysisAnswer, AnalysisOrder, Page, State
from api.web.dependencies import After, AnalysisId, FileName, Limit, OwnAnalysis, Owner, Parts, PartsOf, page
from api.web.results import Include, answer, file_of
from logparse import RotoridError
from pipeline import AnalysisConfig

router = APIRouter(prefix="/analyses", tags=["analyses"], responses=problems.RESPONSES)


@router.post("", status_code=HTTPStatus.ACCEPTED, summary="Analyse uploaded logs")
def start_analysis(order: AnalysisOrder, response: Response, parts: PartsOf, owner: Owner) -> Analysis:
    """Start an analysis and answer at once; `Location` is where to follow it.

    Several logs are analysed together: flights of the same craft are fitted jointly and judged on the other flights.
    """
    check(order)
    try:
        analysis = parts.order(order.ids, order.configuration.chosen(), owner)
    except KeyError as error:
        detail = f"There is no log with the id {error.args[0]}."
        raise ProblemError.of("unknown-log", detail) from error
    response.headers["Location"] = f"/api/v1/analyses/{analysis.id}"
    return analysis


def check(order: AnalysisOrder) -> None:
    """Find out now, and not in the queue, what about a configuration cannot be."""
    try:
        AnalysisConfig(**order.configuration.model_dump(exclude_none=True))
    except RotoridError as error:
        raise ProblemError.of("impossible-configuration", f"configuration: {error}") from error


@router.get("", summary="Analyses, the newest first")
def list_analyses(
    request: Request,
    parts: PartsOf,
    owner: Owner,
    limit: Limit = 50,
    after: After = None,
    state: Annotated[State | None, Query(description="Only those in this state.")] = None,
    log: Annotated[str | None, Query(max_length=64, description="Only those of the log with this id.")] = None,
    q: Annotated[
        str, Query(max_length=200, description="Part of a log's name, the craft, the day or the health.")
    ] = "",
) -> Page[Analysis]:
    """List your analyses."""
    analyses = parts.catalog.list_analyses(owner, limit=limit + 1, after=after, state=state, log=log, text=q.strip())
    return page(request, analyses, limit)


@router.get("/{analysis_id}", summary="How far an analysis is and, once it is done, its models and report")
def show_analysis(analysis: OwnAnalysis, parts: PartsOf, include: Include = ()) -> AnalysisAnswer:
    """Show an analysis: in short, or with all that `include` names."""
    return answer(analysis, parts, include)


@router.get(
    "/{analysis_id}/events",
    summary="The progress of an analysis as server-sent events",
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {"schema": {"description": "Events `progress` and `end`."}}}}},
)
def follow_analysis(analysis: OwnAnalysis, parts: PartsOf) -> StreamingResponse:
    """Send the analysis as an event whenever it has changed; the stream ends with the analysis."""
    return StreamingResponse(_events(parts, analysis), media_type="text/event-stream")


async def _events(parts: Parts, analysis: Analysis) -> AsyncIterator[str]:
    async for now in changes(parts.catalog, analysis, parts.runner.stopping):
        content = json.dumps(now.model_dump(mode="json"), ensure_ascii=False)
        yield f"event: {'end' if now.state.ended else 'progress'}\ndata: {content}\n\n"


@router.post("/{analysis_id}/cancel", summary="Cancel an analysis")
def cancel_analysis(analysis_id: AnalysisId, parts: PartsOf, owner: Owner) -> Analysis:
    """End an analysis that waits or is being worked on; one that has ended stays as it is."""
    return parts.catalog.cancel(analysis_id, owner)


@router.delete("/{analysis_id}", status_code=HTTPStatus.NO_CONTENT, summary="Delete an analysis and its results")
def delete_analysis(analysis_id: AnalysisId, parts: PartsOf, owner: Owner) -> None:
    """Delete an analysis for good; its logs stay."""
    parts.catalog.delete_analysis(analysis_id, owner)


@router.head("/{analysis_id}/{name:path}", include_in_schema=False)
@router.get("/{analysis_id}/{name:path}", response_class=FileResponse, summary="A file of a finished analysis")
def fetch_result(analysis: OwnAnalysis, name: FileName, parts: PartsOf) -> Response:
    """Fetch a file: `report.html`, `report.json`, `models.json`, `models.mat`, `rmse.csv`, `tables/NAME.parquet`.

    `files` of the analysis lists what there is; a part of a file is had with the header `Range`.
    """
    response = file_of(analysis, name, parts)
    if response is None:
        detail = f"This analysis has no {name}." if analysis.state.ended else "This analysis is not done yet."
        raise ProblemError.missing(detail)
    return response


def in_words(error: ValidationError | ProblemError) -> str:
    """Report what about the settings cannot be."""
    if isinstance(error, ProblemError):
        return error.problem.detail.removeprefix("configuration: ")
    return "; ".join(f"{item['loc'][-1]}: {item['msg']}" for item in error.errors())
