"""Keeping a service that is open because it is for this computer only from answering under any other name.

A page of another site can have its own name lead to 127.0.0.1 and then talk to the service as if it were its own. And
a proxy in front would make an open service public without anybody having decided so.
"""

from http import HTTPStatus

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from api.problems import Problem, respond

#: Names of this computer for itself.
LOOPBACK = ("127.0.0.1", "::1", "localhost")


class LocalOnly:
    """ASGI middleware: answers only to who calls the service by a name of this computer for itself."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or refuse it."""
        if scope["type"] == "http":
            request = Request(scope)
            if (request.url.hostname or "") not in LOOPBACK:
                await respond(request, _ELSEWHERE)(scope, receive, send)
                return
        await self.app(scope, receive, send)


_ELSEWHERE = Problem.named(
    "local-only",
    "For this computer only",
    HTTPStatus.MISDIRECTED_REQUEST,
    "This service is open, but only under the name localhost or 127.0.0.1. To reach it under another name its operator "
    "sets ROTORID_ACCESS to `tokens` (or to `open`, which lets everybody in).",
)
