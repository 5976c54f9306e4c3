"""Answers to errors: problem details (RFC 9457), or a page saying the same to a browser."""

import errno
import logging
from collections.abc import Mapping
from http import HTTPStatus
from urllib.parse import quote

from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse, RedirectResponse, Response
from sqlalchemy.exc import IntegrityError, InterfaceError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeoutError
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.problems import MEDIA_TYPE, InvalidInput, Problem, ProblemError
from api.web import page_templates

_log = logging.getLogger("rotorid.api")


def respond(request: Request, problem: Problem, headers: Mapping[str, str] | None = None) -> Response:
    """Answer with a problem: as JSON, or as a page where a person opened one in a browser.

    A browser that lacks a token is led to where it can sign in.
    """
    wants_page = not request.url.path.startswith("/api/") and "text/html" in request.headers.get("accept", "")
    if wants_page and problem.status == HTTPStatus.UNAUTHORIZED:
        back = quote(request.url.path) if request.method == "GET" else "/"
        return RedirectResponse(f"/sign-in?next={back}", HTTPStatus.SEE_OTHER)
    if wants_page:
        return page_templates.render(request, "problem.html", {"problem": problem}, problem.status, headers)
    return JSONResponse(problem.model_dump(exclude_none=True), problem.status, headers, MEDIA_TYPE)


async def _on_problem(request: Request, error: Exception) -> Response:
    assert isinstance(error, ProblemError)
    return respond(request, error.problem, error.headers)


async def _on_http_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    details = {
        HTTPStatus.NOT_FOUND: f"There is nothing at {request.url.path}.",
        HTTPStatus.METHOD_NOT_ALLOWED: f"{request.url.path} does not answer to {request.method}.",
    }
    generic = error.detail == HTTPStatus(error.status_code).phrase
    detail = details.get(HTTPStatus(error.status_code), "") if generic else error.detail
    return respond(request, Problem.of_status(error.status_code, detail), error.headers)


async def _on_invalid_request(request: Request, error: Exception) -> Response:
    assert isinstance(error, RequestValidationError)
    errors = [
        InvalidInput(where=f"{item['loc'][0]}: {'.'.join(map(str, item['loc'][1:]))}".rstrip(": "), detail=item["msg"])
        for item in error.errors()
    ]
    problem = Problem.of("invalid-request", "; ".join(f"{item.where}: {item.detail}" for item in errors))
    return respond(request, problem.model_copy(update={"errors": errors}))


async def _on_database_error(request: Request, error: Exception) -> Response:
    _log.error("%s %r: the database does not answer: %s", request.method, request.url.path, error)
    if "disk is full" in str(error):  # SQLite's words
        return respond(request, _DISK_FULL)
    detail = "The service's database does not answer now; nothing was lost or half done. Try again in a moment."
    problem = Problem.of("database-unavailable", detail)
    return respond(request, problem, {"Retry-After": "5"})


async def _on_storage_error(request: Request, error: Exception) -> Response:
    assert isinstance(error, OSError)
    _log.error("%s %r: the storage fails", request.method, request.url.path, exc_info=error)
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return respond(request, _DISK_FULL)
    detail = (
        f"The service's storage cannot be used now: {error.strerror or error}. Nothing was half done. Try again in a "
        "moment; if it stays so, its operator has to look after it."
    )
    problem = Problem.of("storage-unavailable", detail)
    return respond(request, problem, {"Retry-After": "60"})


async def _on_conflict(request: Request, error: Exception) -> Response:
    _log.warning("%s %r: %s", request.method, request.url.path, error)
    detail = "Somebody else changed or deleted the same thing at this moment. Look at it again."
    return respond(request, Problem.of("conflict", detail))


_DISK_FULL = Problem.of("disk-full", "The service has no room left. Its operator has to make room; then try again.")


def install(app: FastAPI) -> None:
    """Make `app` answer every error with problem details."""
    app.add_exception_handler(ProblemError, _on_problem)
    app.add_exception_handler(HTTPException, _on_http_error)
    app.add_exception_handler(RequestValidationError, _on_invalid_request)
    for kind in (OperationalError, InterfaceError, PoolTimeoutError):
        app.add_exception_handler(kind, _on_database_error)
    app.add_exception_handler(IntegrityError, _on_conflict)
    app.add_exception_handler(OSError, _on_storage_error)
    app.add_middleware(_ProblemShape)


class _ProblemShape:
    """Brings what the handlers do not see into the shape of all errors: bugs, and the framework's plain-text errors.

    Bugs are caught here and not by a handler for `Exception`, which would answer outside of all middleware and so
    without the safe headers. Plain text comes for instance where a Range header is malformed.
    """

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            await self.app(scope, receive, send)
            return
        request = Request(scope)
        started = False
        replacement: Response | None = None

        async def reshape(message: Message) -> None:
            nonlocal started, replacement
            if message["type"] == "http.response.start":
                started = True
                replacement = _reshaped(request, message)
            if replacement is None:
                await send(message)
            elif not message.get("more_body", False) and message["type"] == "http.response.body":
                await replacement(scope, receive, send)

        try:
            await self.app(scope, receive, reshape)
        except Exception:
            _log.exception("%s %r failed", request.method, request.url.path)
            if started:
                raise
            detail = "The service made a mistake; its own log says which. What you uploaded before is not lost."
            response = respond(request, Problem.of_status(HTTPStatus.INTERNAL_SERVER_ERROR, detail))
            await response(scope, receive, send)


def _reshaped(request: Request, start: Message) -> Response | None:
    """Return the problem to send in place of a plain-text error that is about to start; None for all else."""
    headers = Headers(raw=start["headers"])
    if start["status"] < HTTPStatus.BAD_REQUEST or not headers.get("content-type", "text/plain").startswith(
        "text/plain"
    ):
        return None
    kept = {name: value for name, value in headers.items() if name not in ("content-type", "content-length")}
    return respond(request, Problem.of_status(start["status"]), kept)
