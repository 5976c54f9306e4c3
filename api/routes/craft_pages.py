"""The pages of craft, and what their buttons do; every form works without scripts."""

from datetime import UTC, datetime
from http import HTTPStatus
from typing import Annotated, Any

from fastapi import APIRouter, Form, Query, Request, Response
from fastapi.responses import HTMLResponse

from api.crafts.models import FILES, LeastTrust
from api.problems import Problem, ProblemError
from api.routes.crafts import show_model
from api.store.owned import missing
from api.store.records import CraftRecord
from api.web.dependencies import After, Owner, Parts, PartsOf
from api.web.middleware import REPORT_POLICY
from api.web.own_pages import from_our_forms
from api.web.page_templates import lead_to, part_of, render

router = APIRouter(include_in_schema=False)
forms = APIRouter(include_in_schema=False, dependencies=from_our_forms)

#: Craft on one page of the list, flights that stand unfolded, and craft that flights can be moved to.
_PAGE, _UNFOLDED, _CHOICES = 25, 30, 200

#: Answers of a flight that its line shows.
_PURPOSES = ("Happened", "Loops", "Predict ahead")


@router.api_route("/crafts", methods=["GET", "HEAD"])
def list_crafts_page(
    request: Request, parts: PartsOf, owner: Owner, after: After = None, q: Annotated[str, Query(max_length=200)] = ""
) -> Response:
    """Show a part of the list of craft, and the newest alerts."""
    crafts = parts.crafts.list(owner, limit=_PAGE + 1, after=after, text=q.strip())
    shown, older = part_of(crafts, _PAGE, q=q.strip())
    alerts = parts.crafts.alerts(owner, limit=5) if after is None and not q else []
    view = {"crafts": shown, "older": older, "after": after, "q": q.strip(), "alerts": alerts}
    return render(request, "crafts.html", view)


@router.api_route("/crafts/{craft_id}", methods=["GET", "HEAD"])
def show_craft_page(request: Request, craft_id: str, parts: PartsOf, owner: Owner) -> Response:
    """Show a craft: its state, what changed, its flights, notes and models."""
    craft = parts.crafts.find(craft_id, owner)
    flights = parts.crafts.flights(craft_id, owner)
    others = [other for other in parts.crafts.list(owner, limit=_CHOICES) if other.id != craft.id]
    view: dict[str, Any] = {
        "craft": craft,
        "flights": flights,
        "unfolded": _UNFOLDED,
        "purposes": _PURPOSES,
        "others": others,
        "model": _model(parts, craft_id, owner),
        "kinds": FILES,
        "now": datetime.now(UTC).strftime("%Y-%m-%d"),
    }
    return render(request, "craft.html", view)


def _model(parts: Parts, craft_id: str, owner: str) -> dict[str, Any]:
    """Gather the latest models as far as they may be used, or say why there are none."""
    refused = ""
    for least in LeastTrust:
        try:
            return {"found": show_model(craft_id, parts, owner, least), "least": least, "refused": refused}
        except ProblemError as error:
            refused = refused or error.problem.detail
    return {"found": None, "least": None, "refused": refused}


@router.get("/crafts/{craft_id}/report")
def craft_report(craft_id: str, parts: PartsOf, owner: Owner) -> Response:
    """Draw a craft over its flights: the page in the frame of `show_craft_page`."""
    craft = parts.crafts.find(craft_id, owner)
    if craft.review is None:
        raise ProblemError.missing("This craft has not been looked at yet.")
    notes = [{"at": note.at.isoformat(), "text": note.text, "boundary": note.boundary} for note in craft.notes]
    page = parts.desk.ask("craft_page", craft.review, craft.name, notes)
    return HTMLResponse(page, headers={"Content-Security-Policy": REPORT_POLICY})


@router.api_route("/folder/{flight_id}", methods=["GET", "HEAD"])
def show_folder_flight(flight_id: str, parts: PartsOf, owner: Owner) -> Response:
    """Show the page of a flight that is of a folder and of no upload."""
    place = parts.crafts.folder_of(flight_id, owner)
    page = None if place is None else parts.folder.page(place)
    if page is None:
        raise missing(CraftRecord)
    return HTMLResponse(page, headers={"Content-Security-Policy": REPORT_POLICY})


@forms.post("/crafts/{craft_id}/name")
def name_craft(
    craft_id: str, parts: PartsOf, owner: Owner, name: Annotated[str, Form(max_length=100)] = ""
) -> Response:
    """Name a craft."""
    parts.crafts.rename(craft_id, owner, name)
    return lead_to(f"/crafts/{craft_id}")


@forms.post("/crafts/{craft_id}/notes")
def add_note(
    craft_id: str,
    parts: PartsOf,
    owner: Owner,
    text: Annotated[str, Form(min_length=1, max_length=500)],
    day: Annotated[str, Form(max_length=40)] = "",
    boundary: Annotated[bool, Form()] = False,
) -> Response:
    """Write down what was done to a craft."""
    try:
        at = datetime.fromisoformat(day.strip()) if day.strip() else None
    except ValueError:
        detail = "Write the day as 2026-03-14, or with a time as 2026-03-14 09:30."
        raise ProblemError(Problem.of_status(HTTPStatus.UNPROCESSABLE_ENTITY, detail)) from None
    parts.crafts.add_note(craft_id, owner, text, at, boundary=boundary)
    return lead_to(f"/crafts/{craft_id}")


@forms.post("/crafts/{craft_id}/notes/{note_id}/delete")
def remove_note(craft_id: str, note_id: str, parts: PartsOf, owner: Owner) -> Response:
    """Remove a note."""
    parts.crafts.remove_note(craft_id, note_id, owner)
    return lead_to(f"/crafts/{craft_id}")


@forms.post("/crafts/{craft_id}/merge")
def merge(
    craft_id: str, parts: PartsOf, owner: Owner, other: Annotated[str, Form(alias="craft", max_length=64)] = ""
) -> Response:
    """Merge another craft into this one."""
    parts.crafts.merge(craft_id, other, owner)
    return lead_to(f"/crafts/{craft_id}")


@forms.post("/crafts/{craft_id}/move")
def move(
    craft_id: str,
    parts: PartsOf,
    owner: Owner,
    flights: Annotated[list[str], Form(max_length=5000)],
    to: Annotated[str, Form(max_length=64)] = "",
    later: Annotated[bool, Form()] = False,
) -> Response:
    """Move flights to another craft, or to a new one."""
    parts.crafts.find(craft_id, owner)
    return lead_to(f"/crafts/{parts.crafts.move(flights, to or None, owner, later=later)}")
