"""Flights of a folder that `rotorid analyze` wrote, shown with the craft of the service: read, and never written."""

import logging
from pathlib import Path

from sqlalchemy import select

from api.access import EVERYBODY
from api.store.database import Database
from api.store.ids import digest
from api.store.records import FlightRecord
from api.work.craft_flights import forget, keep
from api.work.outcome import Said, of_report
from core.serialization import restored
from pipeline.results.fleet import FlightEntry
from pipeline.storage.manifest import FLIGHTS, MANIFEST
from pipeline.storage.store import ENTRY, Store
from reports import SHARED_SCRIPT

_log = logging.getLogger("rotorid.api")


class FolderFlights:
    """Keeps the flights of a folder in step with the database."""

    def __init__(self, database: Database, folder: Path | None) -> None:
        self._database = database
        self.folder = None if folder is None else folder.absolute()
        self._seen = -1

    def look(self) -> None:
        """Adopt what changed since the last look: a run writes its manifest last."""
        if self.folder is None:
            return
        store = Store(self.folder)
        several = (self.folder / MANIFEST).is_file()
        try:
            written = (self.folder / (MANIFEST if several else ENTRY)).stat().st_mtime_ns
        except OSError:
            return
        if written == self._seen:
            return
        places = [f"{FLIGHTS}/{name}" for name in store.names(FLIGHTS)] if several else ["."]
        entries = {place: store.read_as(f"{place}/{ENTRY}", FlightEntry) for place in places}
        flights = {place: entry for place, entry in entries.items() if entry is not None}
        with self._database.write() as session:
            known = session.scalars(
                select(FlightRecord).where(FlightRecord.owner == EVERYBODY, FlightRecord.log_id.is_(None))
            ).all()
            same = {
                record.folder: restored(record.entry, FlightEntry).key for record in known if record.folder in flights
            }
            forget(
                session, [record for record in known if record.folder not in flights], "is not in the folder any more"
            )
            for place, entry in flights.items():
                if same.get(place) != entry.key:
                    flown = of_report(entry, store.read_as(f"{place}/report.json", Said))
                    keep(session, EVERYBODY, digest(f"{self.folder}/{place}"), flown, (None, None, place))
        _log.info("%d flights of %s are shown", len(flights), self.folder)
        self._seen = written

    def page(self, place: str) -> str | None:
        """Read the page of a flight, its script inside: in the sandbox of reports none may be fetched."""
        if self.folder is None:
            return None
        try:
            page = (self.folder / place / "report.html").read_text(encoding="utf-8")
            link = f'<script src="../../{SHARED_SCRIPT}"></script>'
            if link in page:
                script = (self.folder / SHARED_SCRIPT).read_text(encoding="utf-8")
                page = page.replace(link, f"<script>{script}</script>")
        except OSError:
            return None
        return page
