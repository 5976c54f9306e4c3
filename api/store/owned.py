"""Lookup of an owner's logs, analyses and craft by id, and lists of them in pages, the newest first."""

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
    """Return the error for a record that does not exist or is another owner's."""
    return ProblemError.missing(_MISSING[kind])


def find(session: Session, kind: type[Owned], record_id: str, owner: str, *, lock: bool = False) -> Owned | None:
    """Look a record up; None if the owner has none of this id."""
    record = session.get(kind, record_id, with_for_update=lock) if is_id(record_id) else None
    return record if record is not None and record.owner == owner else None


def get(session: Session, kind: type[Owned], record_id: str, owner: str, *, lock: bool = False) -> Owned:
    """Look a record up; raises ProblemError if the owner has none of this id."""
    record = find(session, kind, record_id, owner, lock=lock)
    if record is None:
        raise missing(kind)
    return record


def contains_text(text: str, *columns: Text) -> ColumnElement[bool]:
    """Return the condition that one of several columns contains a text, ignoring case."""
    if "\0" in text:  # no text has it, and PostgreSQL refuses it
        return false()
    return or_(*(column.icontains(text, autoescape=True) for column in columns))


def newest(
    session: Session,
    kind: type[Owned],
    query: Select[Any],
    by: InstrumentedAttribute[datetime],
    owner: str,
    limit: int,
    after: str | None,
) -> Iterable[Owned]:
    """Return the newest records of a query, or those after the record `after` if there is such."""
    query = query.where(kind.owner == owner).order_by(by.desc(), kind.id.desc()).limit(limit)
    previous = None if after is None else find(session, kind, after, owner)
    if previous is not None:
        query = query.where(tuple_(by, kind.id) < (getattr(previous, by.key), previous.id))
    return session.scalars(query)
