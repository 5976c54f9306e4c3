"""The pages for people: drop logs, follow their analyses, read the reports; and a reference of the interface."""

import json
from functools import cache
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, Any, NamedTuple
from urllib.parse import urlencode

from fastapi import APIRouter, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.responses import HTMLResponse
from pydantic import ValidationError

from api.access import ReportKeys, bearer
from api.problems import Problem, ProblemError
from api.routes.analyses import check, in_words
from api.routes.shares import find_shared
from api.settings import Access
from api.store.resources import Analysis, AnalysisOrder, Configuration, State
from api.store.scratch import open_upload
from api.web.dependencies import After, OwnAnalysis, Owner, Parts, PartsOf
from api.web.middleware import PLOT_POLICY, REPORT_POLICY
from api.web.own_pages import from_our_forms
from api.web.page_templates import lead_to, part_of, render
from api.web.results import answer, downloads, file_of, flight_pages, tables
from api.web.uploads import receive_logs

router = APIRouter(include_in_schema=False)

#: Analyses on one page of the list, and on the first page.
_PAGE, _LATEST = 25, 5

_TEMPLATES = {State.DONE: "report.html", State.FAILED: "failed.html", State.CANCELLED: "cancelled.html"}

#: Analyses that a comparison is chosen from.
_CHOICES = 200

#: Settings that the first page asks for.
FIRST_SETTINGS = ("mass", "poles", "zeros")

StateFilter = Annotated[State | None, Query()]
Text = Annotated[str, Query(max_length=200)]


@router.api_route("/", methods=["GET", "HEAD"])
def home(request: Request, parts: PartsOf, owner: Owner) -> Response:
    """Show where to drop logs, and what was analysed last."""
    view = _listed(parts, owner, _LATEST)
    view |= {"limit": parts.settings.upload_limit, "samples": samples().values()}
    return render(request, "home.html", view)


@router.post("/", dependencies=from_our_forms)
async def upload_form(request: Request, parts: PartsOf, owner: Owner) -> Response:
    """Accept the form of a browser that runs no scripts, and lead it to the analysis."""
    fields: dict[str, str] = {}
    kept = await receive_logs(request, parts, owner, fields)
    chosen = {name: fields[name].strip() for name in FIRST_SETTINGS if fields.get(name, "").strip()}
    try:
        order = AnalysisOrder(
            logs=[received.log.id for received in kept], configuration=Configuration.model_validate(chosen)
        )
        await run_in_threadpool(check, order)
    except (ValidationError, ProblemError) as error:
        detail = f"{in_words(error)}. The logs were kept: find them under Logs."
        raise ProblemError(Problem.of_status(HTTPStatus.UNPROCESSABLE_ENTITY, detail)) from error
    analysis = await run_in_threadpool(parts.order, order.ids, order.configuration.chosen(), owner)
    return lead_to(f"/analyses/{analysis.id}")


@router.post("/samples", dependencies=from_our_forms)
async def open_sample(request: Request, parts: PartsOf, owner: Owner) -> Response:
    """Analyse a sample log as if it had been uploaded."""
    form = await request.form(max_files=0, max_fields=5)
    sample = samples().get(str(form.get("name", "")))
    if sample is None:
        raise ProblemError.missing("There is no sample log of this name.")
    parts.rates.count_upload(request, owner)

    def keep() -> Analysis:
        parts.catalog.check_room(owner)
        with open_upload(parts.scratch.folder) as upload:
            upload.write(sample.path.read_bytes())
            (kept,) = parts.catalog.keep_logs([(upload, sample.path.name)], owner)
        return parts.order([kept.log.id], {}, owner)

    analysis = await run_in_threadpool(keep)
    return lead_to(f"/analyses/{analysis.id}")


@router.api_route("/analyses", methods=["GET", "HEAD"])
def list_analyses_page(
    request: Request, parts: PartsOf, owner: Owner, state: StateFilter = None, after: After = None, q: Text = ""
) -> Response:
    """Show a part of the list of analyses."""
    view = _listed(parts, owner, _PAGE, state, after, q.strip())
    view |= {"states": list(State), "chosen": state, "after": after, "q": q.strip()}
    return render(request, "analyses.html", view)


@router.api_route("/logs", methods=["GET", "HEAD"])
def list_logs_page(request: Request, parts: PartsOf, owner: Owner, after: After = None, q: Text = "") -> Response:
    """Show a part of the list of logs."""
    logs = parts.catalog.list_logs(owner, limit=_PAGE + 1, after=after, name=q.strip())
    shown, older = part_of(logs, _PAGE, q=q.strip())
    return render(request, "logs.html", {"logs": shown, "older": older, "after": after, "q": q.strip()})


@router.get("/compare")
def compare_page(request: Request, parts: PartsOf, owner: Owner, a: str = "", b: str = "") -> Response:
    """Show two analyses against each other, or ask which."""
    done = parts.catalog.list_analyses(owner, limit=_CHOICES, state=State.DONE)
    view: dict[str, Any] = {"done": done, "a": a, "b": b, "frame": ""}
    if a and b:
        view["frame"] = f"/compare/report?{urlencode({'a': a, 'b': b})}"
    return render(request, "compare.html", view)


@router.get("/compare/report")
def compared(parts: PartsOf, owner: Owner, a: str, b: str) -> Response:
    """Compare two analyses: the page in the frame of `compare_page`."""
    analyses = [parts.catalog.find_analysis(analysis_id, owner) for analysis_id in (a, b)]
    reports = [answer(analysis, parts).report for analysis in analyses]
    if None in reports:
        raise ProblemError.missing("Only analyses that are done can be compared.")
    names = tuple(f"{analysis.title} ({analysis.created:%Y-%m-%d %H:%M})" for analysis in analyses)
    page = parts.desk.ask("compare", *reports, names)
    return HTMLResponse(page, headers={"Content-Security-Policy": REPORT_POLICY})


def _listed(
    parts: Parts, owner: str, count: int, state: State | None = None, after: str | None = None, text: str = ""
) -> dict[str, Any]:
    """Gather what the list of analyses shows: analyses, whether they change by themselves, and what comes after."""
    analyses = parts.catalog.list_analyses(owner, limit=count + 1, state=state, after=after, text=text)
    shown, older = part_of(analyses, count, state=state, q=text)
    return {"analyses": shown, "live": any(not analysis.state.ended for analysis in shown), "older": older}


@router.api_route("/analyses/{analysis_id}", methods=["GET", "HEAD"])
def show_analysis_page(request: Request, analysis: OwnAnalysis, parts: PartsOf) -> Response:
    """Show how far an analysis is, or its report, or why there is none."""
    address = frame = f"/api/v1/analyses/{analysis.id}"
    secret = bearer(request)
    if parts.settings.access is Access.TOKENS and secret is not None:
        frame = f"/reports/{ReportKeys(parts.database).make(secret, analysis.id)}"
    view = _shown(analysis, address, frame) | {"crafts": parts.crafts.of_analysis(analysis.id)}
    return render(request, _TEMPLATES.get(analysis.state, "progress.html"), view)


@router.api_route("/reports/{key}/{name:path}", methods=["GET", "HEAD"])
def fetch_framed(key: str, name: str, parts: PartsOf) -> Response:
    """Fetch a report into the frame of a signed-in visitor's page, or what that report links to."""
    analysis_id = ReportKeys(parts.database).analysis_of(key)
    response = None if analysis_id is None else file_of(parts.catalog.find_analysis(analysis_id, None), name, parts)
    if response is None:
        detail = "There is nothing here any more. Open the analysis again from the list."
        raise ProblemError.missing(detail)
    return response


@router.api_route("/shared/{secret}", methods=["GET", "HEAD"])
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
        "downloads": downloads(analysis),
        "tables": tables(analysis),
        "flights": flight_pages(analysis),
    }


@router.api_route("/docs", methods=["GET", "HEAD"])
def reference(request: Request, parts: PartsOf) -> Response:
    """Describe the interface for programs: Swagger UI draws it from the OpenAPI document."""
    view = {"tokens": parts.settings.access is Access.TOKENS, "limit": parts.settings.upload_limit}
    return render(request, "docs.html", view, headers={"Content-Security-Policy": PLOT_POLICY})


_FOLDER = Path(__file__).parents[2] / "sample_logs"


class Sample(NamedTuple):
    """A log that can be opened as if it had been uploaded."""

    name: str
    what: str
    path: Path


@cache
def samples(folder: Path = _FOLDER) -> dict[str, Sample]:
    """List the sample logs by name; none where rotorid was installed without them."""
    return {path.stem: Sample(path.stem, _what(path), path) for path in sorted(folder.glob("*.bin"))}


def _what(path: Path) -> str:
    """Read from the truth beside a log what was flown."""
    try:
        what = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))["what"]
    except (OSError, ValueError, KeyError):
        return ""
    return str(what).rpartition("simulated by rotorid, not flown: ")[2]
