"""Clearing away what nobody needs any more: logs past their time, bytes that no row names, copies nobody reads."""

import logging
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import select

from api.logs.catalog import Catalog
from api.problems import ProblemError
from api.store.database import Database
from api.store.records import AnalysisRecord, LogRecord
from api.work.rounds import Rounds
from pipeline.storage.store import Store

_log = logging.getLogger("rotorid.api")

#: Seconds between two rounds.
_INTERVAL = 600.0

#: Bytes whose row may still come are younger than this: an upload is kept, then its row is written.
_GRACE = timedelta(hours=1)

#: Copies of objects from elsewhere that nobody read for so long are removed.
_CACHED = timedelta(days=1)


class Housekeeping(Rounds):
    """Goes round now and then, in a thread of its own."""

    def __init__(
        self, database: Database, objects: Store, catalog: Catalog, cache: Path, retention: timedelta | None
    ) -> None:
        super().__init__("housekeeping", _INTERVAL)
        self._database = database
        self._objects = objects
        self._catalog = catalog
        self._cache = cache
        self._retention = retention

    def go_round(self) -> None:
        """Clear away what is too old now."""
        self.clean(datetime.now(UTC))

    def clean(self, now: datetime) -> None:
        """Clear away what is too old at a time."""
        if self._retention is not None:
            self._remove_old(now - self._retention)
        self._remove_orphans(now - _GRACE)
        self._remove_copies(now - _CACHED)

    def _remove_old(self, before: datetime) -> None:
        with self._database.read() as session:
            old = session.execute(select(LogRecord.id, LogRecord.owner).where(LogRecord.received < before)).all()
        for log_id, owner in old:
            _log.info("log %s is removed: its time is over", log_id)
            with suppress(ProblemError):  # deleted at this moment
                self._catalog.delete_log(log_id, owner)

    def _remove_orphans(self, before: datetime) -> None:
        """Remove bytes that no row names: of uploads that were broken off, and of attempts that came to nothing."""
        files = (file for prefix in ("logs", "analyses") for file in self._objects.files(prefix))
        old = [key for key, written in files if written < before]
        with self._database.read() as session:
            kept = {f"logs/{log_id}" for log_id in session.scalars(select(LogRecord.id))}
            for analysis, results, lease in session.execute(
                select(AnalysisRecord.id, AnalysisRecord.results, AnalysisRecord.lease)
            ):
                kept |= {f"analyses/{analysis}/{place}" for place in (results, lease) if place is not None}
        for key in old:
            # logs/ID, or analyses/ID/RESULTS and the file's name
            depth = 2 if key.startswith("logs/") else 3
            if "/".join(key.split("/")[:depth]) not in kept:
                _log.info("object %s is removed: it belongs to nothing", key)
                self._objects.remove(key)

    def _remove_copies(self, before: datetime) -> None:
        for path in self._cache.rglob("*"):
            if path.is_file() and path.stat().st_atime < before.timestamp():
                path.unlink(missing_ok=True)
