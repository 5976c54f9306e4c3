"""The craft of an owner: found, listed, named, and put right where a fingerprint led a flight astray."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from http import HTTPStatus
from typing import Any

from sqlalchemy import delete, func, or_, select, tuple_, update
from sqlalchemy.orm import Session

from api.problems import Problem, ProblemError
from api.store.database import Database
from api.store.ids import digest, is_id, new_id
from api.store.owned import contains_text, find, get, missing, newest
from api.store.records import (
    AlertRecord,
    AnalysisRecord,
    CraftKeyRecord,
    CraftRecord,
    FlightRecord,
    LogRecord,
    NoteRecord,
)
from api.store.resources import CraftAnswer, CraftFlight, CraftSummary, JointFit, Note, RaisedAlert, State
from api.work.craft_flights import lose, new_craft, touch

#: Joint models are made anew when a craft has this many times the flights that they are of: what refits cost together
#: stays a multiple of the last one.
GROWTH = 1.5

#: Alerts younger than this are counted.
_RECENT = timedelta(days=30)

#: Most notes of one craft.
_NOTES = 1000


class Crafts:
    """The craft of all owners."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def list(self, owner: str, *, limit: int, after: str | None = None, text: str = "") -> list[CraftSummary]:
        """List craft, those that changed last first."""
        with self._database.read() as session:
            query = select(CraftRecord)
            if text:
                query = query.where(contains_text(text, CraftRecord.name, CraftRecord.kind))
            records = newest(session, CraftRecord, query, CraftRecord.changed, owner, limit, after)
            return [_craft(session, record) for record in records]

    def find(self, craft_id: str, owner: str) -> CraftAnswer:
        """Look a craft up with all that is known of it but for its flights; ProblemError if the owner has none."""
        with self._database.read() as session:
            record = get(session, CraftRecord, craft_id, owner)
            notes = session.scalars(select(NoteRecord).where(NoteRecord.craft_id == record.id).order_by(NoteRecord.at))
            newest = (
                select(AlertRecord)
                .where(AlertRecord.craft_id == record.id)
                .order_by(AlertRecord.created.desc(), AlertRecord.id)
            )
            return CraftAnswer(
                **dict(_craft(session, record)),
                notes=[Note.model_validate(note) for note in notes],
                joint=joint_of(session, record),
                review=record.review,
                recent=[_alert(alert, record) for alert in session.scalars(newest.limit(20))],
            )

    def flights(self, craft_id: str, owner: str) -> Sequence[CraftFlight]:
        """List the flights of a craft, the newest first."""
        with self._database.read() as session:
            get(session, CraftRecord, craft_id, owner)
            rows = session.scalars(select(FlightRecord).where(FlightRecord.craft_id == craft_id))
            flights = [CraftFlight.model_validate(row) for row in rows]
        return sorted(flights, key=lambda flight: (flight.start or flight.added, flight.name), reverse=True)

    def of_analysis(self, analysis_id: str) -> Sequence[tuple[str, str]]:
        """List the craft whose flights an analysis has, or that it fits jointly: id and name."""
        mine = FlightRecord.analysis_id == analysis_id
        flown = select(FlightRecord.craft_id).where(mine)
        joint = select(AnalysisRecord.craft_id).where(AnalysisRecord.id == analysis_id)
        with self._database.read() as session:
            chosen = select(CraftRecord).where(or_(CraftRecord.id.in_(flown), CraftRecord.id.in_(joint)))
            return [(record.id, record.name or record.kind) for record in session.scalars(chosen)]

    def log_before(self, log_id: str, owner: str) -> tuple[str, str] | None:
        """Return id and name of the log of a craft's flight before that of a log; None where none is known."""
        mine = select(FlightRecord).where(FlightRecord.owner == owner, FlightRecord.log_id == log_id)
        with self._database.read() as session:
            flight = session.scalars(mine.order_by(FlightRecord.start)).first()
            if flight is None or flight.start is None:
                return None
            row = session.execute(
                select(LogRecord.id, LogRecord.name)
                .join(FlightRecord, FlightRecord.log_id == LogRecord.id)
                .where(FlightRecord.craft_id == flight.craft_id, FlightRecord.start < flight.start)
                .order_by(FlightRecord.start.desc())
                .limit(1)
            ).first()
            return None if row is None else (row[0], row[1])

    def folder_of(self, flight_id: str, owner: str) -> str | None:
        """Return where a flight of no upload is in its folder; None where the owner has no such flight."""
        with self._database.read() as session:
            record = session.get(FlightRecord, flight_id) if is_id(flight_id) else None
            return record.folder if record is not None and record.owner == owner and record.log_id is None else None

    def entries(self, craft_id: str) -> tuple[Sequence[dict[str, Any]], Sequence[dict[str, Any]]]:
        """Return the entries of a craft's flights in the order in which they came, and its notes, for a review."""
        with self._database.read() as session:
            rows = session.scalars(
                select(FlightRecord).where(FlightRecord.craft_id == craft_id).order_by(FlightRecord.added)
            )
            flights = [{**row.entry, "name": row.name} for row in rows]
            notes = session.scalars(select(NoteRecord).where(NoteRecord.craft_id == craft_id))
            return flights, [
                {"at": note.at.isoformat(), "text": note.text, "boundary": note.boundary} for note in notes
            ]

    def rename(self, craft_id: str, owner: str, name: str) -> None:
        """Call a craft by a name; runs of white space become one blank."""
        with self._database.write() as session:
            get(session, CraftRecord, craft_id, owner).name = _plain(" ".join(name.split()))

    def merge(self, craft_id: str, other_id: str, owner: str) -> None:
        """Merge another craft into this one; ProblemError if the owner has not both, or they are one."""
        with self._database.write() as session:
            craft, other = (get(session, CraftRecord, record_id, owner) for record_id in (craft_id, other_id))
            if craft is other:
                raise missing(CraftRecord)
            known = select(AlertRecord.about).where(AlertRecord.craft_id == craft.id)
            session.execute(delete(AlertRecord).where(AlertRecord.craft_id == other.id, AlertRecord.about.in_(known)))
            for kind in (FlightRecord, NoteRecord, AlertRecord, CraftKeyRecord):
                session.execute(update(kind).where(kind.craft_id == other.id).values(craft_id=craft.id))
            session.execute(update(AnalysisRecord).where(AnalysisRecord.craft_id == other.id).values(craft_id=None))
            craft.name = craft.name or other.name
            session.flush()
            session.execute(delete(CraftRecord).where(CraftRecord.id == other.id))
            touch(session, [craft.id])

    def move(self, flights: Sequence[str], target: str | None, owner: str, *, later: bool = False) -> str:
        """Move flights to a craft, or to a new one, and return its id; ProblemError if not all are the owner's."""
        with self._database.write() as session:
            records = [
                record
                for record in (session.get(FlightRecord, one) for one in dict.fromkeys(flights) if is_id(one))
                if record is not None and record.owner == owner
            ]
            if not records or len(records) < len(set(flights)):
                raise missing(CraftRecord)
            if target is None:
                craft = new_craft(session, owner, records[0].entry["craft_name"])
            else:
                craft = get(session, CraftRecord, target, owner)
            touched = {record.craft_id for record in records} | {craft.id}
            for record in records:
                if record.craft_id != craft.id:
                    lose(session, record, "was moved to another craft")
                    record.craft_id = craft.id
            if later:
                keys = {digest(record.entry["craft"]) for record in records}
                session.execute(
                    update(CraftKeyRecord)
                    .where(CraftKeyRecord.owner == owner, CraftKeyRecord.digest.in_(keys))
                    .values(craft_id=craft.id)
                )
            session.flush()
            touch(session, touched)
            return craft.id

    def add_note(self, craft_id: str, owner: str, text: str, at: datetime | None, *, boundary: bool) -> Note:
        """Write down what was done to a craft."""
        with self._database.write() as session:
            record = get(session, CraftRecord, craft_id, owner)
            count = session.scalar(select(func.count()).where(NoteRecord.craft_id == record.id)) or 0
            if count >= _NOTES:
                detail = f"A craft has {_NOTES} notes at most. Remove some, then try again."
                raise ProblemError.of("too-many-notes", detail)
            now = datetime.now(UTC)
            when, text = now if at is None else _in_utc(at), _plain(text)
            note = NoteRecord(id=new_id(), craft_id=record.id, at=when, text=text, boundary=boundary, created=now)
            session.add(note)
            session.flush()
            touch(session, [record.id])
            return Note.model_validate(note)

    def remove_note(self, craft_id: str, note_id: str, owner: str) -> None:
        """Remove a note."""
        with self._database.write() as session:
            get(session, CraftRecord, craft_id, owner)
            note = session.get(NoteRecord, note_id) if is_id(note_id) else None
            if note is None or note.craft_id != craft_id:
                raise missing(CraftRecord)
            session.delete(note)
            session.flush()
            touch(session, [craft_id])

    def alerts(self, owner: str, *, limit: int, after: str | None = None) -> Sequence[RaisedAlert]:
        """List the alerts of an owner, the newest first."""
        with self._database.read() as session:
            query = (
                select(AlertRecord, CraftRecord)
                .join(CraftRecord, CraftRecord.id == AlertRecord.craft_id)
                .where(CraftRecord.owner == owner)
                .order_by(AlertRecord.created.desc(), AlertRecord.id.desc())
                .limit(limit)
            )
            last = session.get(AlertRecord, after) if after is not None and is_id(after) else None
            if last is not None and find(session, CraftRecord, last.craft_id, owner) is not None:
                query = query.where(tuple_(AlertRecord.created, AlertRecord.id) < (last.created, last.id))
            return [_alert(alert, craft) for alert, craft in session.execute(query)]


def _plain(text: str) -> str:
    """Return a text without control characters, which command terminals and which PostgreSQL does not all keep."""
    return "".join(character for character in text if character.isprintable() or character in " \n\t")


def _in_utc(at: datetime) -> datetime:
    try:
        return at.replace(tzinfo=UTC) if at.tzinfo is None else at.astimezone(UTC)
    except OverflowError:  # in the first or last hours of the calendar
        detail = "There is no such time in UTC."
        raise ProblemError(Problem.of_status(HTTPStatus.UNPROCESSABLE_ENTITY, detail)) from None


def joint_of(session: Session, craft: CraftRecord) -> JointFit:
    """Describe the joint models of a craft."""
    ordered = session.scalars(
        select(AnalysisRecord)
        .where(AnalysisRecord.craft_id == craft.id, AnalysisRecord.owner == craft.owner)
        .order_by(AnalysisRecord.created.desc(), AnalysisRecord.id)
        .limit(50)
    ).all()
    done = next((record for record in ordered if record.state == State.DONE), None)
    names = session.scalars(
        select(FlightRecord.name).where(FlightRecord.id.in_(craft.joint_of)).order_by(FlightRecord.name)
    )
    return JointFit(
        analysis=done.id if done is not None and craft.joint_of else None,
        flights=list(names),
        waiting=next((record.id for record in ordered if not State(record.state).ended), None),
        lost=craft.joint_lost,
        next_at=next_fit(len(craft.joint_of)),
    )


def next_fit(count: int) -> int:
    """Return the number of flights with which joint models of `count` flights are made anew."""
    return max(2, count + 1, int(-(-count * GROWTH // 1)))


def _craft(session: Session, record: CraftRecord) -> CraftSummary:
    count, first, last = session.execute(
        select(func.count(), func.min(FlightRecord.start), func.max(FlightRecord.start)).where(
            FlightRecord.craft_id == record.id
        )
    ).one()
    newest = session.scalar(
        select(FlightRecord.answers)
        .where(FlightRecord.craft_id == record.id)
        .order_by(func.coalesce(FlightRecord.start, FlightRecord.added).desc())
        .limit(1)
    )
    health = next((line for line in newest or [] if line["purpose"] == "Happened"), None)
    since = datetime.now(UTC) - _RECENT
    alerts = session.scalar(select(func.count()).where(AlertRecord.craft_id == record.id, AlertRecord.created > since))
    here = f"/api/v1/crafts/{record.id}"
    return CraftSummary(
        id=record.id,
        name=record.name or record.kind,
        kind=record.kind,
        flights=count,
        first=first,
        last=last,
        health=None if health is None else health["word"],
        tone=None if health is None else health["tone"],
        alerts=alerts or 0,
        changed=record.changed,
        current=record.reviewed >= record.revision,
        links={"self": here, "page": f"/crafts/{record.id}", "flights": f"{here}/flights", "model": f"{here}/model"},
    )


def _alert(record: AlertRecord, craft: CraftRecord) -> RaisedAlert:
    facts = {name: getattr(record, name) for name in ("id", "kind", "severity", "text", "flight", "created")}
    return RaisedAlert(craft=craft.id, name=craft.name or craft.kind, **facts)
