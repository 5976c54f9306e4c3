"""``rotorid serve``, ``worker``, ``backup``, ``restore``, ``token`` and ``mcp``: the service and its operator."""

from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.output import SOME_FAILED, fail

#: Shared by the server and workers without one.
Workers = Annotated[
    int | None,
    typer.Option(min=1, help="Analyses at the same time. Default: ROTORID_WORKERS, or all processors but one."),
]


def serve(
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets others on the network in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8000,
    workers: Workers = None,
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


def worker(
    workers: Workers = None,
) -> None:
    """Run analyses from the queue of a service on this computer, until told to stop (Ctrl-C, SIGTERM).

    ROTORID_DATABASE and ROTORID_STORAGE name the database (PostgreSQL) and the storage (S3, a shared folder) of the
    service; ROTORID_LEASE must be the same as there. The server may run with ROTORID_WORKERS=0.

    Example: rotorid worker --workers 4
    """
    import api

    api.work(workers)


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
    """Restore a backup into an empty service, which may have another database and storage; it must not run.

    Example: rotorid restore rotorid-2026-03-14.tar
    """
    import api

    rows, objects = api.restore(file)
    typer.echo(f"{file}: {rows} rows and {objects} files are back")


tokens = typer.Typer(
    name="token",
    help="Make, list and revoke the tokens of a web service that is not open to all (ROTORID_ACCESS=tokens).",
    no_args_is_help=True,
)


@tokens.command()
def create(
    owner: Annotated[str, typer.Argument(help="Whose token it is; logs belong to their owner, who may have several.")],
    days: Annotated[float | None, typer.Option(min=0.0, help="Days until it expires. Default: never.")] = None,
) -> None:
    """Make a token and print it: it is shown this once, the service keeps only its digest.

    Example: rotorid token create "Ada Lovelace" --days 90
    """
    from api.server import open_tokens

    if not 0 < len(owner.strip()) <= 100:
        raise typer.BadParameter("an owner's name has 1 to 100 characters")
    with open_tokens() as known:
        typer.echo(known.create(owner.strip(), days))


@tokens.command("list")
def list_tokens() -> None:
    """List the tokens: number, owner, when it was made and when it expires.

    Example: rotorid token list
    """
    from api.server import open_tokens

    with open_tokens() as known:
        for token in known.list():
            expires = "never expires" if token.expires is None else f"expires {token.expires:%Y-%m-%d}"
            typer.echo(f"{token.id}  {token.owner}  made {token.created:%Y-%m-%d}  {expires}")


@tokens.command()
def revoke(token: Annotated[str, typer.Argument(help="Its number, as `rotorid token list` shows it.")]) -> None:
    """Make a token worthless, at once.

    Example: rotorid token revoke 3
    """
    from api.server import open_tokens

    with open_tokens() as known:
        if not known.revoke(token):
            fail(f"there is no token with the number {token}; `rotorid token list` shows them", SOME_FAILED)


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
    from api.server import open_folder, open_service
    from pipeline.config import ConfigError

    try:
        with open_service(owner) if folder is None else open_folder(folder) as tools:
            server_of(tools).run()
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("mcp", "mcp_types"):
            raise
        raise ConfigError("the Model Context Protocol is an extra: pip install 'rotorid[mcp]'") from error
