"""What the routes are given: the parts of the application, and who asks."""

import pathlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

from fastapi import Depends, Path, Query, Request
from fastapi.concurrency import run_in_threadpool
from fastapi.dependencies.models import Dependant
from fastapi.exceptions import RequestValidationError

from api.access import EVERYBODY, Rates, Shares, Tokens, bearer, unauthorized
from api.crafts.folder_flights import FolderFlights
from api.crafts.hooks import Feeds, Hooks
from api.crafts.registry import Crafts
from api.crafts.reviews import Reviews
from api.logs.catalog import Catalog
from api.logs.housekeeping import Housekeeping
from api.logs.metrics import Metrics
from api.settings import Access, Settings
from api.store.database import Database
from api.store.resources import Analysis, CraftSummary, Log, Page, RaisedAlert
from api.store.scratch import Scratch
from api.work.desk import Desk
from api.work.jobs import Runner
from pipeline.storage.store import Store


@dataclass(frozen=True, slots=True)
class Parts:
    """The parts of the application."""

    settings: Settings
    database: Database
    objects: Store
    catalog: Catalog
    scratch: Scratch
    runner: Runner
    desk: Desk
    recognise: Callable[[pathlib.Path, str], None] | None  #: Refuses an upload, with its name, that is no log.
    tokens: Tokens
    shares: Shares
    rates: Rates
    metrics: Metrics
    housekeeping: Housekeeping
    crafts: Crafts
    reviews: Reviews
    hooks: Hooks
    feeds: Feeds
    folder: FolderFlights

    def order(self, log_ids: Sequence[str], configuration: Mapping[str, Any], owner: str) -> Analysis:
        """Order an analysis, and let who works here know; KeyError names a log that the owner has not."""
        ordered = self.catalog.order(log_ids, configuration, owner)
        self.runner.wake()
        return ordered


async def _parts(request: Request) -> Parts:
    parts: Parts = request.app.state.parts
    return parts


PartsOf = Annotated[Parts, Depends(_parts)]


def owner_of(request: Request, parts: Parts) -> str:
    """Report whose things the request is about; ProblemError if it has no valid token where one is needed."""
    if parts.settings.access is not Access.TOKENS:
        return EVERYBODY
    secret = bearer(request)
    owner = None if secret is None else parts.tokens.owner_of(secret)
    if owner is None:
        if secret is not None:
            parts.rates.count_wrong_bearer(request)
        raise unauthorized()
    return owner


async def _owner(request: Request, parts: PartsOf) -> str:
    """Report whose things the request is about, without a thread where nobody has to be looked up."""
    if parts.settings.access is not Access.TOKENS:
        return EVERYBODY
    return await run_in_threadpool(owner_of, request, parts)


Owner = Annotated[str, Depends(_owner)]


def _settings_of(dependant: Dependant) -> set[str]:
    """Return the names that a route and what it depends on read from the query."""
    return {query_param.alias for query_param in dependant.query_params}.union(
        *map(_settings_of, dependant.dependencies)
    )


async def _refuse_unknown(request: Request) -> None:
    """Refuse settings that the route does not know, and a body where it reads none.

    Who writes `day` for `days`, or sends settings in a body where they belong into the query, would else believe that
    a link expires.
    """
    route = request.scope["route"]
    known = _settings_of(route.dependant)
    why = f"is not known here; known are: {', '.join(sorted(known)) or 'none'}"
    wrong = [("query", name, why) for name in request.query_params if name not in known]
    reads = route.body_field is not None or route.openapi_extra
    if not reads and request.headers.get("content-length", "0") != "0":
        wrong.append(("body", "", "nothing is read from a body here; settings stand in the query"))
    if wrong:
        raise RequestValidationError([{"loc": (place, name), "msg": why} for place, name, why in wrong])


#: For routes of the interface for programs.
nothing_unknown = Depends(_refuse_unknown)


LogId = Annotated[str, Path(description="Id of a log.")]
AnalysisId = Annotated[str, Path(description="Id of an analysis.")]
CraftId = Annotated[str, Path(description="Id of a craft.")]
NoteId = Annotated[str, Path(description="Id of a note.")]
HookId = Annotated[str, Path(description="Id of a webhook.")]
Secret = Annotated[str, Path(description="The last part of a shared link.")]


def _analysis(analysis_id: AnalysisId, parts: PartsOf, owner: Owner) -> Analysis:
    """Look an analysis up; ProblemError if whoever asks has none of this id."""
    return parts.catalog.find_analysis(analysis_id, owner)


def _log(log_id: LogId, parts: PartsOf, owner: Owner) -> Log:
    """Look a log up, likewise."""
    return parts.catalog.find_log(log_id, owner)


#: What a route is about, of whoever asks.
OwnAnalysis = Annotated[Analysis, Depends(_analysis)]
OwnLog = Annotated[Log, Depends(_log)]

FileName = Annotated[str, Path(description="A name in `files` of the analysis.")]

Limit = Annotated[int, Query(ge=1, le=500, description="Items at most.")]
After = Annotated[str | None, Query(max_length=64, description="Id of the last item of the part before.")]

Item = TypeVar("Item", bound=Log | Analysis | CraftSummary | RaisedAlert)


def page(request: Request, items: list[Item], limit: int) -> Page[Item]:
    """Make a part of a list of its items and, if there are more, the first of the next part."""
    shown = items[:limit]
    following = str(request.url.include_query_params(after=shown[-1].id)) if len(items) > limit else None
    return Page(items=shown, next=following)
