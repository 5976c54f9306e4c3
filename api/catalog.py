"""What the service has: logs and analyses, each its owner's, found, listed, added and removed.

Bytes are kept before the row that names them and removed after it, so that a row never promises what is not there;
bytes without a row are swept up by `api.housekeeping`.
"""

from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from typing import Any, NamedTuple

from sqlalchemy import delete, func, select, tuple_
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from api import queue
from api.database import Database
from api.ids import digest, is_id, new_id, new_secret
from api.incoming import Upload
from api.objects import Objects
from api.problems import Problem
from api.records import AnalysedLog, AnalysisRecord, LogRecord
from api.resources import Analysis, Log, State


class Kept(NamedTuple):
    """A log that was uploaded; `delete_token` is None where the same bytes had been uploaded before."""

    log: Log
    delete_token: str | None


class Catalog:
    """Logs and analyses.

    Parameters
    ----------
    database : Database
    objects : Objects
    """

    def __init__(self, database: Database, objects: Objects) -> None:
        self._database = database
        self._objects = objects

    def keep_log(self, upload: Upload, name: str, owner: str) -> Kept:
        """Keep a log that has fully arrived; the same bytes of the same owner are the same log."""
        if (known := self._same_log(upload, owner)) is not None:
            return Kept(known, None)
        secret = new_secret()
        record = LogRecord(
            id=new_id(),
            owner=owner,
            name=name,
            size=upload.size,
            sha256=upload.sha256,
            received=datetime.now(UTC),
            delete_digest=digest(secret),
        )
        upload.sync()
        self._objects.put(upload.path, f"logs/{record.id}")
        try:
            with self._database.write() as session:
                session.add(record)
        except IntegrityError:  # the same log came twice at the same time
            self._objects.remove(f"logs/{record.id}")
            if (known := self._same_log(upload, owner)) is None:
                raise
            return Kept(known, None)
        return Kept(_log(record), secret)

    def _same_log(self, upload: Upload, owner: str) -> Log | None:
        with self._database.read() as session:
            found = session.scalar(select(LogRecord).where(LogRecord.owner == owner, LogRecord.sha256 == upload.sha256))
            return None if found is None else _log(found)

    def find_log(self, log_id: str, owner: str) -> Log | None:
        """Look a log up; None when the owner has none of this id."""
        with self._database.read() as session:
            found = session.get(LogRecord, log_id) if is_id(log_id) else None
            return _log(found) if found is not None and found.owner == owner else None

    def count_logs(self, owner: str) -> int:
        """Count the logs of an owner."""
        with self._database.read() as session:
            return session.scalar(select(func.count()).where(LogRecord.owner == owner)) or 0

    def list_logs(self, owner: str, *, limit: int, after: str | None = None, name: str = "") -> list[Log]:
        """List the newest logs, or those after a log of this list, whose names contain `name`."""
        with self._database.read() as session:
            query = select(LogRecord).where(LogRecord.owner == owner)
            if name:
                query = query.where(LogRecord.name.icontains(name, autoescape=True))
            query = query.order_by(LogRecord.received.desc(), LogRecord.id.desc()).limit(limit)
            if after is not None and (last := session.get(LogRecord, after)) is not None:
                query = query.where(tuple_(LogRecord.received, LogRecord.id) < (last.received, last.id))
            return [_log(record) for record in session.scalars(query)]

    def may_delete_log(self, log_id: str, secret: str) -> str | None:
        """Give the owner of the log that a delete token is for; None when it is for another or none."""
        with self._database.read() as session:
            found = session.get(LogRecord, log_id) if is_id(log_id) else None
            return found.owner if found is not None and found.delete_digest == digest(secret) else None

    def delete_log(self, log_id: str, owner: str) -> bool:
        """Remove a log and every analysis of it; False when the owner has none of this id."""
        with self._database.write() as session:
            found = session.get(LogRecord, log_id) if is_id(log_id) else None
            if found is None or found.owner != owner:
                return False
            analyses = list(session.scalars(select(AnalysedLog.analysis_id).where(AnalysedLog.log_id == log_id)))
            session.execute(delete(AnalysedLog).where(AnalysedLog.analysis_id.in_(analyses)))
            session.execute(delete(AnalysisRecord).where(AnalysisRecord.id.in_(analyses)))
            session.delete(found)
        self._objects.remove(f"logs/{log_id}")
        for analysis in analyses:
            self._objects.remove(f"analyses/{analysis}")
        return True

    def order(self, log_ids: Sequence[str], configuration: Mapping[str, Any], owner: str) -> Analysis:
        """Put an analysis of one or several logs of the owner's into the queue; KeyError names a log there is not."""
        with self._database.write() as session:
            logs = []
            for log_id in dict.fromkeys(log_ids):
                log = session.get(LogRecord, log_id) if is_id(log_id) else None
                if log is None or log.owner != owner:
                    raise KeyError(log_id)
                logs.append(log)
            record = AnalysisRecord(
                id=new_id(),
                owner=owner,
                configuration=dict(configuration),
                state=State.QUEUED,
                created=datetime.now(UTC),
                stage="",
                progress=0.0,
                attempts=0,
                deaths=0,
                files={},
                members=[AnalysedLog(position=position, log=log) for position, log in enumerate(logs)],
            )
            session.add(record)
            session.flush()
            return _analysis(record)

    def find_analysis(self, analysis_id: str, owner: str | None) -> Analysis | None:
        """Look an analysis up; None when the owner (anybody, when None) has none of this id."""
        with self._database.read() as session:
            found = session.get(AnalysisRecord, analysis_id) if is_id(analysis_id) else None
            return None if found is None or owner not in (None, found.owner) else _analysis(found)

    def list_analyses(
        self,
        owner: str,
        *,
        limit: int,
        after: str | None = None,
        state: State | None = None,
        log: str | None = None,
    ) -> list[Analysis]:
        """List the newest analyses, or those after one of this list, of a state or of a log."""
        with self._database.read() as session:
            query = select(AnalysisRecord).where(AnalysisRecord.owner == owner)
            if state is not None:
                query = query.where(AnalysisRecord.state == state)
            if log is not None:
                query = query.where(AnalysisRecord.members.any(AnalysedLog.log_id == log))
            query = query.order_by(AnalysisRecord.created.desc(), AnalysisRecord.id.desc()).limit(limit)
            if after is not None and (last := session.get(AnalysisRecord, after)) is not None:
                query = query.where(tuple_(AnalysisRecord.created, AnalysisRecord.id) < (last.created, last.id))
            return [_analysis(record) for record in session.scalars(query)]

    def cancel(self, analysis_id: str, owner: str) -> Analysis | None:
        """End an analysis that has not ended; None when the owner has none of this id."""
        with self._database.write() as session:
            found = _owned(session, analysis_id, owner)
            if found is None:
                return None
            queue.cancel(session, analysis_id)
            session.refresh(found)
            return _analysis(found)

    def delete_analysis(self, analysis_id: str, owner: str) -> bool:
        """Remove an analysis and its results; False when the owner has none of this id."""
        with self._database.write() as session:
            found = _owned(session, analysis_id, owner)
            if found is None:
                return False
            session.delete(found)
        self._objects.remove(f"analyses/{analysis_id}")
        return True

    def object_of(self, analysis: Analysis, name: str) -> str | None:
        """Give the key of a file of an analysis; None when it has none of this name."""
        with self._database.read() as session:
            found = session.get(AnalysisRecord, analysis.id)
            if found is None or found.results is None or name not in found.files:
                return None
            return f"analyses/{found.id}/{found.results}/{name}"


def _owned(session: Session, analysis_id: str, owner: str) -> AnalysisRecord | None:
    found = session.get(AnalysisRecord, analysis_id) if is_id(analysis_id) else None
    return found if found is not None and found.owner == owner else None


def _log(record: LogRecord) -> Log:
    return Log(id=record.id, name=record.name, size=record.size, sha256=record.sha256, received=record.received)


def _analysis(record: AnalysisRecord) -> Analysis:
    return Analysis(
        id=record.id,
        logs=[_log(member.log) for member in record.members],
        configuration=record.configuration,
        state=State(record.state),
        stage=record.stage,
        progress=record.progress,
        attempts=record.attempts,
        created=record.created,
        started=record.started,
        ended=record.ended,
        problem=None if record.problem is None else Problem.model_validate(record.problem),
        files=record.files,
    )
