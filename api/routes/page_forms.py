"""What the pages' buttons do. Each is a form that works without scripts; htmx only spares loading whole pages."""

import glob
from dataclasses import dataclass
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Form, Request, Response
from fastapi.concurrency import run_in_threadpool
from pydantic import ValidationError

from api.problems import ProblemError
from api.routes.analyses import check, in_words
from api.store.resources import Analysis, AnalysisOrder, Configuration
from api.web.dependencies import OwnAnalysis, Owner, OwnLog, Parts, PartsOf
from api.web.own_pages import from_our_forms
from api.web.page_templates import lead_to, render
from api.web.results import answer
from core.serialization import restored

router = APIRouter(include_in_schema=False, dependencies=from_our_forms)

Next = Annotated[str, Form(max_length=2000)]


@router.post("/analyses/{analysis_id}/cancel")
def cancel(
    analysis_id: str, parts: PartsOf, owner: Owner, following: Annotated[str, Form(alias="next")] = ""
) -> Response:
    """Cancel an analysis."""
    parts.catalog.cancel(analysis_id, owner)
    return lead_to(following or f"/analyses/{analysis_id}")


@router.post("/analyses/{analysis_id}/delete")
def delete(
    analysis: OwnAnalysis,
    parts: PartsOf,
    owner: Owner,
    following: Annotated[str, Form(alias="next")] = "/analyses",
    logs: Annotated[bool, Form()] = False,
) -> Response:
    """Delete an analysis and, if `logs` says so, its logs with all other analyses of them."""
    parts.catalog.delete_analysis(analysis.id, owner)
    for log in analysis.logs if logs else []:
        parts.catalog.delete_log(log.id, owner)
    return lead_to(following)


@router.post("/logs/{log_id}/delete")
def delete_log(
    log_id: str, parts: PartsOf, owner: Owner, following: Annotated[str, Form(alias="next")] = "/logs"
) -> Response:
    """Delete a log with all analyses of it."""
    parts.catalog.delete_log(log_id, owner)
    return lead_to(following)


@router.post("/logs/{log_id}/analyse")
def analyse_log(log: OwnLog, parts: PartsOf, owner: Owner) -> Response:
    """Analyse a log that is here already."""
    ordered = parts.order([log.id], {}, owner)
    return lead_to(f"/analyses/{ordered.id}")


@router.post("/analyses/{analysis_id}/share")
def share(request: Request, analysis: OwnAnalysis, parts: PartsOf, days: Annotated[str, Form()] = "30") -> Response:
    """Make a link that lets others read an analysis, and show it."""
    secret, expires = parts.shares.create(analysis.id, float(days) if days in ("7", "30", "365") else None)
    made = {"address": f"{request.base_url}shared/{secret}", "expires": expires}
    return render(request, "share.html", {"analysis": analysis, "made": made, "taken_back": False})


@router.post("/analyses/{analysis_id}/unshare")
def unshare(request: Request, analysis: OwnAnalysis, parts: PartsOf) -> Response:
    """Make all links to an analysis worthless."""
    parts.shares.revoke_all(analysis.id)
    return render(request, "share.html", {"analysis": analysis, "made": None, "taken_back": True})


@router.get("/analyses/{analysis_id}/again")
def ask_again(request: Request, analysis: OwnAnalysis, parts: PartsOf) -> Response:
    """Ask for the settings of another analysis of the same logs."""
    view = {"analysis": analysis, "values": analysis.configuration, "wrong": "", "flights": _flights(analysis, parts)}
    return render(request, "again.html", view)


@router.post("/analyses/{analysis_id}/again")
async def analyse_again(request: Request, analysis: OwnAnalysis, parts: PartsOf, owner: Owner) -> Response:
    """Analyse the same logs with other settings; a field left empty has its default."""
    form = await request.form(max_files=0, max_fields=20)
    names = set(Configuration.model_fields) - {"training"}
    values: dict[str, Any] = {
        name: text.strip() for name, text in form.items() if name in names and isinstance(text, str) and text.strip()
    }
    flights = await run_in_threadpool(_flights, analysis, parts)
    if flights:
        chosen = [name for name in form.getlist("training") if isinstance(name, str)]
        flights = dict.fromkeys(flights, False) | dict.fromkeys(chosen, True)
        values["training"] = [glob.escape(name) for name in chosen] or None
    elif "training" in analysis.configuration:
        values["training"] = analysis.configuration["training"]
    try:
        order = AnalysisOrder(logs=[log.id for log in analysis.logs], configuration=Configuration(**values))
        await run_in_threadpool(check, order)
    except (ValidationError, ProblemError) as error:
        view = {"analysis": analysis, "values": values, "wrong": in_words(error), "flights": flights}
        return render(request, "again.html", view, HTTPStatus.UNPROCESSABLE_ENTITY)
    ordered = await run_in_threadpool(parts.order, order.ids, order.configuration.chosen(), owner)
    return lead_to(f"/analyses/{ordered.id}")


def _flights(analysis: Analysis, parts: Parts) -> dict[str, bool]:
    """Report of every flight of a joint analysis whether it was fitted to; nothing where there is no joint model."""
    groups = restored(answer(analysis, parts).report or {}, _Report).groups
    return {name: True for group in groups for name in group.training} | {
        name: False for group in groups for name in group.held_out
    }


@dataclass(frozen=True, slots=True)
class _Joint:
    """Of a craft in report.json, what a form offers."""

    training: tuple[str, ...]
    held_out: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Report:
    """Of report.json, what a form offers."""

    groups: tuple[_Joint, ...] = ()
