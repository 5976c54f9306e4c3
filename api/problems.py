"""What went wrong in one shape: problem details (RFC 9457). `api.web.problem_responses` answers with them."""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from pydantic import BaseModel, Field

MEDIA_TYPE = "application/problem+json"


class InvalidInput(BaseModel):
    """One part of a request that is not as it should be."""

    where: str = Field(description="Place in the request.", examples=["query: analyze"])
    detail: str


class Problem(BaseModel):
    """Problem details, RFC 9457."""

    type: str = Field(default="about:blank", description="Stable name of the kind of problem.")
    title: str = Field(description="The kind of problem in a few words; the same for every occurrence.")
    status: int = Field(description="HTTP status code.")
    detail: str = Field(description="What is wrong this time and what to do, for the person who must act.")
    errors: list[InvalidInput] | None = Field(
        default=None, description="For requests of the wrong shape: what and where."
    )

    @classmethod
    def named(cls, name: str, title: str, status: HTTPStatus, detail: str) -> "Problem":
        """Make a problem of our own kind, whose type is a URN ending in `name`.

        Parameters
        ----------
        name : str
            End of the URN.
        title : str
            The kind of problem in a few words, the same each time.
        status : HTTPStatus
            Status of the answer.
        detail : str
            What went wrong this time and what to do.
        """
        return cls(type=f"urn:rotorid:problem:{name}", title=title, status=status, detail=detail)

    @classmethod
    def of_status(cls, status: int, detail: str = "") -> "Problem":
        """Make a problem that says no more than an HTTP status and what happened."""
        title = HTTPStatus(status).phrase
        return cls(title=title, status=status, detail=detail or f"{title}.")


class ProblemError(Exception):
    """Raised where a request cannot be answered as asked; the service answers with `problem`."""

    def __init__(self, problem: Problem, headers: Mapping[str, str] | None = None) -> None:
        super().__init__(problem.detail)
        self.problem = problem
        self.headers = headers


#: For a route's `responses`: errors have one shape whatever their status.
RESPONSES: dict[int | str, dict[str, Any]] = {
    "default": {
        "description": "Any error",
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }
}
