"""Receiving logs: a multipart form whose files go straight to the disk, whatever their size."""

import asyncio
import re
from collections.abc import AsyncGenerator, Callable
from contextlib import ExitStack
from typing import cast

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from python_multipart.multipart import parse_options_header
from starlette.datastructures import Headers, UploadFile
from starlette.formparsers import MultiPartException, MultiPartParser
from starlette.requests import ClientDisconnect

from api.logs.catalog import AcceptedLog
from api.problems import ProblemError
from api.settings import Settings
from api.store.scratch import Upload, open_upload
from api.web.dependencies import Parts
from core.quantity import size

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
    request: Request, parts: Parts, owner: str, fields: dict[str, str] | None = None
) -> list[AcceptedLog]:
    """Keep the logs of an upload, which must begin like logs: all, or none when something is wrong with one.

    `fields` gathers the other fields of the form.
    """
    parts.rates.count_upload(request, owner)
    boundary, limit = _boundary(request), parts.settings.upload_limit
    if int(request.headers.get("content-length", 0)) > limit + _FORM_OVERHEAD:
        raise _too_large(limit)
    await run_in_threadpool(parts.catalog.check_room, owner)
    try:
        with ExitStack() as stack:
            body = _body(request, limit + _FORM_OVERHEAD, parts.settings)
            form = _Form(boundary, body, lambda: stack.enter_context(open_upload(parts.scratch.folder)))
            received = (await form.parse()).multi_items()
            if not form.complete:
                raise _bad_form("The upload ended before the file did. Try again.")
            files = [file for name, file in received if name == "file" and isinstance(file, UploadFile)]
            if not files:
                raise _bad_form("The form has no file called `file`. With curl: curl -F file=@FLIGHT.bin ADDRESS.")
            if fields is not None:
                fields |= {name: value for name, value in received if isinstance(value, str)}
            arrived = [(cast("Upload", file.file), _display_name(file.filename or "")) for file in files]
            for upload, name in arrived:
                if upload.size == 0:
                    raise _empty(name)
                if parts.recognise is not None:
                    await run_in_threadpool(parts.recognise, upload.path, name)
            return await run_in_threadpool(parts.catalog.keep_logs, arrived, owner)
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
    detail = f"The upload is larger than the {size(limit)} that this service takes."
    return ProblemError.of("log-too-large", detail)
