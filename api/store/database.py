"""The database: SQLite in a file unless a URL names another; opened, brought up to date, and asked in transactions."""

import os
import sqlite3
import threading
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, create_engine, event, func, select
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session, sessionmaker
from sqlalchemy.pool import ConnectionPoolEntry

from api.store.scratch import open_locked

#: Seconds after which a PostgreSQL server that has fallen silent is given up.
_SILENCE = 10.0

#: Seconds that a writer waits for SQLite's lock while its holder does not move, unless the URL says ``?timeout=``: a
#: busy disk flushes one commit for more than ten, and of fifty uploads at once that refused some.
_PATIENCE = 60.0


class _Line:
    """Who waits for a SQLite file's lock in this process, one behind the other."""

    def __init__(self) -> None:
        self.turn = threading.Lock()
        self.begun = 0

    def wait(self) -> bool:
        """Wait for the turn as long as the line moves: on a slow disk fifty short transactions take half a minute."""
        while True:
            begun = self.begun
            if self.turn.acquire(timeout=_PATIENCE):
                return True
            if self.begun == begun:
                return False


#: By the database's URL.
_lines: defaultdict[str, _Line] = defaultdict(_Line)

#: Bytes kept for deleting at a full disk: SQLite writes every page that it changes into a log first.
_RESERVE = 256 << 10


class NewerDatabaseError(Exception):
    """The database was made by a newer rotorid, which keeps in it what this one does not know."""

    def __init__(self) -> None:
        super().__init__(
            "it was made by a newer rotorid than this one. Install that version again, or restore the backup that was "
            "made before the upgrade"
        )


class Database:
    """A database of `records`."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._engine = _engine(url)
        file = _sqlite_file(url)
        self._reserve = None if file is None else file.with_name(file.name + ".reserve")
        # Writers say so before their first statement: SQLite cannot turn a reader into a writer when another one
        # has written meanwhile.
        self._reading = sessionmaker(self._engine, expire_on_commit=False)
        self._writing = sessionmaker(self._engine.execution_options(writes=True), expire_on_commit=False)

    def migrate(self) -> None:
        """Bring the tables up to date; several processes may do so at once."""
        config = Config()
        config.set_main_option("script_location", str(Path(__file__).parent / "migrations"))
        with self._engine.execution_options(writes=True).begin() as connection:
            config.attributes["connection"] = connection
            if connection.dialect.name == "postgresql":
                connection.exec_driver_sql("SELECT pg_advisory_xact_lock(7208960)")
            heads = MigrationContext.configure(connection).get_current_heads()
            known = {revision.revision for revision in ScriptDirectory.from_config(config).walk_revisions()}
            if not known.issuperset(heads):
                raise NewerDatabaseError
            command.upgrade(config, "head")
        self.keep_reserve()

    @contextmanager
    def read(self) -> Iterator[Session]:
        """Open a session that only looks."""
        with self._reading() as session:
            yield session

    @contextmanager
    def write(self) -> Iterator[Session]:
        """Open a transaction: all of it happens, or nothing."""
        with self._writing.begin() as session:
            yield session

    def keep_reserve(self) -> None:
        """Keep a little room beside a SQLite file, so that something can be deleted when the disk is full."""
        if self._reserve is not None and not self._reserve.exists():
            try:
                self._reserve.write_bytes(bytes(_RESERVE))
            except OSError:
                self.release_reserve()  # a part of it would be taken for the whole

    def release_reserve(self) -> bool:
        """Make that room free; False where there is none."""
        if self._reserve is None:
            return False
        try:
            self._reserve.unlink()
        except OSError:
            return False
        return True

    def close(self) -> None:
        """Close the connections."""
        self._engine.dispose()


def now(session: Session) -> datetime:
    """Return the time by a clock that all workers share: PostgreSQL's, or that of the computer of a SQLite file."""
    connection = session.connection()  # a writer waits here for SQLite's lock, and may do so for longer than a lease
    if connection.dialect.name == "postgresql":
        return connection.execute(select(func.now())).scalar_one().astimezone(UTC)
    return datetime.now(UTC)


def _engine(url: str) -> Engine:
    if make_url(url).get_backend_name() != "sqlite":
        return create_engine(url, pool_pre_ping=True, pool_timeout=_SILENCE, connect_args=_network(url))
    file = _sqlite_file(url)
    _make_private(file)
    patience = {} if "timeout" in make_url(url).query else {"timeout": _PATIENCE}
    # Connections enough for every thread: those that wait for the lock must not keep readers waiting.
    engine = create_engine(
        url, max_overflow=100, pool_timeout=_PATIENCE, connect_args={"isolation_level": None, **patience}
    )

    def prepare(connection: sqlite3.Connection, _: ConnectionPoolEntry) -> None:
        with _alone(file):
            _prepare_sqlite(connection)

    event.listen(engine, "connect", prepare)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _sqlite_file(url: str) -> Path | None:
    """Return the file of a SQLite database; None for another, or one in memory."""
    parsed = make_url(url)
    name = parsed.database
    is_file = parsed.get_backend_name() == "sqlite" and name and name != ":memory:" and not name.startswith("file:")
    return Path(name) if name and is_file else None


def _make_private(file: Path | None) -> None:
    """Make a database file readable by its user alone; SQLite gives the files beside it the same mode."""
    if file is None:
        return
    with suppress(OSError):  # SQLite says itself that it cannot be opened; and another user's file stays as it is
        # Only a new file: closing one that SQLite has open elsewhere in this process would drop SQLite's locks on it.
        with suppress(FileExistsError):
            os.close(os.open(file, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600))
        file.chmod(0o600)


def _network(url: str) -> dict[str, int]:
    """Report when a database that has fallen silent is given up; otherwise TCP would wait for many minutes."""
    if make_url(url).get_backend_name() != "postgresql":
        return {}
    return {"connect_timeout": int(_SILENCE), "tcp_user_timeout": int(1000 * _SILENCE), "keepalives_idle": 10}


@contextmanager
def _alone(file: Path | None) -> Iterator[None]:
    """Keep other connections to the same file from being prepared meanwhile.

    Two that turn a new file to a write-ahead log at once end in "database is locked", for which SQLite does not wait.
    """
    if file is None:
        yield
        return
    try:
        lock = open_locked(file.parent, wait=True)
    except OSError:  # SQLite says itself that the file cannot be opened
        lock = None
    try:
        yield
    finally:
        if lock is not None:
            os.close(lock)


def _prepare_sqlite(connection: sqlite3.Connection) -> None:
    """Allow readers while one writes, and flush what was committed to disk."""
    for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin_sqlite(connection: Connection) -> None:
    """Begin the transaction ourselves: Python's driver would only do so at the first change.

    Writers take turns. SQLite lets them look for its lock ten times a second, which one that has just given it up takes
    again between two looks of the others: on a slow disk these starved.
    """
    if not connection.get_execution_options().get("writes", False):
        connection.exec_driver_sql("BEGIN")
        return
    line = _lines[str(connection.engine.url)]
    is_ours = line.wait()
    try:
        connection.exec_driver_sql("BEGIN IMMEDIATE")
        line.begun += 1
    finally:
        if is_ours:
            line.turn.release()
