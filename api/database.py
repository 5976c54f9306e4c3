"""The database: SQLite in a file unless a URL names another; opened, brought up to date, and asked in transactions."""

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from alembic import command
from alembic.config import Config
from sqlalchemy import Connection, Engine, create_engine, event
from sqlalchemy.engine import make_url
from sqlalchemy.orm import Session, sessionmaker
from sqlalchemy.pool import ConnectionPoolEntry

#: Seconds that a statement waits for another process that holds SQLite's lock.
_PATIENCE = 10.0


class Database:
    """A database of `records`.

    Parameters
    ----------
    url : str
        As SQLAlchemy takes it: ``sqlite:////srv/rotorid/rotorid.db``, ``postgresql+psycopg://user@host/rotorid``.
    """

    def __init__(self, url: str) -> None:
        self.url = url
        self._engine = _engine(url)
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
            command.upgrade(config, "head")

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

    def close(self) -> None:
        """Give up the connections."""
        self._engine.dispose()


def _engine(url: str) -> Engine:
    if make_url(url).get_backend_name() != "sqlite":
        return create_engine(url, pool_pre_ping=True, pool_timeout=_PATIENCE, connect_args=_network(url))
    # Connections enough for every thread: those that wait for the lock must not keep readers waiting.
    engine = create_engine(
        url, max_overflow=100, pool_timeout=_PATIENCE, connect_args={"timeout": _PATIENCE, "isolation_level": None}
    )
    event.listen(engine, "connect", _prepare_sqlite)
    event.listen(engine, "begin", _begin_sqlite)
    return engine


def _network(url: str) -> dict[str, int]:
    """Say when a database that has fallen silent is given up; otherwise TCP would wait for many minutes."""
    if make_url(url).get_backend_name() != "postgresql":
        return {}
    return {"connect_timeout": int(_PATIENCE), "tcp_user_timeout": int(1000 * _PATIENCE), "keepalives_idle": 10}


def _prepare_sqlite(connection: sqlite3.Connection, _: ConnectionPoolEntry) -> None:
    """Let readers read while one writes, and have what was committed on the disk."""
    for pragma in ("journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON"):
        connection.execute(f"PRAGMA {pragma}").close()


def _begin_sqlite(connection: Connection) -> None:
    """Begin the transaction ourselves: Python's driver would only do so at the first change."""
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
