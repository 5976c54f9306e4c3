"""``rotorid worker``: analyses of a service on another computer."""

from typing import Annotated

import typer


def worker(
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Analyses at the same time. Default: ROTORID_WORKERS, or all processors but one."),
    ] = None,
) -> None:
    """Run analyses from the queue of a service on this computer, until told to stop (Ctrl-C, SIGTERM).

    ROTORID_DATABASE and ROTORID_STORAGE name the database (PostgreSQL) and the storage (S3, a shared folder) of the
    service; ROTORID_LEASE must be the same as there. The server may run with ROTORID_WORKERS=0.

    Example: rotorid worker --workers 4
    """
    import api

    api.work(workers)
