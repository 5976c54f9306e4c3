"""Craft: listed, named, merged and split; their flights, notes and latest models."""

from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from api import problems
from api.crafts.models import FILES, LeastTrust, latest
from api.problems import ProblemError
from api.store.owned import missing
from api.store.records import CraftRecord
from api.store.resources import CraftAnswer, CraftChange, CraftFlight, CraftSummary, Merge, Move, NewNote, Note, Page
from api.web.dependencies import After, CraftId, FileName, Limit, NoteId, Owner, PartsOf, page
from api.web.results import file_response, local_copy

router = APIRouter(prefix="/crafts", tags=["craft"], responses=problems.RESPONSES)

Trusted = Annotated[LeastTrust, Query(description="How far a model must be trusted to be answered.")]


class CraftModel(BaseModel):
    """The latest models of a craft that may be trusted."""

    analysis: str = Field(description="Id of the analysis that made them.")
    trust: str = Field(description="The most that is said of one of them: yes or limited.", examples=["yes"])
    joint: bool = Field(description="Whether they were fitted to several flights at once.")
    flights: list[str] = Field(description="Names of the flights that they were fitted to and judged on.")
    files: dict[str, str] = Field(description="Address of each file by its name; addresses stay, files change.")


@router.get("", summary="Craft, those that changed last first")
def list_crafts(
    request: Request,
    parts: PartsOf,
    owner: Owner,
    limit: Limit = 50,
    after: After = None,
    q: Annotated[str, Query(max_length=200, description="Part of the name or kind.")] = "",
) -> Page[CraftSummary]:
    """List your craft."""
    return page(request, parts.crafts.list(owner, limit=limit + 1, after=after, text=q), limit)


@router.get("/{craft_id}", summary="A craft with what its flights say together")
def show_craft(craft_id: CraftId, parts: PartsOf, owner: Owner) -> CraftAnswer:
    """Show a craft: drift and change points of every parameter and motor, notes, alerts, and its joint models."""
    return parts.crafts.find(craft_id, owner)


@router.put("/{craft_id}", summary="Name a craft")
def name_craft(craft_id: CraftId, change: CraftChange, parts: PartsOf, owner: Owner) -> CraftAnswer:
    """Call a craft by a name."""
    parts.crafts.rename(craft_id, owner, change.name)
    return show_craft(craft_id, parts, owner)


@router.get("/{craft_id}/flights", summary="The flights of a craft, the newest first")
def list_flights(craft_id: CraftId, parts: PartsOf, owner: Owner) -> list[CraftFlight]:
    """List the flights of a craft, each with the answers of its first screen."""
    return list(parts.crafts.flights(craft_id, owner))


@router.post("/{craft_id}/merge", summary="Let another craft be part of this one")
def merge_crafts(craft_id: CraftId, merge: Merge, parts: PartsOf, owner: Owner) -> CraftAnswer:
    """Bring the flights, notes and alerts of another craft over; flights that look like its come here from now on."""
    parts.crafts.merge(craft_id, merge.craft, owner)
    return show_craft(craft_id, parts, owner)


@router.post("/flights/move", summary="Move flights to another craft")
def move_flights(move: Move, parts: PartsOf, owner: Owner) -> CraftAnswer:
    """Move flights to another craft or to a new one, which splits theirs."""
    return show_craft(parts.crafts.move(move.flights, move.to, owner, later=move.later), parts, owner)


@router.post("/{craft_id}/notes", status_code=HTTPStatus.CREATED, summary="Write down what was done to a craft")
def add_note(craft_id: CraftId, note: NewNote, parts: PartsOf, owner: Owner) -> Note:
    """Note maintenance; with `boundary`, flights before it are not pooled with those after it."""
    return parts.crafts.add_note(craft_id, owner, note.text, note.at, boundary=note.boundary)


@router.delete("/{craft_id}/notes/{note_id}", status_code=HTTPStatus.NO_CONTENT, summary="Remove a note")
def remove_note(craft_id: CraftId, note_id: NoteId, parts: PartsOf, owner: Owner) -> None:
    """Remove a note for good."""
    parts.crafts.remove_note(craft_id, note_id, owner)


@router.get("/{craft_id}/model", summary="The latest trusted models of a craft")
def show_model(craft_id: CraftId, parts: PartsOf, owner: Owner, trust: Trusted = LeastTrust.YES) -> CraftModel:
    """Report which analysis made the latest models that may be trusted; 404 where there are none."""
    show_craft(craft_id, parts, owner)
    model = latest(parts.database, craft_id, trust)
    here = f"/api/v1/crafts/{craft_id}/model"
    ending = "" if trust is LeastTrust.YES else f"?trust={trust}"
    files = {name: f"{here}/{name}{ending}" for name in FILES if name in model.files}
    return CraftModel(
        analysis=model.analysis, trust=model.trust, joint=model.joint, flights=list(model.flights), files=files
    )


@router.get("/{craft_id}/model/{name}", response_class=FileResponse, summary="A file of the latest trusted models")
def fetch_model(
    craft_id: CraftId, name: FileName, parts: PartsOf, owner: Owner, trust: Trusted = LeastTrust.YES
) -> Response:
    """Fetch `models.json`, `models.mat`, `craft.json`, `sitl_frame.json`, `parameters.csv` or `proposed.param`.

    The address stays the same; the header `Rotorid-Analysis` names the analysis that made what it answers.
    """
    show_craft(craft_id, parts, owner)
    if name not in FILES:
        raise ProblemError.missing(f"There is {', '.join(FILES)}.")
    model = latest(parts.database, craft_id, trust, name)
    path = local_copy(f"{model.results}/{name}", parts)
    if path is None:
        raise missing(CraftRecord)
    response = file_response(path, name)
    response.headers["Rotorid-Analysis"] = model.analysis
    return response
