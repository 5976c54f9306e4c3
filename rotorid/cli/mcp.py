"""``rotorid mcp``: questions about flights for assistants, by the Model Context Protocol."""

from pathlib import Path
from typing import Annotated

import typer


def mcp(
    folder: Annotated[
        Path | None,
        typer.Argument(
            exists=True, file_okay=False, help="What `rotorid analyze` wrote. Default: the service's own database."
        ),
    ] = None,
    owner: Annotated[str, typer.Option(help="Whose flights of the service; its tokens' owner.")] = "",
) -> None:
    """Answer questions about flights and craft on stdin and stdout, read-only, for an assistant that starts this.

    Needs `pip install 'rotorid[mcp]'`. Numbers come with unit, sigma and provenance, or with "not determined".

    Example: rotorid mcp out
    """
    from api.machine.mcp_server import server_of
    from api.machine.tools import Tools
    from api.server import open_folder, open_library
    from pipeline.errors import ConfigError

    try:
        with open_library(owner) if folder is None else open_folder(folder) as library:
            server_of(Tools(library)).run()
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("mcp", "mcp_types"):
            raise
        raise ConfigError("the Model Context Protocol is an extra: pip install 'rotorid[mcp]'") from error
