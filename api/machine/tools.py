"""What programs and assistants can ask of one owner's flights and craft, of the service or of a folder.

Numbers come with unit, error and provenance, and nothing changes anything. The same questions are asked over HTTP
(`api.routes.questions`) and over MCP (`api.machine.mcp_server`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from fastapi import Query
from sqlalchemy import func, select

from api.machine.answers import (
    NOT_DETERMINED,
    Answers,
    Changes,
    ComparedFlights,
    CraftList,
    CraftRef,
    Events,
    FlightList,
    FlightRef,
    LoopMargins,
    NextFlights,
    Parameters,
    Predictions,
)
from api.store.database import Database
from api.store.ids import is_id
from api.store.records import AnalysisRecord, CraftRecord, FlightRecord
from core.serialization import restored
from pipeline.config import ConfigError
from pipeline.results.drift import CraftReview
from pipeline.results.report import FlightReport
from pipeline.storage.store import Store
from reports.quantities import (
    answers_of,
    craft_parameters,
    health_of,
    margins_of,
    parameters_of,
    predictions_of,
)
from reports.report_json import parse_report

#: Most items of one answer.
MOST = 1000


# Queries of HTTP are fields of pydantic, as which the tools of MCP describe them too.
Flight = Annotated[str, Query(max_length=200, description="Id or name of a flight.")]
CraftName = Annotated[str, Query(max_length=200, description="Id or name of a craft.")]
Part = Annotated[str, Query(max_length=200, description="Part of a flight's name.")]
Most = Annotated[int, Query(ge=1, le=MOST, description="Items at most.")]


class UnknownError(Exception):
    """There is no flight or craft of this id or name."""


class UnclearError(UnknownError):
    """A question does not say of which flight or craft it is."""


@dataclass(frozen=True, slots=True)
class Tools:
    """The questions, asked of what one owner has."""

    database: Database
    objects: Store
    owner: str
    ask: Callable[..., Any]  #: Answers functions of `api.machine.questions`.
    folder: Path | None = None  #: What `rotorid analyze` wrote, whose flights are shown.
    refresh: Callable[[], None] = lambda: None  #: Brings what is new in that folder.

    def list_flights(self, craft: CraftName = "", text: Part = "", limit: Most = 100) -> FlightList:
        """List flights, the newest first: id, name, craft, take-off (UTC), and what happened in them."""
        self.refresh()
        chosen = [FlightRecord.owner == self.owner]
        if craft:
            chosen.append(FlightRecord.craft_id == self._craft(craft))
        if text:
            chosen.append(FlightRecord.name.icontains(text.replace("\0", ""), autoescape=True))
        columns = (FlightRecord.id, FlightRecord.name, FlightRecord.craft_id, FlightRecord.start, FlightRecord.answers)
        with self.database.read() as session:
            total = session.scalar(select(func.count()).select_from(FlightRecord).where(*chosen)) or 0
            rows = session.execute(
                select(*columns, CraftRecord.name, CraftRecord.kind)
                .join(CraftRecord, CraftRecord.id == FlightRecord.craft_id)
                .where(*chosen)
                .order_by(func.coalesce(FlightRecord.start, FlightRecord.added).desc(), FlightRecord.id)
                .limit(min(max(limit, 1), MOST))
            ).all()
        flights = [
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
        return FlightList(flights, total)

    def list_craft(self) -> CraftList:
        """List craft: id, name, kind, and how many flights each has."""
        self.refresh()
        return CraftList(self._crafts())

    def get_answers(self, flight: Flight) -> Answers:
        """Get the first screen of a flight: what happened, the state of the craft, loops, parameters, models."""
        return Answers(answers_of(self._report(flight)))

    def get_parameters(self, flight: Flight = "", craft: CraftName = "") -> Parameters:
        """Get physical parameters by every method: of one flight, or of a craft over its flights (name one of both)."""
        if flight:
            return Parameters(parameters_of(self._report(flight)))
        if not craft:
            raise UnclearError("name a flight or a craft")
        return Parameters(craft_parameters(self._review(craft)))

    def get_margins(self, flight: Flight) -> LoopMargins:
        """Get gain and phase margins, crossover, disturbance rejection and peaks of each axis, and bandwidths."""
        return LoopMargins(margins_of(self._report(flight)))

    def get_health(self, flight: Flight) -> Events:
        """Get what happened in a flight, when (s on the log's boot clock), how grave it was, and what to do."""
        return Events(health_of(self._report(flight)))

    def get_predictions(self, flight: Flight) -> Predictions:
        """Get how far ahead each model of a flight predicts (s), and its RMS error there (m) on held-out time."""
        return Predictions(predictions_of(self._report(flight)))

    def get_changes(self, craft: CraftName) -> Changes:
        """Get what changes over the flights of a craft: slopes and steps of each parameter, motors, what is strange."""
        review = self._review(craft)
        drift = review.drift
        return Changes(
            flights=review.flights,
            pooled=review.pooled,
            changes=[]
            if drift is None
            else [parameter for parameter in drift.parameters if parameter.change is not None],
            motors=NOT_DETERMINED if drift is None or drift.motors is None else drift.motors.sentence,
            since=review.since,
            alerts=review.alerts,
            remarks=review.remarks,
        )

    def compare(self, before: Flight, after: Flight) -> ComparedFlights:
        """Compare the parameters of two flights: values, difference with its error, and the chance of it (p)."""
        flights = (self._flight(before), self._flight(after))
        older, newer = (self._content(flight) for flight in flights)
        if older is None or newer is None:
            raise UnknownError(f"{before} and {after} cannot be compared")
        return ComparedFlights(self.ask("compare_numbers", older, newer, flights) or NOT_DETERMINED)

    def what_to_fly(self, flight: Flight) -> NextFlights:
        """Get what to log and fly next time, the most useful first: what a flight lacked, what it would bring."""
        return NextFlights(sorted(self._report(flight).advice, key=lambda advice: advice.rank))

    def _crafts(self) -> Sequence[CraftRef]:
        columns = (CraftRecord.id, CraftRecord.name, CraftRecord.kind)  # the reviews of large craft are megabytes
        with self.database.read() as session:
            rows = session.execute(
                select(*columns, func.count(FlightRecord.id))
                .outerjoin(FlightRecord, FlightRecord.craft_id == CraftRecord.id)
                .where(CraftRecord.owner == self.owner)
                .group_by(*columns, CraftRecord.created)
                .order_by(CraftRecord.created)
            ).all()
        return [CraftRef(id=craft, name=name or kind, kind=kind, flights=count) for craft, name, kind, count in rows]

    def _craft(self, name: str) -> str:
        """Find a craft by its id or its name, which must not mean several."""
        self.refresh()
        crafts = self._crafts()
        matches = [craft.id for craft in crafts if name == craft.id] or [
            craft.id for craft in crafts if name == craft.name
        ]
        if len(matches) > 1:
            raise UnclearError(f"several craft are called {name!r}; see list_craft")
        if not matches:
            raise UnknownError(f"no craft is called {name!r}; see list_craft")
        return matches[0]

    def _review(self, craft: str) -> CraftReview:
        """Read what the flights of a craft say together."""
        craft_id = self._craft(craft)
        with self.database.read() as session:
            craft_review = session.scalar(select(CraftRecord.review).where(CraftRecord.id == craft_id))
        if craft_review is None:
            raise UnknownError(f"{craft} has not been looked at yet")
        return restored(craft_review, CraftReview)

    def _flight(self, name: str) -> str:
        """Find a flight by its id or its name."""
        self.refresh()
        mine = select(FlightRecord.id).where(FlightRecord.owner == self.owner)
        with self.database.read() as session:
            flight_id = session.scalar(mine.where(FlightRecord.id == name)) if is_id(name) else None
            if flight_id is None and "\0" not in name:  # which PostgreSQL does not take
                flight_id = session.scalar(mine.where(FlightRecord.name == name))
        if flight_id is None:
            raise UnknownError(f"there is no flight {name!r}; list_flights tells which there are")
        return flight_id

    def _report(self, flight: str) -> FlightReport:
        content = self._content(self._flight(flight))
        try:
            report = None if content is None else parse_report(content)
        except ConfigError:
            report = None
        if not isinstance(report, FlightReport):
            raise UnknownError(f"{flight} has no report of this version; analyse its log again")
        return report

    def _content(self, flight: str) -> bytes | None:
        """Read the report.json of a flight: of its log's analysis, or in its folder below that of several logs."""
        with self.database.read() as session:
            record = session.get_one(FlightRecord, flight)
            analysis = None if record.analysis_id is None else session.get(AnalysisRecord, record.analysis_id)
        try:
            if record.analysis_id is None:
                return None if self.folder is None else (self.folder / record.folder / "report.json").read_bytes()
            names = (f"flights/{record.folder}/report.json", "report.json")
            name = next((name for name in names if analysis is not None and name in analysis.files), None)
            if analysis is None or analysis.results is None or name is None:
                return None
            return self.objects.read(f"analyses/{analysis.id}/{analysis.results}/{name}")
        except FileNotFoundError:  # deleted at this moment
            return None


#: The questions, with the address and the summary of each over HTTP.
QUESTIONS: dict[Callable[..., object], tuple[str, str]] = {
    Tools.list_flights: ("/flights", "List flights"),
    Tools.list_craft: ("/craft", "List craft"),
    Tools.get_answers: ("/answers", "The first screen of a flight"),
    Tools.get_parameters: ("/parameters", "Physical parameters"),
    Tools.get_margins: ("/margins", "Margins of the loops"),
    Tools.get_health: ("/health", "What happened in a flight"),
    Tools.get_predictions: ("/predictions", "How far ahead models predict"),
    Tools.get_changes: ("/changes", "What changes over the flights of a craft"),
    Tools.compare: ("/comparison", "Compare two flights"),
    Tools.what_to_fly: ("/advice", "What to fly next"),
}
