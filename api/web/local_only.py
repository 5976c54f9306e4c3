"""Keeping a service that is open because it is for this computer only from answering under any other name.

A page of another site can have its own name lead to 127.0.0.1 and then talk to the service as if it were its own. And
a proxy in front would make an open service public without anybody having decided so.
"""

from collections.abc import Collection

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from api.problems import Problem
from api.web.problem_responses import respond

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
