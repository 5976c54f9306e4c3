"""What went wrong in one shape: problem details (RFC 9457). `api.web.problem_responses` answers with them."""

from collections.abc import Mapping
from http import HTTPStatus
from typing import Any

from pydantic import BaseModel, Field

MEDIA_TYPE = "application/problem+json"

#: Our own kinds: end of the URN, title, HTTP status.
KINDS: Mapping[str, tuple[str, int]] = {
    "analysis-crashed": ("The analysis crashed", 500),
    "analysis-too-large": ("The analysis needed too much memory", 422),
    "analysis-too-slow": ("The analysis took too long", 422),
    "bad-upload": ("The upload cannot be read", 400),
    "body-too-large": ("The request is too large", 413),
    "cancelled": ("Cancelled", 409),
    "conflict": ("Changed by others", 409),
    "database-unavailable": ("Try again in a moment", 503),
    "disk-full": ("No room left", 507),
    "empty-log": ("The log is empty", 422),
    "forbidden-address": ("Forbidden address", 422),
    "foreign-form": ("Not our form", 403),
    "impossible-configuration": ("Impossible configuration", 422),
    "invalid-request": ("Request of the wrong shape", 422),
    "local-only": ("For this computer only", 421),
    "log-gone": ("The log is gone", 422),
    "log-too-large": ("The log is too large", 413),
    "no-answer": ("No answer in time", 503),
    "no-trusted-model": ("No trusted model", 404),
    "not-a-form": ("Not a multipart upload", 415),
    "not-possible": ("Not possible", 422),
    "other-site": ("Request from another site", 403),
    "request-stalled": ("The request stalled", 408),
    "results-not-kept": ("The results could not be kept", 507),
    "stopping": ("The service is being stopped", 503),
    "storage-unavailable": ("The storage cannot be used", 503),
    "token-needed": ("A token is needed", 401),
    "too-many-analyses": ("Too many analyses", 429),
    "too-many-bytes": ("Too many bytes", 403),
    "too-many-hooks": ("Too many webhooks", 403),
    "too-many-logs": ("Too many logs", 403),
    "too-many-notes": ("Too many notes", 403),
    "too-many-sign-ins": ("Too many wrong tokens", 429),
    "too-many-uploads": ("Too many uploads", 429),
    "unknown-host": ("Not a name of this service", 421),
    "unknown-log": ("Unknown log", 422),
    "unusable-log": ("The log cannot be analysed", 422),
    "upload-stalled": ("The upload stalled", 408),
}


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
    def of(cls, name: str, detail: str) -> "Problem":
        """Make a problem of our own kind."""
        title, status = KINDS[name]
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

    @classmethod
    def of(cls, name: str, detail: str, headers: Mapping[str, str] | None = None) -> "ProblemError":
        """Make the error of a problem of our own kind."""
        return cls(Problem.of(name, detail), headers)

    @classmethod
    def missing(cls, detail: str) -> "ProblemError":
        """Make the error where there is nothing of the kind, or it is another's."""
        return cls(Problem.of_status(HTTPStatus.NOT_FOUND, detail))


#: For a route's `responses`: errors have one shape whatever their status.
RESPONSES: dict[int | str, dict[str, Any]] = {
    "default": {
        "description": "Any error",
        "content": {MEDIA_TYPE: {"schema": {"$ref": "#/components/schemas/Problem"}}},
    }
}
