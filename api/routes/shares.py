"""Links that let whoever has them read one analysis, without a token."""

import re
from datetime import datetime
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Any
from urllib.parse import quote

from fastapi import APIRouter, Query, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from api import problems
from api.problems import ProblemError
from api.store.resources import Analysis, SharedAnalysis, SharedLog
from api.web.dependencies import FileName, OwnAnalysis, Parts, PartsOf, Secret
from api.web.results import answer, file_of
from api.work.outcome import FILE

router = APIRouter(tags=["sharing"], responses=problems.RESPONSES)

#: Files in which a SHA-256 may stand, and what one looks like.
_TEXT = frozenset({".html", ".json", ".md", ".csv"})
_DIGEST = re.compile(rb"\b[0-9a-f]{64}\b")


class Share(BaseModel):
    """A link to one analysis."""

    url: str = Field(description="Address of the report for people.", examples=["/shared/SECRET"])
    api: str = Field(description="Address of the analysis for programs.", examples=["/api/v1/shared/SECRET"])
    expires: datetime | None = Field(examples=["2026-04-13T09:26:53Z"])


@router.post(
    "/analyses/{analysis_id}/shares",
    status_code=HTTPStatus.CREATED,
    summary="Make a link that lets others read an analysis",
)
def share_analysis(
    analysis: OwnAnalysis,
    parts: PartsOf,
    days: Annotated[float | None, Query(gt=0, le=3650, description="Days until the link expires.")] = None,
) -> Share:
    """Make a link; whoever has it can read the report and its files, and nothing else."""
    secret, expires = parts.shares.create(analysis.id, days)
    return Share(url=f"/shared/{secret}", api=f"/api/v1/shared/{secret}", expires=expires)


@router.delete(
    "/analyses/{analysis_id}/shares",
    status_code=HTTPStatus.NO_CONTENT,
    summary="Make all links to an analysis worthless",
)
def unshare_analysis(analysis: OwnAnalysis, parts: PartsOf) -> None:
    """Withdraw all links to an analysis."""
    parts.shares.revoke_all(analysis.id)


@router.get("/shared/{secret}", summary="The analysis that a link is to")
def show_shared(secret: Secret, parts: PartsOf) -> SharedAnalysis:
    """Show a shared analysis."""
    analysis = answer(find_shared(secret, parts), parts)
    here = f"/api/v1/shared/{secret}"
    files = shared_files(analysis)
    links = {"self": here, "page": f"/shared/{secret}"} | {name: f"{here}/{quote(name)}" for name in files}
    shown = {name: value for name, value in dict(analysis).items() if name in SharedAnalysis.model_fields}
    logs = [SharedLog(name=log.name, size=log.size) for log in analysis.logs]
    shown |= {"logs": logs, "links": links, "files": files, "report": _without_hashes(analysis.report)}
    shown["configuration"] = {name: value for name, value in analysis.configuration.items() if name != "flights"}
    return SharedAnalysis(**shown)


def _without_hashes(value: Any) -> Any:
    """Return JSON without the digests of logs in it."""
    if isinstance(value, dict):
        return {name: _without_hashes(part) for name, part in value.items() if name != "sha256"}
    return [_without_hashes(part) for part in value] if isinstance(value, list) else value


@router.get("/shared/{secret}/{name:path}", response_class=FileResponse, summary="A file of a shared analysis")
def fetch_shared(secret: Secret, name: FileName, parts: PartsOf) -> Response:
    """Fetch a file of a shared analysis."""
    analysis = find_shared(secret, parts)
    response = file_of(analysis, name, parts) if name in shared_files(analysis) else None
    if response is None:
        raise ProblemError.missing(f"This analysis has no {name}.")
    if Path(name).suffix not in _TEXT:
        return response
    # A report names the content of its log, by which it could be told among others.
    content = _DIGEST.sub(b"withheld", Path(response.path).read_bytes())
    headers = {key: value for key, value in response.headers.items() if key in ("content-security-policy",)}
    return Response(content, media_type=response.media_type, headers=headers)


def shared_files(analysis: Analysis) -> dict[str, int]:
    """List the files of an analysis that whoever has a link may read: not what the service keeps for craft."""
    return {name: size for name, size in analysis.files.items() if name != FILE and not name.startswith("experiments/")}


def find_shared(secret: str, parts: Parts) -> Analysis:
    """Look up what a link is to; ProblemError if it is to nothing."""
    analysis_id = parts.shares.analysis_of(secret)
    if analysis_id is None:
        raise ProblemError.missing("There is nothing behind this link; it may have expired or been taken back.")
    return parts.catalog.find_analysis(analysis_id, None)
