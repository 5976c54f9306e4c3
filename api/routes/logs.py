"""Uploading logs."""

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from api import problems
from api.dependencies import RunnerPart, SettingsPart, StoragePart, from_our_pages
from api.problems import Problem, ProblemError
from api.resources import AnalysisAnswer, Log, State
from api.routes.analyses import answer
from api.uploads import FORM, receive_log

router = APIRouter(prefix="/logs", tags=["logs"], responses=problems.RESPONSES)


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    summary="Upload a log, and analyse it in the same call if wanted",
    openapi_extra=FORM,
    dependencies=[from_our_pages],
)
async def upload_log(
    request: Request,
    response: Response,
    settings: SettingsPart,
    storage: StoragePart,
    runner: RunnerPart,
    analyze: Annotated[bool, Query(description="Wait for the analysis and answer with its models and report.")] = False,
) -> Log | AnalysisAnswer:
    """Keep the file of the form field `file`.

    With `analyze=true` the answer comes when the analysis is done and holds the fitted models and the RMSE report;
    without, it comes at once and `POST /api/v1/analyses` starts an analysis.
    """
    log = await receive_log(request, storage, limit=settings.upload_limit, stall=settings.upload_stall)
    if not analyze:
        response.headers["Location"] = f"/api/v1/logs/{log.id}"
        return log
    analysis = await runner.wait(await run_in_threadpool(runner.submit, log))
    if analysis.problem is not None:
        raise ProblemError(analysis.problem)
    assert analysis.state is State.DONE
    response.headers["Location"] = f"/api/v1/analyses/{analysis.id}"
    return await run_in_threadpool(answer, analysis, storage)


@router.get("/{log_id}", summary="A log's name and size")
def show_log(log_id: str, storage: StoragePart) -> Log:
    """Show what is known of an uploaded log."""
    log = storage.load_log(log_id)
    if log is None:
        raise ProblemError(Problem.of_status(HTTPStatus.NOT_FOUND, "There is no log of this id."))
    return log
