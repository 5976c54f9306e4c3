"""Starting the service."""

import logging
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from socket import socket
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import uvicorn
from alembic.util import CommandError
from fastapi import FastAPI
from fastapi.concurrency import run_in_threadpool
from pydantic import ValidationError
from sqlalchemy.exc import DBAPIError, SQLAlchemyError

from api import log_lines
from api.access import EVERYBODY, Tokens
from api.app import create_app
from api.crafts.folder_flights import FolderFlights
from api.crafts.registry import Crafts
from api.crafts.reviews import Reviews
from api.machine.tools import Tools
from api.settings import Access, Settings
from api.store import backup as backups
from api.store.database import Database, NewerDatabaseError
from api.web.middleware import LOOPBACK, PatientProtocol
from api.work.jobs import Runner, work_until_told
from core.lazy import lazy
from pipeline.config import ConfigError
from pipeline.storage.store import open_store

if TYPE_CHECKING:
    from api.machine import questions
else:
    questions = lazy("api.machine.questions")  # with the numerical packages, which the server does without

#: Seconds that requests still being answered get when the service is told to stop.
_GRACE = 5

_log = logging.getLogger("rotorid.api")


def serve(host: str = "127.0.0.1", port: int = 8000, workers: int | None = None, out: Path | None = None) -> None:
    """Run the service until it is told to stop (Ctrl-C, SIGTERM); its other settings come from the environment.

    Ends the program with a message when a setting is wrong, the data folder cannot be written or the address is taken.

    Parameters
    ----------
    host : str
        Address to listen on; one that other computers reach asks for tokens unless the settings say otherwise.
    port : int
        TCP port.
    workers : int, optional
        Analyses at a time; None for what the settings say.
    out : Path, optional
        Folder of `rotorid analyze` to show; None for what the settings say.
    """
    settings = _settings()
    log_lines.configure(settings.log_format)
    os.umask(0o077)  # logs are their owners', and no other user of this computer's
    if workers is not None:
        settings = settings.model_copy(update={"workers": workers})
    if out is not None:
        settings = settings.model_copy(update={"out": out})
    local_only = settings.access is Access.AUTO and host in LOOPBACK
    if settings.access is Access.AUTO:
        settings = settings.model_copy(update={"access": Access.OPEN if local_only else Access.TOKENS})
    with _usable(settings):
        app = create_app(settings, local_only=local_only)
    if host not in LOOPBACK and settings.access is Access.OPEN:
        _log.warning("anyone who can reach %s may upload and read logs: ROTORID_ACCESS is open", host)
    server = Server(app, settings, host=host, port=port)
    with suppress(KeyboardInterrupt):  # which uvicorn repeats after an orderly stop
        server.run()
    if not server.started:
        sys.exit(1)


def work(workers: int | None = None) -> None:
    """Run a worker until it is told to stop; ends the program with a message where a setting is wrong."""
    settings = _settings()
    log_lines.configure(settings.log_format)
    os.umask(0o077)
    settings = settings.model_copy(update={"workers": workers or settings.workers or 1})
    with _usable(settings):
        work_until_told(settings)


def backup(file: Path) -> tuple[int, int]:
    """Write the service that the environment describes into a file; return the number of rows and files."""
    if file.exists():
        sys.exit(f"{file} is there already; give another name.")
    return _carried(backups.save, file)


def restore(file: Path) -> tuple[int, int]:
    """Restore a backup into the empty service that the environment describes."""
    return _carried(backups.restore, file)


def _carried(work: Callable[[Settings, Path], tuple[int, int]], file: Path) -> tuple[int, int]:
    settings = _settings()
    os.umask(0o077)
    with _usable(settings):
        settings.data.mkdir(parents=True, exist_ok=True)
        try:
            return work(settings, file.absolute())
        except backups.BackupError as error:
            sys.exit(f"rotorid: {error}.")


@contextmanager
def _usable(settings: Settings) -> Iterator[None]:
    """End the program with a sentence where database or storage cannot be used."""
    try:
        yield
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


class Server(uvicorn.Server):
    """Ends the analyses before it waits for the requests that wait for them."""

    def __init__(self, app: FastAPI, settings: Settings, host: str = "127.0.0.1", port: int = 0) -> None:
        config = uvicorn.Config(
            app,
            host=host,
            port=port,
            http=PatientProtocol,
            log_config=None,
            server_header=False,
            timeout_graceful_shutdown=_GRACE,
            proxy_headers=bool(settings.proxies),
            forwarded_allow_ips=settings.proxies,
        )
        super().__init__(config)
        self._runner: Runner = app.state.parts.runner

    async def shutdown(self, sockets: list[socket] | None = None) -> None:
        """Stop the service in order."""
        await run_in_threadpool(self._runner.close)
        await super().shutdown(sockets)


@contextmanager
def open_tokens() -> Iterator[Tokens]:
    """Open the tokens of the service that the environment describes; it may be running or not."""
    with _opened(_settings()) as database:
        yield Tokens(database)


@contextmanager
def open_service(owner: str) -> Iterator[Tools]:
    """Open what one owner has in the service that the environment describes, to be asked only."""
    settings = _settings()
    with _opened(settings) as database:
        yield Tools(database, open_store(settings.storage_url), owner, _ask, settings.out)


@contextmanager
def open_folder(folder: Path) -> Iterator[Tools]:
    """Open what `rotorid analyze` wrote into a folder, by way of a database that is gone afterwards."""
    with TemporaryDirectory(prefix="rotorid-") as scratch:
        settings = Settings(data=Path(scratch), out=folder)
        with _opened(settings) as database:
            flights = FolderFlights(database, folder)
            reviews = Reviews(database, Crafts(database), _ask, lambda: None, flights.look)
            tools = Tools(database, open_store(settings.storage_url), EVERYBODY, _ask, folder, reviews.go_round)
            if not tools.list_craft().craft:
                raise ConfigError(f"{folder} holds no flights of this version of rotorid; analyze the logs again")
            yield tools


def _ask(question: str, *arguments: object) -> Any:
    """Answer a question in this process."""
    return getattr(questions, question)(*arguments)


@contextmanager
def _opened(settings: Settings) -> Iterator[Database]:
    """Open the database."""
    with _usable(settings):
        settings.data.mkdir(parents=True, exist_ok=True)
        with closing(Database(settings.database_url)) as database:
            database.migrate()
            yield database


def _in_short(error: Exception) -> str:
    """Return what the database said, without the statement and the links that SQLAlchemy adds."""
    return str(error.orig if isinstance(error, DBAPIError) else error)


def _settings() -> Settings:
    if "ROTORID_SCHEDULER" in os.environ:
        sys.exit("ROTORID_SCHEDULER is not known any more: run `rotorid worker` on each computer instead.")
    try:
        return Settings()
    except ValidationError as error:
        sys.exit("\n".join(f"ROTORID_{item['loc'][0]}".upper() + f": {item['msg']}" for item in error.errors()))
