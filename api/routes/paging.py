"""Lists in parts: so many items, and the address of the next ones."""

from typing import Annotated, TypeVar

from fastapi import Query, Request

from api.crafts.resources import Craft, RaisedAlert
from api.store.resources import Analysis, Log, Page

Limit = Annotated[int, Query(ge=1, le=500, description="Items at most.")]
After = Annotated[str | None, Query(max_length=64, description="Id of the last item of the part before.")]

Item = TypeVar("Item", bound=Log | Analysis | Craft | RaisedAlert)


def page(request: Request, items: list[Item], limit: int) -> Page[Item]:
    """Make a part of a list of its items and, if there are more, the first of the next part."""
    shown = items[:limit]
    following = str(request.url.include_query_params(after=shown[-1].id)) if len(items) > limit else None
    return Page(items=shown, next=following)
