"""What an owner has: found by its id, and listed part by part, the newest first."""

from collections.abc import Iterable
from datetime import datetime
from typing import Any, TypeAlias, TypeVar

from sqlalchemy import ColumnElement, Select, false, or_, tuple_
from sqlalchemy.orm import InstrumentedAttribute, Session

from api.problems import ProblemError
from api.store.ids import is_id
from api.store.records import AnalysisRecord, CraftRecord, LogRecord

Owned = TypeVar("Owned", LogRecord, AnalysisRecord, CraftRecord)
Text: TypeAlias = InstrumentedAttribute[str] | InstrumentedAttribute[str | None]

_MISSING = {
    LogRecord: "There is no log of this id.",
    AnalysisRecord: "There is no analysis of this id.",
    CraftRecord: "There is no craft, flight or note of this id.",
}


def missing(kind: type[Any]) -> ProblemError:
    """Make the error where there is no such thing, or it is another's."""
    return ProblemError.missing(_MISSING[kind])


def find(session: Session, kind: type[Owned], record_id: str, owner: str, *, lock: bool = False) -> Owned | None:
    """Look something up; None where the owner has none of this id."""
    record = session.get(kind, record_id, with_for_update=lock) if is_id(record_id) else None
    return record if record is not None and record.owner == owner else None


def get(session: Session, kind: type[Owned], record_id: str, owner: str, *, lock: bool = False) -> Owned:
    """Look something up; a problem where the owner has none of this id."""
    record = find(session, kind, record_id, owner, lock=lock)
    if record is None:
        raise missing(kind)
    return record


def holds(text: str, *columns: Text) -> ColumnElement[bool]:
    """Return the condition that one of several texts holds another, in capitals or not."""
    if "\0" in text:  # which no text has, and PostgreSQL does not take
        return false()
    return or_(*(column.icontains(text, autoescape=True) for column in columns))


def listed(
    session: Session,
    kind: type[Owned],
    query: Select[Any],
    by: InstrumentedAttribute[datetime],
    owner: str,
    limit: int,
    after: str | None,
) -> Iterable[Owned]:
    """Return the newest that a query finds, or those after one of this list, which is ignored where there is none."""
    query = query.where(kind.owner == owner).order_by(by.desc(), kind.id.desc()).limit(limit)
    last = None if after is None else find(session, kind, after, owner)
    if last is not None:
        query = query.where(tuple_(by, kind.id) < (getattr(last, by.key), last.id))
    return session.scalars(query)
