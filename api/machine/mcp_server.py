"""The questions of `api.machine.tools` over the Model Context Protocol: read-only, on stdin and stdout."""

from collections.abc import Callable
from functools import wraps
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from api.machine.tools import QUESTIONS, Tools, UnknownError
from core.lazy import lazy

if TYPE_CHECKING:
    import mcp_types
    from mcp.server import mcpserver
    from mcp.server.mcpserver import exceptions
else:
    # An extra: whoever only serves pages need not have it.
    mcpserver, exceptions = lazy("mcp.server.mcpserver"), lazy("mcp.server.mcpserver.exceptions")
    mcp_types = lazy("mcp_types")

_INSTRUCTIONS = """Flights of multirotors, analysed by rotorid. Every number comes with its unit, one standard deviation
(sigma) and provenance: the log, the seconds of it, and the method. Where there is none the reason says "not determined"
and why: do not fill it in. Begin with list_craft and list_flights; flights and craft may be called by id or name."""


def server_of(tools: Tools) -> "mcpserver.MCPServer[None]":
    """Make a server of the questions."""
    server: mcpserver.MCPServer[None] = mcpserver.MCPServer(
        "rotorid", version=version("rotorid"), instructions=_INSTRUCTIONS
    )
    for question in QUESTIONS:
        server.add_tool(
            _told(getattr(tools, question.__name__)),
            name=question.__name__,
            description=question.__doc__,
            annotations=mcp_types.ToolAnnotations(read_only_hint=True, open_world_hint=False, idempotent_hint=True),
        )
    return server


def _told(question: Callable[..., object]) -> Callable[..., object]:
    """Answer what is not there in a sentence."""

    @wraps(question)
    def answer(*arguments: Any, **named: Any) -> object:
        try:
            return question(*arguments, **named)
        except UnknownError as error:
            raise exceptions.ToolError(str(error)) from error

    return answer
