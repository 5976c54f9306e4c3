"""Uploading logs, listing and deleting them."""

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool

from api import problems
from api.access import bearer
from api.logs.catalog import ended
from api.problems import ProblemError
from api.store.resources import Analysis, AnalysisAnswer, Log, Page, State, UploadedLog, UploadedLogs
from api.web.dependencies import After, Limit, LogId, Owner, OwnLog, Parts, PartsOf, owner_of, page
from api.web.results import Include, answer
from api.web.uploads import FORM, receive_logs

router = APIRouter(prefix="/logs", tags=["logs"], responses=problems.RESPONSES)


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    summary="Upload logs, and analyse them in the same call if wanted",
    openapi_extra=FORM,
)
async def upload_log(
    request: Request,
    response: Response,
    parts: PartsOf,
    owner: Owner,
    analyze: Annotated[bool, Query(description="Wait for the analysis and answer with what it found.")] = False,
    include: Include = (),
) -> UploadedLog | UploadedLogs | AnalysisAnswer:
    """Keep the files of the form field `file`; the same content uploaded again is the same log.

    One file is answered with its log, several with a list of theirs.
    With `analyze=true` the answer comes when the analysis is done and holds the answers of the first screen, the RMSE
    of all models and their coefficients; the rest is behind its links, or comes with `include`. Without, it comes at
    once and `POST /api/v1/analyses` starts an analysis.
    """
    kept = await receive_logs(request, parts, owner)
    if not analyze:
        logs = [UploadedLog(**dict(received.log), delete_token=received.delete_token) for received in kept]
        if len(logs) > 1:
            return UploadedLogs(logs=logs)
        response.headers["Location"] = f"/api/v1/logs/{logs[0].id}"
        return logs[0]
    ordered = await run_in_threadpool(parts.order, [received.log.id for received in kept], {}, owner)
    analysis = await ended(parts.catalog, ordered, parts.runner.stopping)
    response.headers["Location"] = f"/api/v1/analyses/{analysis.id}"
    if analysis.problem is not None:
        raise ProblemError(analysis.problem)
    if analysis.state is not State.DONE:
        raise _unfinished(analysis)
    return await run_in_threadpool(answer, analysis, parts, include)


def _unfinished(analysis: Analysis) -> ProblemError:
    """Return the problem for a client that waited for an analysis which did not finish."""
    if analysis.state is State.CANCELLED:
        return ProblemError.of("cancelled", "The analysis was cancelled.")
    detail = (
        "The service is being stopped. The log is kept and its analysis goes on when the service is back: look at "
        f"/api/v1/analyses/{analysis.id}."
    )
    return ProblemError.of("stopping", detail)


@router.get("", summary="Logs, the newest first")
def list_logs(
    request: Request,
    parts: PartsOf,
    owner: Owner,
    limit: Limit = 50,
    after: After = None,
    name: Annotated[str, Query(max_length=200, description="Part of the name.")] = "",
) -> Page[Log]:
    """List your logs."""
    return page(request, parts.catalog.list_logs(owner, limit=limit + 1, after=after, name=name), limit)


@router.get("/{log_id}", summary="A log's name and size")
def show_log(log: OwnLog) -> Log:
    """Show what is known of an uploaded log."""
    return log


@router.delete("/{log_id}", status_code=HTTPStatus.NO_CONTENT, summary="Delete a log and all analyses of it")
def delete_log(
    request: Request,
    log_id: LogId,
    parts: PartsOf,
    delete_token: Annotated[
        str | None, Header(max_length=100, description="As told when the log was uploaded; instead of a token.")
    ] = None,
) -> None:
    """Delete a log for good: its bytes, its analyses and their results."""
    parts.catalog.delete_log(log_id, _deleter(request, parts, log_id, delete_token))


def _deleter(request: Request, parts: Parts, log_id: LogId, delete_token: str | None) -> str:
    """Return the owner whose log may be deleted: the one who asks, or the one whose delete token was sent."""
    if delete_token is not None and bearer(request) is None:
        return parts.catalog.may_delete_log(log_id, delete_token)
    return owner_of(request, parts)
