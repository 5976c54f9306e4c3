"""Uploading logs, listing and deleting them."""

import asyncio
import re
from collections.abc import AsyncGenerator, Callable
from contextlib import ExitStack
from http import HTTPStatus
from pathlib import Path
from typing import Annotated, cast

from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from python_multipart.multipart import parse_options_header
from starlette.datastructures import Headers, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import ClientDisconnect

from api import problems
from api.access import bearer
from api.logs.catalog import Catalog, Kept, ended
from api.problems import ProblemError
from api.settings import Settings, in_words
from api.store.resources import Analysis, AnalysisAnswer, Log, Page, State, UploadedLog, UploadedLogs
from api.store.scratch import Incoming, Upload
from api.web.dependencies import After, Limit, LogId, Owner, OwnLog, Parts, PartsOf, owner_of, page
from api.web.results import Include, answer

#: Bytes gathered before they are written: few enough for many uploads at once, enough for few trips to the disk.
_BATCH = 1 << 18

#: Bytes that must arrive before an upload counts as going on: who sends less only holds a connection.
_LEAST = 1 << 10

#: What a form may add around the file: boundaries, part headers, small fields.
_FORM_OVERHEAD = 64 << 10

_NAME_LENGTH = 200

#: Most files of one form, most other fields, and bytes of such a one.
_FILES, _FIELDS, _FIELD_SIZE = 100, 100, 10_000

#: Longest boundary that the parser takes; RFC 2046 allows 70 bytes.
_BOUNDARY = 256

#: For a route's `openapi_extra`: the form cannot be declared as a parameter, which would read it into memory.
FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {
                        "file": {
                            "type": "array",
                            "items": {"type": "string", "format": "binary", "minLength": 1},
                            "minItems": 1,
                            "maxItems": _FILES,
                            "description": "Flight logs: DataFlash (.bin, .log), telemetry (.tlog) or PX4 (.ulg); the "
                            "field may come several times.",
                        }
                    },
                }
            }
        },
    }
}

router = APIRouter(prefix="/logs", tags=["logs"], responses=problems.RESPONSES)


@router.post(
    "",
    status_code=HTTPStatus.CREATED,
    summary="Upload logs, and analyse them in the same call if wanted",
    openapi_extra=FORM,
)
async def upload_log(
    request: Request,
    response: Response,
    parts: PartsOf,
    owner: Owner,
    analyze: Annotated[bool, Query(description="Wait for the analysis and answer with what it found.")] = False,
    include: Include = (),
) -> UploadedLog | UploadedLogs | AnalysisAnswer:
    """Keep the files of the form field `file`; the same content uploaded again is the same log.

    One file is answered with its log, several with a list of theirs.
    With `analyze=true` the answer comes when the analysis is done and holds the answers of the first screen, the RMSE
    of all models and their coefficients; the rest is behind its links, or comes with `include`. Without, it comes at
    once and `POST /api/v1/analyses` starts an analysis.
    """
    kept = await take_upload(request, parts, owner)
    if not analyze:
        logs = [UploadedLog(**dict(each.log), delete_token=each.delete_token) for each in kept]
        if len(logs) > 1:
            return UploadedLogs(logs=logs)
        response.headers["Location"] = f"/api/v1/logs/{logs[0].id}"
        return logs[0]
    ordered = await run_in_threadpool(parts.order, [each.log.id for each in kept], {}, owner)
    analysis = await ended(parts.catalog, ordered, parts.runner.stopping)
    response.headers["Location"] = f"/api/v1/analyses/{analysis.id}"
    if analysis.problem is not None:
        raise ProblemError(analysis.problem)
    if analysis.state is not State.DONE:
        raise _unfinished(analysis)
    return await run_in_threadpool(answer, analysis, parts, include)


async def take_upload(request: Request, parts: Parts, owner: str, fields: dict[str, str] | None = None) -> list[Kept]:
    """Keep the files that a request brings, which must begin like logs; `fields` gathers the other fields."""
    parts.rates.count_upload(request, owner)
    return await receive_logs(request, parts.incoming, parts.catalog, owner, parts.settings, parts.recognise, fields)


def _unfinished(analysis: Analysis) -> ProblemError:
    """Make the answer to who waited for an analysis that did not come to its end."""
    if analysis.state is State.CANCELLED:
        return ProblemError.of("cancelled", "The analysis was cancelled.")
    detail = (
        "The service is being stopped. The log is kept and its analysis goes on when the service is back: look at "
        f"/api/v1/analyses/{analysis.id}."
    )
    return ProblemError.of("stopping", detail)


@router.get("", summary="Logs, the newest first")
def list_logs(
    request: Request,
    parts: PartsOf,
    owner: Owner,
    limit: Limit = 50,
    after: After = None,
    name: Annotated[str, Query(max_length=200, description="Part of the name.")] = "",
) -> Page[Log]:
    """List your logs."""
    return page(request, parts.catalog.list_logs(owner, limit=limit + 1, after=after, name=name), limit)


@router.get("/{log_id}", summary="A log's name and size")
def show_log(log: OwnLog) -> Log:
    """Show what is known of an uploaded log."""
    return log


@router.delete("/{log_id}", status_code=HTTPStatus.NO_CONTENT, summary="Delete a log and all analyses of it")
def delete_log(
    request: Request,
    log_id: LogId,
    parts: PartsOf,
    delete_token: Annotated[
        str | None, Header(max_length=100, description="As told when the log was uploaded; instead of a token.")
    ] = None,
) -> None:
    """Delete a log for good: its bytes, its analyses and their results."""
    parts.catalog.delete_log(log_id, _deleter(request, parts, log_id, delete_token))


def _deleter(request: Request, parts: Parts, log_id: LogId, delete_token: str | None) -> str:
    """Report for whom a log may be deleted: for the owner who asks, or for the one whose delete token was sent."""
    if delete_token is not None and bearer(request) is None:
        return parts.catalog.may_delete_log(log_id, delete_token)
    return owner_of(request, parts)


class _Form(MultiPartParser):
    """A form whose files go straight to the disk; Starlette's own begin in memory."""

    def __init__(self, boundary: bytes, body: AsyncGenerator[bytes, None], place: Callable[[], Upload]) -> None:
        headers = Headers(raw=[(b"content-type", b'multipart/form-data; boundary="' + boundary + b'"')])
        super().__init__(headers, body, max_files=_FILES, max_fields=_FIELDS, max_part_size=_FIELD_SIZE)
        self._place = place
        self.complete = False

    def on_headers_finished(self) -> None:
        """Open a place for a file."""
        super().on_headers_finished()
        begun = self._current_part.file
        if begun is not None:
            begun.file.close()
            self._current_part.file = UploadFile(self._place(), filename=begun.filename)  # type: ignore[arg-type]

    def on_end(self) -> None:
        """Note that the form did not break off."""
        self.complete = True


async def receive_logs(
    request: Request,
    incoming: Incoming,
    catalog: Catalog,
    owner: str,
    settings: Settings,
    recognise: Callable[[Path, str], object] | None = None,
    fields: dict[str, str] | None = None,
) -> list[Kept]:
    """Store the logs of an upload: all, or none when something is wrong with one; `fields` gathers other fields."""
    boundary, limit = _boundary(request), settings.upload_limit
    if int(request.headers.get("content-length", 0)) > limit + _FORM_OVERHEAD:
        raise _too_large(limit)
    await run_in_threadpool(catalog.check_room, owner)
    try:
        with ExitStack() as stack:
            body = _body(request, limit + _FORM_OVERHEAD, settings)
            form = _Form(boundary, body, lambda: stack.enter_context(incoming.receive()))
            found = (await form.parse()).multi_items()
            if not form.complete:
                raise _bad_form("The upload ended before the file did. Try again.")
            files = [each for name, each in found if name == "file" and isinstance(each, UploadFile)]
            if not files:
                raise _bad_form("The form has no file called `file`. With curl: curl -F file=@FLIGHT.bin ADDRESS.")
            if fields is not None:
                fields |= {name: each for name, each in found if isinstance(each, str)}
            arrived = [(cast("Upload", each.file), _display_name(each.filename or "")) for each in files]
            for upload, name in arrived:
                if upload.size == 0:
                    raise _empty(name)
                if recognise is not None:
                    await run_in_threadpool(recognise, upload.path, name)
            return await run_in_threadpool(catalog.keep_logs, arrived, owner)
    except MultiPartException as error:
        raise _bad_form(f"The multipart form is damaged: {error.__cause__ or error.message}") from error
    except ClientDisconnect as error:
        raise _bad_form("The upload was broken off.") from error


async def _body(request: Request, most: int, settings: Settings) -> AsyncGenerator[bytes, None]:
    """Yield the body in large pieces, as long as it keeps coming faster than drop by drop and is not too large."""
    pieces, gathered, received = request.stream(), bytearray(), 0
    now, stall = asyncio.get_running_loop().time, settings.upload_stall
    deadline, arrived = now() + stall, 0
    while True:
        try:
            async with asyncio.timeout_at(deadline):
                piece = await anext(pieces)
        except StopAsyncIteration:
            break
        except TimeoutError as error:
            raise ProblemError.of(
                "upload-stalled",
                f"Nothing or hardly anything arrived for {stall:g} s. Check the connection and try again.",
            ) from error
        gathered += piece
        arrived += len(piece)
        received += len(piece)
        if received > most:
            raise _too_large(settings.upload_limit)
        if len(gathered) >= _BATCH:
            yield bytes(gathered)
            gathered.clear()
        if arrived >= _LEAST:  # our own time to write is not held against the client
            deadline, arrived = now() + stall, 0
    yield bytes(gathered)


def _boundary(request: Request) -> bytes:
    """Read from the headers what separates the parts of the form."""
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    if kind != b"multipart/form-data" or not options.get(b"boundary"):
        raise ProblemError.of(
            "not-a-form",
            "Send the log as the field `file` of a multipart form. With curl: curl -F file=@FLIGHT.bin ADDRESS.",
        )
    if len(options[b"boundary"]) > _BOUNDARY or b'"' in options[b"boundary"]:
        raise _bad_form(f"The boundary of the form is longer than {_BOUNDARY} bytes, or holds a quotation mark.")
    return options[b"boundary"]


def _display_name(filename: str) -> str:
    """Reduce what a client calls its file to a name that can be shown: no folders, no control characters."""
    name = re.split(r"[/\\]", filename)[-1]
    name = "".join(character for character in name if character.isprintable()).strip()
    return name[-_NAME_LENGTH:] or "log"


def _bad_form(detail: str) -> ProblemError:
    return ProblemError.of("bad-upload", detail)


def _empty(name: str) -> ProblemError:
    detail = f"{name} is empty: the autopilot may have lost power before it wrote anything, or the copy failed."
    return ProblemError.of("empty-log", detail)


def _too_large(limit: int) -> ProblemError:
    detail = f"The upload is larger than the {in_words(limit)} that this service takes."
    return ProblemError.of("log-too-large", detail)
