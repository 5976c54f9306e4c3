"""What stands before the routes: safe headers, names of the service, bodies and connections that are there at once."""

import asyncio
from collections.abc import Collection, Iterable
from typing import Any

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from api.problems import Problem
from api.web.problem_responses import respond
from core.quantity import size

#: Our pages load only our own scripts, styles and reports, and cannot be framed by others.
_PAGE_POLICY = "; ".join(
    [
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data:",
        "connect-src 'self'",
        "frame-src 'self'",
        "form-action 'self'",
        "base-uri 'none'",
        "frame-ancestors 'none'",
    ]
)

#: Plotly writes styles into the page that it draws on.
PLOT_POLICY = _PAGE_POLICY.replace("style-src 'self'", "style-src 'self' 'unsafe-inline'")

#: A report carries its scripts and styles inside and draws text that came from a log. The sandbox gives it an origin
#: of its own, so that whatever slipped through escaping could neither call this service nor any other.
REPORT_POLICY = "; ".join(
    [
        "sandbox allow-scripts allow-downloads allow-popups",
        "default-src 'none'",
        "script-src 'unsafe-inline'",
        "style-src 'unsafe-inline'",
        "img-src data: blob:",
        "font-src data:",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'self'",
    ]
)

_DEFAULTS = {
    "Content-Security-Policy": _PAGE_POLICY,
    "X-Content-Type-Options": "nosniff",
    # With no-referrer browsers would send `Origin: null` with our own forms.
    "Referrer-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    # Logs are private: a shared cache keeps nothing, the browser asks before it shows what it kept.
    "Cache-Control": "private, no-cache",
}


class SafeHeaders:
    """ASGI middleware: adds the safe headers that a response does not set itself."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and add to the start of its response."""

        async def send_safely(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _DEFAULTS.items():
                    headers.setdefault(name, value)
            await send(message)

        await self.app(scope, receive, send_safely if scope["type"] == "http" else send)


#: Names of this computer for itself.
LOOPBACK = ("127.0.0.1", "::1", "localhost")


class KnownHosts:
    """ASGI middleware: answers only to who calls the service by a name of this computer for itself, or by one given."""

    def __init__(self, app: ASGIApp, names: Collection[str] = ()) -> None:
        self.app = app
        self._names = {*LOOPBACK, *names}
        self._problem = _UNKNOWN if names else _ELSEWHERE

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or refuse it."""
        if scope["type"] == "http":
            request = Request(scope)
            if (request.url.hostname or "") not in self._names:
                await respond(request, self._problem)(scope, receive, send)
                return
        await self.app(scope, receive, send)


_UNKNOWN = Problem.of(
    "unknown-host", "This service does not answer under this name. Its operator lists its names in ROTORID_HOSTS."
)

_ELSEWHERE = Problem.of(
    "local-only",
    "This service is open, but only under the name localhost or 127.0.0.1. To reach it under another name its operator "
    "sets ROTORID_ACCESS to `tokens` (or to `open`, which lets everybody in).",
)


#: Most bytes of a JSON document or a form without files.
_LIMIT = 1 << 20


class SmallBodies:
    """ASGI middleware: refuses large or slow bodies but for uploads, which are limited where they are taken."""

    def __init__(self, app: ASGIApp, uploads: Iterable[str], stall: float) -> None:
        self.app = app
        self._uploads = frozenset(uploads)
        self._stall = stall

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Read the body, if there is one, and pass the request on with it."""
        if scope["type"] != "http" or (scope["method"] == "POST" and scope["path"] in self._uploads):
            await self.app(scope, receive, send)
            return
        names = {name for name, _ in scope["headers"]}
        if not names & {b"content-length", b"transfer-encoding"}:
            await self.app(scope, receive, send)
            return
        request = Request(scope)
        if int(request.headers.get("content-length", 0)) > _LIMIT:
            await respond(request, _TOO_LARGE)(scope, receive, send)
            return
        body = bytearray()
        try:
            async with asyncio.timeout(self._stall):
                while True:
                    message = await receive()
                    if message["type"] == "http.disconnect":
                        return
                    body += message.get("body", b"")
                    if len(body) > _LIMIT:
                        await respond(request, _TOO_LARGE)(scope, receive, send)
                        return
                    if not message.get("more_body", False):
                        break
        except TimeoutError:
            await respond(request, _slow(self._stall))(scope, receive, send)
            return
        whole: Message | None = {"type": "http.request", "body": bytes(body), "more_body": False}

        async def replay() -> Message:
            nonlocal whole
            if whole is None:
                return await receive()
            first, whole = whole, None
            return first

        await self.app(scope, replay, send)


_TOO_LARGE = Problem.of("body-too-large", f"A request that is no upload has at most {size(_LIMIT)}.")


def _slow(stall: float) -> Problem:
    return Problem.of(
        "request-stalled", f"The request was not there after {stall:g} s. Check the connection and try again."
    )


#: Seconds for the head of a request, from the connection or from its first byte on; also for what a client still sends
#: after its request was refused.
PATIENCE = 10.0


class PatientProtocol(H11Protocol):
    """HTTP/1.1 as uvicorn speaks it, for a limited time without a request: uvicorn itself waits for one without end."""

    def __init__(self, *arguments: Any, **named: Any) -> None:
        super().__init__(*arguments, **named)
        self._closing: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request."""
        super().connection_made(transport)
        self._look()

    def data_received(self, data: bytes) -> None:
        """Read what arrives, which may be a part of a head."""
        super().data_received(data)
        self._look()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        super().connection_lost(exc)
        self._stop_waiting()

    def _look(self) -> None:
        """Set the clock when no request is being answered, and stop it when one is."""
        if self.cycle is not None and not self.cycle.response_complete:
            self._stop_waiting()
        elif self._closing is None:
            self._closing = self.loop.call_later(PATIENCE, self._give_up)

    def _stop_waiting(self) -> None:
        if self._closing is not None:
            self._closing.cancel()
            self._closing = None

    def _give_up(self) -> None:
        self._closing = None
        if self.cycle is None or self.cycle.response_complete:
            self.transport.close()
