"""The pages for people: drop logs, follow their analyses, read the reports; and a reference of the interface."""

from http import HTTPStatus
from importlib.resources import files
from typing import Annotated, Any

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import FileResponse, RedirectResponse

from api.access import bearer
from api.dependencies import Owner, Parts, PartsOf, from_our_pages
from api.page_templates import render
from api.problems import Problem, ProblemError
from api.reference import operations_by_kind
from api.report_keys import ReportKeys
from api.resources import Analysis, State
from api.result_files import downloads, flight_pages, tables
from api.results import file_of
from api.routes.analyses import find_analysis
from api.routes.logs import take_upload
from api.routes.paging import After
from api.routes.shares import find_shared
from api.samples import samples
from api.settings import Access
from api.uploads import check_room

router = APIRouter(include_in_schema=False)

#: Analyses on one page of the list, and on the first page.
_PAGE, _LATEST = 25, 5

_TEMPLATES = {State.DONE: "report.html", State.FAILED: "failed.html", State.CANCELLED: "cancelled.html"}

StateFilter = Annotated[State | None, Query()]


@router.head("/")
@router.get("/")
def home(request: Request, parts: PartsOf, owner: Owner) -> Response:
    """Show where to drop logs, and what was analysed last."""
    view = _listed(parts, owner, _LATEST)
    view |= {"limit": parts.settings.upload_limit, "samples": samples().values()}
    return render(request, "home.html", view)


@router.post("/", dependencies=[from_our_pages])
async def upload_form(request: Request, parts: PartsOf, owner: Owner) -> Response:
    """Accept the form of a browser that runs no scripts, and lead it to the analysis."""
    kept = await take_upload(request, parts, owner)
    analysis = await run_in_threadpool(parts.catalog.order, [each.log.id for each in kept], {}, owner)
    parts.runner.wake()
    return RedirectResponse(f"/analyses/{analysis.id}", HTTPStatus.SEE_OTHER)


@router.post("/samples", dependencies=[from_our_pages])
async def open_sample(request: Request, parts: PartsOf, owner: Owner) -> Response:
    """Analyse a sample log as if it had been uploaded."""
    form = await request.form(max_files=0, max_fields=5)
    sample = samples().get(str(form.get("name", "")))
    if sample is None:
        raise ProblemError(Problem.of_status(HTTPStatus.NOT_FOUND, "There is no sample log of this name."))
    parts.rates.count_upload(request, owner)

    def keep() -> Analysis:
        check_room(parts.catalog, owner, parts.settings.logs_limit)
        with parts.incoming.receive() as upload:
            upload.write(sample.path.read_bytes())
            kept = parts.catalog.keep_log(upload, sample.path.name, owner)
        return parts.catalog.order([kept.log.id], {}, owner)

    analysis = await run_in_threadpool(keep)
    parts.runner.wake()
    return RedirectResponse(f"/analyses/{analysis.id}", HTTPStatus.SEE_OTHER)


@router.head("/analyses")
@router.get("/analyses")
def list_analyses_page(
    request: Request, parts: PartsOf, owner: Owner, state: StateFilter = None, after: After = None
) -> Response:
    """Show a part of the list of analyses."""
    view = _listed(parts, owner, _PAGE, state, after)
    return render(request, "analyses.html", view | {"states": list(State), "chosen": state, "after": after})


def _listed(
    parts: Parts, owner: str, count: int, state: State | None = None, after: str | None = None
) -> dict[str, Any]:
    """Gather what the list of analyses shows: analyses, whether they change by themselves, and what comes after."""
    found = parts.catalog.list_analyses(owner, limit=count + 1, state=state, after=after)
    shown = found[:count]
    return {
        "analyses": shown,
        "live": any(not analysis.state.ended for analysis in shown),
        "older": shown[-1].id if len(found) > count else None,
    }


@router.head("/analyses/{analysis_id}")
@router.get("/analyses/{analysis_id}")
def show_analysis_page(request: Request, analysis_id: str, parts: PartsOf, owner: Owner) -> Response:
    """Show how far an analysis is, or its report, or why there is none."""
    analysis = find_analysis(analysis_id, parts.catalog, owner)
    address = frame = f"/api/v1/analyses/{analysis.id}"
    secret = bearer(request)
    if parts.settings.access is Access.TOKENS and secret is not None:
        frame = f"/reports/{ReportKeys(parts.database).make(secret, analysis.id)}"
    return render(request, _TEMPLATES.get(analysis.state, "progress.html"), _shown(analysis, address, frame))


@router.head("/reports/{key}/{name:path}")
@router.get("/reports/{key}/{name:path}")
def fetch_framed(key: str, name: str, parts: PartsOf) -> Response:
    """Fetch a report into the frame of a signed-in visitor's page, or what that report links to."""
    analysis_id = ReportKeys(parts.database).analysis_of(key)
    analysis = None if analysis_id is None else parts.catalog.find_analysis(analysis_id, None)
    response = None if analysis is None else file_of(analysis, name, parts)
    if response is None:
        detail = "There is nothing here any more. Open the analysis again from the list."
        raise ProblemError(Problem.of_status(HTTPStatus.NOT_FOUND, detail))
    return response


@router.head("/shared/{secret}")
@router.get("/shared/{secret}")
def show_shared_page(request: Request, secret: str, parts: PartsOf) -> Response:
    """Show the analysis that a link is to, to be read only."""
    analysis = find_shared(secret, parts)
    template = "shared.html" if analysis.state is State.DONE else "shared_unfinished.html"
    address = f"/api/v1/shared/{secret}"
    return render(request, template, _shown(analysis, address, address))


def _shown(analysis: Analysis, address: str, frame: str) -> dict[str, Any]:
    """Gather what the page of an analysis shows: its resource at `address`, its report below the address `frame`."""
    return {
        "analysis": analysis,
        "address": address,
        "frame": frame,
        "downloads": downloads(analysis, address),
        "tables": tables(analysis, address),
        "flights": flight_pages(analysis, frame),
    }


@router.get("/static/htmx.min.js")
def htmx() -> Response:
    """Return htmx out of the wheel that brings it."""
    return FileResponse(str(files("js_lib_htmx") / "static" / "htmx" / "htmx.min.js"), media_type="text/javascript")


@router.head("/docs")
@router.get("/docs")
def reference(request: Request, parts: PartsOf) -> Response:
    """Describe the interface for programs, from its own OpenAPI document."""
    tokens = parts.settings.access is Access.TOKENS
    kinds = operations_by_kind(request.app.openapi(), str(request.base_url).rstrip("/"), tokens=tokens)
    view = {"kinds": kinds, "tokens": tokens, "limit": parts.settings.upload_limit}
    return render(request, "docs.html", view)
