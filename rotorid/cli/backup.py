"""``rotorid backup`` and ``rotorid restore``: a whole service in one file, and back."""

from pathlib import Path
from typing import Annotated

import typer


def backup(
    file: Annotated[Path, typer.Argument(dir_okay=False, help="File to write; it must not be there.")],
) -> None:
    """Write everything that a service keeps into one file; the service may be running.

    ROTORID_DATA, ROTORID_DATABASE and ROTORID_STORAGE say which.

    Example: rotorid backup rotorid-2026-03-14.tar
    """
    import api

    rows, objects = api.backup(file)
    typer.echo(f"{file}: {rows} rows and {objects} files")


def restore(
    file: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="File that `rotorid backup` wrote.")],
) -> None:
    """Bring a backup back into an empty service, which may have another database and storage; it must not run.

    Example: rotorid restore rotorid-2026-03-14.tar
    """
    import api

    rows, objects = api.restore(file)
    typer.echo(f"{file}: {rows} rows and {objects} files are back")
