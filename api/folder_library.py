"""The flights and craft of a folder that `rotorid analyze` wrote, for machine access."""

from collections.abc import Sequence
from pathlib import Path

from api.library import CraftRef, FlightRef
from pipeline.errors import ConfigError
from pipeline.fleet.review import review
from pipeline.flight.craft import in_order, took_off
from pipeline.results.craft_review import CraftReview
from pipeline.results.entry import FlightEntry
from pipeline.results.quantity import ParameterChange
from pipeline.results.report import FlightReport
from pipeline.storage.manifest import FLIGHTS
from pipeline.storage.store import ENTRY, FolderStore
from reports.comparison import compare_reports
from reports.reading import read_report


class FolderLibrary:
    """A folder; read anew with every question, so that what a run adds is there.

    Parameters
    ----------
    folder : Path
        With ``flights/``, or with the report of one log.

    Raises
    ------
    ConfigError
        It is neither.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._store = FolderStore(folder)
        if not self._entries():
            read_report(folder)

    def flights(self) -> Sequence[FlightRef]:
        """List the flights, the newest first."""
        entries = self._entries()
        if not entries:
            report = read_report(self._folder)
            return [self._ref(report)] if isinstance(report, FlightReport) else []
        return [
            FlightRef(
                id=entry.folder,
                name=entry.name,
                craft=entry.vehicle,
                craft_name=entry.craft_name,
                start_utc=None if (start := took_off(entry)) is None else start.isoformat(),
                healthy=_healthy(self.report(entry.folder)),
            )
            for entry in reversed(in_order(entries))
        ]

    def crafts(self) -> Sequence[CraftRef]:
        """List the craft, grouped as the folder's report groups them."""
        found: dict[str, list[FlightEntry]] = {}
        for entry in self._entries():
            found.setdefault(entry.vehicle, []).append(entry)
        return [
            CraftRef(id=craft, name=flights[0].craft_name, kind=flights[0].craft_name, flights=len(flights))
            for craft, flights in found.items()
        ]

    def report(self, flight: str) -> FlightReport | None:
        """Read the report of a flight."""
        known = {entry.folder for entry in self._entries()}
        if not known and flight != _ONLY:
            return None
        if known and flight not in known:
            return None
        try:
            report = read_report(self._folder / FLIGHTS / flight if known else self._folder)
        except ConfigError:
            return None
        return report if isinstance(report, FlightReport) else None

    def review(self, craft: str) -> CraftReview | None:
        """Look at a craft as a whole."""
        entries = [entry for entry in self._entries() if entry.vehicle == craft]
        return review(entries) if entries else None

    def compare(self, a: str, b: str) -> Sequence[ParameterChange] | None:
        """Compare the parameters of two flights."""
        older, newer = self.report(a), self.report(b)
        if older is None or newer is None:
            return None
        pairs = compare_reports(older, newer, (older.name, newer.name)).pairs
        return [row for pair in pairs for row in pair.parameters]

    def _entries(self) -> list[FlightEntry]:
        names = self._store.names(FLIGHTS)
        found = (self._store.read_as(f"{FLIGHTS}/{name}/{ENTRY}", FlightEntry) for name in names)
        return [entry for entry in found if entry is not None]

    def _ref(self, report: FlightReport) -> FlightRef:
        return FlightRef(
            id=_ONLY,
            name=report.name,
            craft="",
            craft_name=report.vehicle.frame_class or "",
            start_utc=report.log.start_utc,
            healthy=_healthy(report),
        )


#: Id of the flight of a folder that holds the report of one log.
_ONLY = "flight"


def _healthy(report: FlightReport | None) -> str:
    lines = () if report is None or report.answer is None else report.answer.lines
    return next((line.word for line in lines if line.purpose == "Healthy"), "not determined")
