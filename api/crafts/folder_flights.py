"""Flights of a folder that `rotorid analyze` wrote, shown with the craft of the service: read, and never written."""

import logging
from pathlib import Path

from sqlalchemy import select

from api.access.identity import EVERYBODY
from api.store.database import Database
from api.store.ids import digest
from api.store.records import FlightRecord
from api.work.craft_flights import forget, keep
from api.work.outcome import of_report
from core.serialization import restored
from pipeline.errors import ConfigError
from pipeline.results.entry import FlightEntry
from pipeline.results.report import FlightReport
from pipeline.storage.manifest import FLIGHTS, MANIFEST
from pipeline.storage.store import ENTRY, FolderStore
from reports.numbers.reading import read_report

#: Plotly, which the pages of flights of a folder share (`reports.files.folder`).
SHARED_SCRIPT = "plotly.min.js"

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
        try:
            written = (self.folder / MANIFEST).stat().st_mtime_ns
        except OSError:
            return
        if written == self._seen:
            return
        store = FolderStore(self.folder)
        found: dict[str, FlightEntry] = {}
        for name in store.names(FLIGHTS):
            entry = store.read_as(f"{FLIGHTS}/{name}/{ENTRY}", FlightEntry)
            if entry is not None:
                found[f"{FLIGHTS}/{name}"] = entry
        flown = {place: of_report(entry, self.report(place)) for place, entry in found.items()}
        with self._database.write() as session:
            known = session.scalars(
                select(FlightRecord).where(FlightRecord.owner == EVERYBODY, FlightRecord.log_id.is_(None))
            ).all()
            same = {each.folder: restored(each.entry, FlightEntry).key for each in known if each.folder in found}
            forget(session, [each for each in known if each.folder not in found], "is not in the folder any more")
            for place, each in flown.items():
                if same.get(place) != each.entry.key:
                    keep(session, EVERYBODY, digest(f"{self.folder}/{place}"), each, (None, None, place))
        _log.info("%d flights of %s are shown", len(found), self.folder)
        self._seen = written

    def report(self, place: str) -> FlightReport | None:
        """Read the report of a flight; None where there is none of this version."""
        if self.folder is None:
            return None
        try:
            report = read_report(self.folder / place)
        except (ConfigError, OSError):
            return None
        return report if isinstance(report, FlightReport) else None

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
