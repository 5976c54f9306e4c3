"""How flights come to their craft: at the end of an analysis, in the very transaction that ends it.

A flight that is there already stays with its craft, where its owner may have put it. A new one goes to the craft that
its fingerprint (`pipeline.flight.craft.fingerprint`: board id, frame, parameters) leads to, or makes a new one.
"""

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime
from itertools import count

from sqlalchemy import delete, func, select, update
from sqlalchemy.orm import Session

from api.store.ids import digest, new_id
from api.store.records import AlertRecord, AnalysisRecord, CraftKeyRecord, CraftRecord, FlightRecord, NoteRecord
from api.work.outcome import Flown, without_experiments
from core.serialization import plain
from pipeline.flight.craft import took_off
from pipeline.results.fleet import FlightEntry

#: Settings that touch what the flights of a craft are compared by: such an analysis replaces no other.
_OTHER = ("rate", "training_fraction")


def register(session: Session, analysis: AnalysisRecord, flown: Sequence[Flown]) -> None:
    """Assign the flights of an analysis that is done to their craft."""
    odd = any(name in analysis.configuration for name in _OTHER)
    logs = {member.log.sha256: member.log_id for member in analysis.members}
    for flight in without_experiments(flown) if odd else flown:
        log_id = logs.get(flight.entry.sha256)
        if log_id is None:  # of a packed log the flight has the digest of what was in it
            log_id = analysis.members[0].log_id if len(analysis.members) == 1 else None
        if log_id is not None:
            place = (log_id, analysis.id, flight.entry.folder)
            keep(session, analysis.owner, log_id, flight, place, replace=not odd)


def joined(session: Session, analysis: AnalysisRecord) -> None:
    """Note that the joint models of a craft are made; they may be of flights that are gone meanwhile."""
    craft = session.get(CraftRecord, analysis.craft_id)
    if craft is None:
        return
    wanted = analysis.configuration.get("flights", [])
    there = set(session.scalars(select(FlightRecord.id).where(FlightRecord.craft_id == craft.id)))
    craft.joint_of = wanted if there.issuperset(wanted) else []
    craft.joint_lost = "" if craft.joint_of else "a flight of them was moved or deleted meanwhile"
    session.flush()
    touch(session, [craft.id])


def keep(
    session: Session,
    owner: str,
    source: str,
    flown: Flown,
    place: tuple[str | None, str | None, str],
    *,
    replace: bool = True,
) -> FlightRecord:
    """Keep one flight."""
    entry, now = flown.entry, datetime.now(UTC)
    same = (FlightRecord.owner == owner, FlightRecord.source == source, FlightRecord.number == entry.number)
    record = session.scalar(select(FlightRecord).where(*same))
    if record is not None and not replace:
        return record
    craft_id = _craft_of(session, owner, entry) if record is None else record.craft_id
    if record is None:
        name = _free_name(session, owner, entry.name)
        record = FlightRecord(
            id=new_id(), owner=owner, craft_id=craft_id, source=source, number=entry.number, name=name, added=now
        )
        session.add(record)
    record.log_id, record.analysis_id, record.folder = place
    start = took_off(entry)
    record.start = None if start is None else start.astimezone(UTC)
    record.entry = plain(entry)
    record.answers = plain(flown.answers)
    record.trust = str(flown.trust)
    session.flush()
    touch(session, [craft_id])
    return record


def touch(session: Session, crafts: Iterable[str]) -> None:
    """Note that something about craft has changed; one that has nothing left is gone."""
    for craft_id in sorted(set(crafts)):
        session.execute(
            update(CraftRecord)
            .where(CraftRecord.id == craft_id)
            .values(revision=CraftRecord.revision + 1, changed=datetime.now(UTC))
        )
        craft = session.get(CraftRecord, craft_id, populate_existing=True)
        if craft is None or craft.name or _has(session, FlightRecord, craft_id) or _has(session, NoteRecord, craft_id):
            continue
        session.execute(delete(AlertRecord).where(AlertRecord.craft_id == craft_id))
        session.execute(delete(CraftKeyRecord).where(CraftKeyRecord.craft_id == craft_id))
        session.execute(delete(CraftRecord).where(CraftRecord.id == craft_id))


def forget(session: Session, flights: Sequence[FlightRecord], why: str) -> None:
    """Remove flights from their craft; joint models that held one of them do not hold any more."""
    crafts = {flight.craft_id for flight in flights}
    for flight in flights:
        lose(session, flight, why)
        session.delete(flight)
    session.flush()
    touch(session, crafts)


def lose(session: Session, flight: FlightRecord, why: str) -> None:
    """Note that joint models of a craft hold a flight that is not its any more."""
    craft = session.get(CraftRecord, flight.craft_id)
    if craft is not None and flight.id in craft.joint_of:
        craft.joint_of = []
        craft.joint_lost = f"they held {flight.name}, which {why}"[:300]


def _has(session: Session, kind: type[FlightRecord] | type[NoteRecord], craft_id: str) -> bool:
    return bool(session.scalar(select(func.count()).select_from(kind).where(kind.craft_id == craft_id)))


def _craft_of(session: Session, owner: str, entry: FlightEntry) -> str:
    """Find the craft that a flight's fingerprint leads to, or make one."""
    key = digest(entry.craft)
    known = session.get(CraftKeyRecord, (owner, key))
    if known is not None:
        return known.craft_id
    craft = new_craft(session, owner, entry.craft_name)
    session.add(CraftKeyRecord(owner=owner, digest=key, craft_id=craft.id))
    session.flush()
    return craft.id


def new_craft(session: Session, owner: str, kind: str) -> CraftRecord:
    """Make a craft without flights."""
    now = datetime.now(UTC)
    craft = CraftRecord(id=new_id(), owner=owner, kind=kind[:200], created=now, changed=now, joint_of=[], name="")
    session.add(craft)
    session.flush()
    return craft


def _free_name(session: Session, owner: str, name: str) -> str:
    """Return a flight's name, with a number where another flight of the owner has it."""
    base = name[:180]
    taken = set(
        session.scalars(
            select(FlightRecord.name).where(
                FlightRecord.owner == owner, FlightRecord.name.startswith(base, autoescape=True)
            )
        )
    )
    return base if base not in taken else next(numbered for k in count(2) if (numbered := f"{base} ({k})") not in taken)
