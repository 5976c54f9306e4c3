"""The pages for people: drop a log, follow its analysis, read its report; and a reference of the interface."""

from http import HTTPStatus

from fastapi import APIRouter, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import RedirectResponse

from api.dependencies import Owner, PartsOf, from_our_pages
from api.page_templates import render
from api.resources import State
from api.results import links_of
from api.routes.analyses import find_analysis
from api.routes.logs import take_upload

router = APIRouter(include_in_schema=False)


@router.head("/")
@router.get("/")
def home(request: Request, parts: PartsOf) -> Response:
    """Show where to drop a log."""
    return render(request, "home.html", {"limit": parts.settings.upload_limit})


@router.post("/", dependencies=[from_our_pages])
async def upload_form(request: Request, parts: PartsOf, owner: Owner) -> Response:
    """Take the form of a browser that runs no scripts, and lead it to the analysis."""
    kept = await take_upload(request, parts, owner)
    analysis = await run_in_threadpool(parts.catalog.order, [each.log.id for each in kept], {}, owner)
    parts.runner.wake()
    return RedirectResponse(f"/analyses/{analysis.id}", HTTPStatus.SEE_OTHER)


@router.head("/analyses/{analysis_id}")
@router.get("/analyses/{analysis_id}")
def show_analysis_page(request: Request, analysis_id: str, parts: PartsOf, owner: Owner) -> Response:
    """Show how far an analysis is, or its report, or why there is none."""
    analysis = find_analysis(analysis_id, parts.catalog, owner)
    template = {State.DONE: "report.html", State.FAILED: "failed.html", State.CANCELLED: "failed.html"}.get(
        analysis.state, "progress.html"
    )
    return render(request, template, {"analysis": analysis, "links": links_of(analysis)})


@router.head("/docs")
@router.get("/docs")
def reference(request: Request) -> Response:
    """Describe the interface for programs, from its own OpenAPI document."""
    return render(request, "docs.html", {"document": request.app.openapi()})
