"""Receiving logs: a multipart form whose files go straight to the disk, whatever their size."""

import asyncio
import re
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack
from pathlib import Path

from fastapi import Request
from fastapi.concurrency import run_in_threadpool
from python_multipart.exceptions import FormParserError
from python_multipart.multipart import MultipartParser, parse_options_header
from starlette.requests import ClientDisconnect

from api.logs.catalog import Catalog, Kept
from api.problems import ProblemError
from api.settings import Settings, in_words
from api.store.scratch import Incoming, Upload

#: Bytes gathered before they are written: few enough for many uploads at once, enough for few trips to the disk.
_BATCH = 1 << 18

#: Bytes that must arrive before an upload counts as going on: who sends less only holds a connection.
_LEAST = 1 << 10

#: What a form may add around the file: boundaries, part headers, small fields.
_FORM_OVERHEAD = 64 << 10

_NAME_LENGTH = 200

#: Most files of one form, and most parts of it of any kind.
_FILES = 100
_PARTS = 200

#: Most other fields that are kept, and bytes of each.
_FIELDS, _FIELD_LENGTH = 20, 100

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


class _Form:
    """Follows the parser through a form, gathering the bytes of the parts called ``file``."""

    def __init__(self, boundary: bytes) -> None:
        #: What each file is called, in the order of the form.
        self.filenames: list[str] = []
        #: Bytes not yet taken: (number of the file, bytes).
        self.pending: list[tuple[int, bytearray]] = []
        #: Other fields, as far as they are short.
        self.fields: dict[str, bytearray] = {}
        self.complete = False
        self._parts = 0
        self._in_file = False
        self._field = ""
        self._header = bytearray()
        self._value = bytearray()
        self._disposition = b""
        self._parser = MultipartParser(
            boundary,
            {
                "on_part_begin": self._on_part_begin,
                "on_header_field": self._on_header_field,
                "on_header_value": self._on_header_value,
                "on_header_end": self._on_header_end,
                "on_headers_finished": self._on_headers_finished,
                "on_part_data": self._on_part_data,
                "on_end": self._on_end,
            },
        )

    def feed(self, chunk: bytes) -> None:
        """Read the next bytes of the request's body."""
        self._parser.write(chunk)

    def waiting(self) -> int:
        """Count the bytes not yet taken."""
        return sum(len(data) for _, data in self.pending)

    def take(self) -> list[tuple[int, bytearray]]:
        """Hand over what was gathered."""
        pending, self.pending = self.pending, []
        return pending

    def _on_part_begin(self) -> None:
        self._disposition = b""
        self._parts += 1
        if self._parts > _PARTS:
            raise _bad_form(f"The form has more than {_PARTS} parts.")

    def _on_header_field(self, data: bytes, start: int, end: int) -> None:
        self._header += data[start:end]

    def _on_header_value(self, data: bytes, start: int, end: int) -> None:
        self._value += data[start:end]

    def _on_header_end(self) -> None:
        if self._header.lower() == b"content-disposition":
            self._disposition = bytes(self._value)
        self._header.clear()
        self._value.clear()

    def _on_headers_finished(self) -> None:
        _, options = parse_options_header(self._disposition)
        self._in_file = options.get(b"name") == b"file" and b"filename" in options
        self._field = "" if self._in_file else options.get(b"name", b"").decode("utf-8", "replace")
        if self._in_file:
            self.filenames.append(options[b"filename"].decode("utf-8", "replace"))
            self.pending.append((len(self.filenames) - 1, bytearray()))

    def _on_part_data(self, data: bytes, start: int, end: int) -> None:
        if self._in_file:
            number = len(self.filenames) - 1
            if not self.pending:
                self.pending.append((number, bytearray()))
            self.pending[-1][1].extend(memoryview(data)[start:end])
        elif self._field and len(self.fields) < _FIELDS:
            value = self.fields.setdefault(self._field, bytearray())
            value.extend(memoryview(data)[start : min(end, start + _FIELD_LENGTH - len(value))])

    def _on_end(self) -> None:
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
    limit, stall = settings.upload_limit, settings.upload_stall
    form = _Form(_boundary(request))
    if int(request.headers.get("content-length", 0)) > limit + _FORM_OVERHEAD:
        raise _too_large(limit)
    await run_in_threadpool(catalog.check_room, owner)
    received = 0
    try:
        with ExitStack() as stack:
            uploads: list[Upload] = []

            def write() -> None:
                for number, data in form.take():
                    if number == len(uploads):
                        uploads.append(stack.enter_context(incoming.receive()))
                    uploads[number].write(data)

            async for chunk in _body(request, stall):
                received += len(chunk)
                if received > limit + _FORM_OVERHEAD:
                    raise _too_large(limit)
                form.feed(chunk)
                if len(form.filenames) > _FILES:
                    raise _bad_form(f"The form has more than {_FILES} files. Upload them in several parts.")
                if form.waiting() >= _BATCH:
                    await run_in_threadpool(write)
            if not form.complete:
                raise _bad_form("The upload ended before the file did. Try again.")
            if not form.filenames:
                raise _bad_form("The form has no file called `file`. With curl: curl -F file=@FLIGHT.bin ADDRESS.")
            await run_in_threadpool(write)
            names = [_display_name(name) for name in form.filenames]
            if fields is not None:
                fields |= {name: value.decode("utf-8", "replace") for name, value in form.fields.items()}
            for upload, name in zip(uploads, names, strict=True):
                if upload.size == 0:
                    raise _empty(name)
                if recognise is not None:
                    await run_in_threadpool(recognise, upload.path, name)
            arrived = list(zip(uploads, names, strict=True))
            return await run_in_threadpool(catalog.keep_logs, arrived, owner)
    except FormParserError as error:
        raise _bad_form(f"The multipart form is damaged: {error}.") from error
    except ClientDisconnect as error:
        raise _bad_form("The upload was broken off.") from error


async def _body(request: Request, stall: float) -> AsyncIterator[bytes]:
    """Yield the body piece by piece, as long as it keeps coming faster than drop by drop."""
    pieces = request.stream()
    now = asyncio.get_running_loop().time
    deadline, arrived = now() + stall, 0
    while True:
        try:
            async with asyncio.timeout_at(deadline):
                piece = await anext(pieces)
        except StopAsyncIteration:
            return
        except TimeoutError as error:
            raise ProblemError.of(
                "upload-stalled",
                f"Nothing or hardly anything arrived for {stall:g} s. Check the connection and try again.",
            ) from error
        yield piece
        arrived += len(piece)
        if arrived >= _LEAST:  # our own time to write is not held against the client
            deadline, arrived = now() + stall, 0


def _boundary(request: Request) -> bytes:
    """Read from the headers what separates the parts of the form."""
    kind, options = parse_options_header(request.headers.get("content-type", ""))
    if kind != b"multipart/form-data" or not options.get(b"boundary"):
        raise ProblemError.of(
            "not-a-form",
            "Send the log as the field `file` of a multipart form. With curl: curl -F file=@FLIGHT.bin ADDRESS.",
        )
    if len(options[b"boundary"]) > _BOUNDARY:
        raise _bad_form(f"The boundary of the form is longer than {_BOUNDARY} bytes.")
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
