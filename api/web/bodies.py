"""Bodies of requests that are no uploads: small, and there at once, so that they are read before anything is done."""

import asyncio
from collections.abc import Iterable

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from api.problems import Problem
from api.store import sizes
from api.web.problem_responses import respond

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


_TOO_LARGE = Problem.of("body-too-large", f"A request that is no upload has at most {sizes.in_words(_LIMIT)}.")


def _slow(stall: float) -> Problem:
    return Problem.of(
        "request-stalled", f"The request was not there after {stall:g} s. Check the connection and try again."
    )
