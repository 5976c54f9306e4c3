"""Alerts about craft: as a list, as a feed, and sent to webhooks."""

from datetime import datetime
from http import HTTPStatus
from typing import Annotated

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, Field

from api import problems
from api.problems import ProblemError
from api.store.resources import Given, Page, RaisedAlert
from api.web.dependencies import After, HookId, Limit, Owner, PartsOf, page
from api.web.page_templates import render

router = APIRouter(tags=["alerts"], responses=problems.RESPONSES)

#: Alerts that a feed holds.
_IN_FEED = 50


class NewHook(Given):
    """Where to send alerts."""

    url: Annotated[str, Field(min_length=1, max_length=500, examples=["https://ops.example.org/rotorid"])]


class Hook(BaseModel):
    """A webhook."""

    id: str = Field(examples=["3a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"])
    url: str = Field(examples=["https://ops.example.org/rotorid"])
    created: datetime
    state: str = Field(description="What became of the last delivery.", examples=["2026-05-02 14:03 UTC: delivered"])


class MadeHook(Hook):
    """A webhook just made."""

    secret: str = Field(
        description="Told once. `Rotorid-Signature: sha256=...` is the HMAC-SHA256 of the body under it.",
        examples=["bT3nJ0cO0WjS5mJX1m3Zt0pB8xq2w4u6y8A0C2E4G6I"],
    )


class Feed(BaseModel):
    """The address of a feed."""

    url: str = Field(description="Holds a secret: whoever has it reads the alerts.", examples=["/feeds/SECRET.atom"])


@router.get("/alerts", summary="Alerts, the newest first")
def list_alerts(
    request: Request, parts: PartsOf, owner: Owner, limit: Limit = 50, after: After = None
) -> Page[RaisedAlert]:
    """List what left its band, of all your craft."""
    return page(request, list(parts.crafts.alerts(owner, limit=limit + 1, after=after)), limit)


@router.post("/alerts/feed", status_code=HTTPStatus.CREATED, summary="Make the address of a feed of alerts")
def make_feed(parts: PartsOf, owner: Owner) -> Feed:
    """Make the address of an Atom feed that is read without a token; an earlier one is worthless from now on."""
    return Feed(url=f"/feeds/{parts.feeds.create(owner)}.atom")


@router.get("/hooks", summary="Webhooks")
def list_hooks(parts: PartsOf, owner: Owner) -> list[Hook]:
    """List where alerts are sent."""
    return [
        Hook(id=record.id, url=record.url, created=record.created, state=record.state)
        for record in parts.hooks.list(owner)
    ]


@router.post("/hooks", status_code=HTTPStatus.CREATED, summary="Send alerts to an address")
def make_hook(hook: NewHook, parts: PartsOf, owner: Owner) -> MadeHook:
    """Send each alert from now on to an https address of the public internet, as JSON by POST, signed."""
    made = parts.hooks.create(owner, hook.url)
    return MadeHook(id=made.id, url=made.url, created=made.created, state="", secret=made.secret)


@router.delete("/hooks/{hook_id}", status_code=HTTPStatus.NO_CONTENT, summary="Remove a webhook")
def remove_hook(hook_id: HookId, parts: PartsOf, owner: Owner) -> None:
    """Send alerts there no more."""
    if not parts.hooks.remove(owner, hook_id):
        raise ProblemError.missing("There is no webhook of this id.")


feeds = APIRouter(include_in_schema=False)


@feeds.get("/feeds/{secret}.atom")
def read_feed(request: Request, secret: str, parts: PartsOf) -> Response:
    """Return the alerts of the owner of a secret."""
    owner = parts.feeds.owner_of(secret)
    if owner is None:
        raise ProblemError.missing("There is no such feed, or it has another address.")
    alerts = parts.crafts.alerts(owner, limit=_IN_FEED)
    return render(request, "feed.xml", {"alerts": alerts}, headers={"Content-Type": "application/atom+xml"})
