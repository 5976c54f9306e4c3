"""``rotorid serve``: the web service."""

from pathlib import Path
from typing import Annotated

import typer


def serve(
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets others on the network in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8000,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Analyses at the same time. Default: ROTORID_WORKERS, or all processors but one."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(exists=True, file_okay=False, help="Show the craft of a folder that `rotorid analyze` wrote."),
    ] = None,
) -> None:
    """Start the web service: a page to drop logs on, and the HTTP interface behind it.

    On this computer it is open; with another --host it asks for tokens (see `rotorid token --help`). Everything else
    is set by environment variables that begin with ROTORID_; docs/service.md lists them.

    Example: rotorid serve --host 0.0.0.0 --port 8080 --workers 4
    """
    import api

    api.serve(host, port, workers, out)
