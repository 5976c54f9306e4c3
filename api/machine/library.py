"""The flights and craft of one owner of the service, or of a folder, for machine access."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from sqlalchemy import func, select

from api.machine.answers import NOT_DETERMINED, CraftRef, FlightRef
from api.store.database import Database
from api.store.ids import is_id
from api.store.objects import Objects
from api.store.records import AnalysisRecord, CraftRecord, FlightRecord
from core.serialization import restored
from pipeline.errors import ConfigError
from pipeline.results.craft_review import CraftReview
from pipeline.results.quantity import ParameterChange
from pipeline.results.report import FlightReport
from reports.numbers.reading import parse_report


class Library:
    """What one owner has, to be read only; `ask` answers functions of `api.machine.questions`."""

    def __init__(
        self,
        database: Database,
        objects: Objects,
        owner: str,
        ask: Callable[..., Any],
        folder: Path | None = None,
        refresh: Callable[[], None] = lambda: None,
    ) -> None:
        self._folder = folder
        self._database = database
        self._objects = objects
        self._owner = owner
        self._ask = ask
        #: Brings what is new elsewhere.
        self.refresh = refresh

    def flights(self, craft: str = "", text: str = "", limit: int | None = None) -> tuple[Sequence[FlightRef], int]:
        """List flights, the newest first, and count them."""
        chosen = [FlightRecord.owner == self._owner]
        if craft:
            chosen.append(FlightRecord.craft_id == craft)
        if text:
            chosen.append(FlightRecord.name.icontains(text.replace("\0", ""), autoescape=True))
        columns = (FlightRecord.id, FlightRecord.name, FlightRecord.craft_id, FlightRecord.start, FlightRecord.answers)
        with self._database.read() as session:
            total = session.scalar(select(func.count()).select_from(FlightRecord).where(*chosen)) or 0
            rows = session.execute(
                select(*columns, CraftRecord.name, CraftRecord.kind)
                .join(CraftRecord, CraftRecord.id == FlightRecord.craft_id)
                .where(*chosen)
                .order_by(func.coalesce(FlightRecord.start, FlightRecord.added).desc(), FlightRecord.id)
                .limit(limit)
            ).all()
        found = [
            FlightRef(
                id=flight,
                name=name,
                craft=craft_id,
                craft_name=own or kind,
                start_utc=None if start is None else start.isoformat(),
                happened=next((x["word"] for x in answers if x["purpose"] == "Happened"), NOT_DETERMINED),
            )
            for flight, name, craft_id, start, answers, own, kind in rows
        ]
        return found, total

    def flight(self, name: str) -> str | None:
        """Return the id of a flight by that id or its name; None where there is none."""
        if "\0" in name:
            return None
        with self._database.read() as session:
            named = select(FlightRecord.id).where(FlightRecord.owner == self._owner)
            found = session.scalar(named.where(FlightRecord.id == name)) if is_id(name) else None
            return found or session.scalar(named.where(FlightRecord.name == name))

    def crafts(self) -> Sequence[CraftRef]:
        """List the craft."""
        columns = (CraftRecord.id, CraftRecord.name, CraftRecord.kind)  # the reviews of large craft are megabytes
        with self._database.read() as session:
            rows = session.execute(
                select(*columns, func.count(FlightRecord.id))
                .outerjoin(FlightRecord, FlightRecord.craft_id == CraftRecord.id)
                .where(CraftRecord.owner == self._owner)
                .group_by(*columns, CraftRecord.created)
                .order_by(CraftRecord.created)
            ).all()
        return [CraftRef(id=craft, name=name or kind, kind=kind, flights=count) for craft, name, kind, count in rows]

    def report(self, flight: str) -> FlightReport | None:
        """Read the report of a flight."""
        content = self._content(flight)
        try:
            report = None if content is None else parse_report(content)
        except ConfigError:
            return None
        return report if isinstance(report, FlightReport) else None

    def review(self, craft: str) -> CraftReview | None:
        """Read what the flights of a craft say together."""
        with self._database.read() as session:
            found = session.get(CraftRecord, craft) if is_id(craft) else None
            if found is None or found.owner != self._owner or found.review is None:
                return None
            return restored(found.review, CraftReview)

    def compare(self, a: str, b: str) -> Sequence[ParameterChange] | None:
        """Compare the parameters of two flights; None where one is not there."""
        older, newer = self._content(a), self._content(b)
        if older is None or newer is None:
            return None
        found: Sequence[ParameterChange] = self._ask("compare_numbers", older, newer, (a, b))
        return found

    def _of_folder(self, place: str) -> bytes | None:
        if self._folder is None:
            return None
        try:
            return (self._folder / place / "report.json").read_bytes()
        except OSError:
            return None

    def _content(self, flight: str) -> bytes | None:
        """Read the report.json of a flight: of its log's analysis, or in its folder below that of several logs."""
        with self._database.read() as session:
            found = session.get(FlightRecord, flight) if is_id(flight) else None
            if found is None or found.owner != self._owner:
                return None
            if found.analysis_id is None:
                return self._of_folder(found.folder)
            analysis = session.get(AnalysisRecord, found.analysis_id)
            if analysis is None or analysis.results is None:
                return None
            names = (f"flights/{found.folder}/report.json", "report.json")
            name = next((each for each in names if each in analysis.files), None)
            key = f"analyses/{analysis.id}/{analysis.results}/{name}"
        try:
            return None if name is None else self._objects.read(key)
        except FileNotFoundError:
            return None
