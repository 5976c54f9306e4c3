"""Starting the service."""

import logging
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from socket import socket

import uvicorn
from alembic.util import CommandError
from fastapi.concurrency import run_in_threadpool
from pydantic import ValidationError
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from api import log_lines
from api.access import Tokens
from api.app import create_app
from api.connections import PatientProtocol
from api.database import Database, NewerDatabaseError
from api.jobs import Runner
from api.local_only import LOOPBACK
from api.settings import Access, Settings

#: Seconds that requests still being answered get when the service is told to stop.
_GRACE = 5

_log = logging.getLogger("rotorid.api")


def serve(host: str = "127.0.0.1", port: int = 8000, workers: int | None = None) -> None:
    """Run the service until it is told to stop (Ctrl-C, SIGTERM); its other settings come from the environment.

    Ends the program with a message when a setting is wrong, the data folder cannot be written or the address is taken.
    """
    settings = _settings()
    log_lines.configure(settings.log_format)
    os.umask(0o077)  # logs are their owners', and no other user of this computer's
    if workers is not None:
        settings = settings.model_copy(update={"workers": workers})
    local_only = settings.access is Access.AUTO and host in LOOPBACK
    if settings.access is Access.AUTO:
        settings = settings.model_copy(update={"access": Access.OPEN if local_only else Access.TOKENS})
    try:
        app = create_app(settings, local_only=local_only)
    except OSError as error:
        sys.exit(
            f"rotorid cannot keep logs in {settings.data.resolve()}: {error.strerror or error}. "
            "Set ROTORID_DATA to a folder that it can write, or ROTORID_STORAGE to a storage that it can."
        )
    except NewerDatabaseError as error:
        sys.exit(f"rotorid cannot use its database: {error}.")
    except (SQLAlchemyError, CommandError) as error:
        sys.exit(f"rotorid cannot use its database: {_in_short(error)}. Check ROTORID_DATABASE.")
    except (ValueError, ImportError) as error:
        sys.exit(f"rotorid cannot use what ROTORID_DATABASE or ROTORID_STORAGE names: {error}.")
    if host not in LOOPBACK and settings.access is Access.OPEN:
        _log.warning("anyone who can reach %s may upload and read logs: ROTORID_ACCESS is open", host)
    config = uvicorn.Config(
        app,
        host=host,
        port=port,
        http=PatientProtocol,
        log_config=None,
        server_header=False,
        timeout_graceful_shutdown=_GRACE,
    )
    server = Server(config, app.state.parts.runner)
    with suppress(KeyboardInterrupt):  # which uvicorn repeats after an orderly stop
        server.run()
    if not server.started:
        sys.exit(1)


class Server(uvicorn.Server):
    """Ends the analyses before it waits for the requests that wait for them."""

    def __init__(self, config: uvicorn.Config, runner: Runner) -> None:
        super().__init__(config)
        self._runner = runner

    async def shutdown(self, sockets: list[socket] | None = None) -> None:
        """Stop the service in order."""
        await run_in_threadpool(self._runner.close)
        await super().shutdown(sockets)


@contextmanager
def open_tokens() -> Iterator[Tokens]:
    """Open the tokens of the service that the environment describes; it may be running or not."""
    settings = _settings()
    try:
        settings.data.mkdir(parents=True, exist_ok=True)
        database = Database(settings.database_url)
        try:
            database.migrate()
            yield Tokens(database)
        finally:
            database.close()
    except NewerDatabaseError as error:
        sys.exit(f"rotorid cannot use its database: {error}.")
    except (OSError, SQLAlchemyError, CommandError, ValueError, ImportError) as error:
        sys.exit(f"rotorid cannot use its database: {_in_short(error)}. Check ROTORID_DATABASE and ROTORID_DATA.")


def _in_short(error: Exception) -> str:
    """Return what the database said, without the statement and the links that SQLAlchemy adds."""
    return str(error.orig if isinstance(error, DBAPIError) else error)


def _settings() -> Settings:
    try:
        return Settings()
    except ValidationError as error:
        sys.exit("\n".join(f"ROTORID_{item['loc'][0]}".upper() + f": {item['msg']}" for item in error.errors()))
