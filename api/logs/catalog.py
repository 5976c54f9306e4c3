"""What the service has: logs and analyses, each its owner's, found, listed, added and removed.

Bytes are kept before the row that names them and removed after it, so that a row never promises what is not there;
bytes without a row are swept up by `api.logs.housekeeping`.
"""

import asyncio
from collections.abc import AsyncIterator, Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any, NamedTuple

from fastapi.concurrency import run_in_threadpool
from sqlalchemy import delete, func, or_, select
from sqlalchemy.exc import IntegrityError, OperationalError
from sqlalchemy.orm import Session

from api.problems import ProblemError
from api.store.database import Database
from api.store.ids import digest, is_id, new_id, new_secret
from api.store.owned import contains_text, find, get, missing, newest
from api.store.records import AnalysedLog, AnalysisRecord, CraftRecord, FlightRecord, LogRecord
from api.store.resources import Analysis, Log, State
from api.store.scratch import Upload
from api.work import queue
from api.work.craft_flights import forget
from core.quantity import size
from pipeline.storage.store import Store


class AcceptedLog(NamedTuple):
    """A log that was uploaded; `delete_token` is None where the same bytes had been uploaded before."""

    log: Log
    delete_token: str | None


class Quota(NamedTuple):
    """What one owner may have; 0 is any number."""

    logs: int = 0
    stored: int = 0  #: Bytes of logs.
    unfinished: int = 0  #: Analyses that wait or run.

    def check_logs(self, count: int, more: int = 0) -> None:
        """Refuse more logs than one may have."""
        if 0 < self.logs < count + more:
            detail = f"You have the {self.logs} logs that this service keeps for one user. Delete one, then try again."
            raise ProblemError.of("too-many-logs", detail)

    def check_bytes(self, stored: int) -> None:
        """Refuse more bytes of logs than one may have."""
        if 0 < self.stored < stored:
            detail = f"Your logs would have more than the {size(self.stored)} that this service keeps for one user."
            raise ProblemError.of("too-many-bytes", f"{detail} Delete some, then try again.")

    def check_order(self, unfinished: int) -> None:
        """Refuse another analysis where as many as one may have wait or run."""
        if 0 < self.unfinished <= unfinished:
            detail = (
                f"You have the {self.unfinished} analyses waiting or running that this service takes from one user."
            )
            raise ProblemError.of("too-many-analyses", f"{detail} Try again later.", {"Retry-After": "60"})


#: How often logs are kept anew when somebody else keeps or deletes the same ones at the same time.
_TRIES = 5


class Catalog:
    """Logs and analyses."""

    def __init__(self, database: Database, objects: Store, quota: Quota | None = None) -> None:
        self._quota = quota or Quota()
        self._database = database
        self._objects = objects

    def check_room(self, owner: str) -> None:
        """Refuse another log where the owner has as many as one may have."""
        self._quota.check_logs(self.count_logs(owner), more=1)

    def keep_logs(self, arrived: Sequence[tuple[Upload, str]], owner: str) -> list[AcceptedLog]:
        """Keep logs that have fully arrived, with their names: all or none.

        The same bytes of the same owner are the same log.
        """
        placed: dict[str, str] = {}
        try:
            for _ in range(_TRIES):
                kept = self._keep(arrived, owner, placed)
                if kept is not None:
                    break
            else:
                detail = "The same log is being uploaded or deleted by others at this moment. Try again."
                raise ProblemError.of("conflict", detail)
        except (OSError, ProblemError):
            self._forget(placed.values())
            raise
        used = {received.log.id for received in kept}
        self._forget(log_id for log_id in placed.values() if log_id not in used)
        return kept

    def _keep(
        self, arrived: Sequence[tuple[Upload, str]], owner: str, placed: dict[str, str]
    ) -> list[AcceptedLog] | None:
        """Keep bytes, then rows; None when somebody else kept or deleted the same logs meanwhile.

        `placed` gathers the id under which bytes were kept by their digest.
        """
        digests = {upload.sha256: upload for upload, _ in arrived}
        with self._database.read() as session:
            known = set(_same_logs(session, owner, digests))
        for sha256, upload in digests.items():
            if sha256 not in known and sha256 not in placed:
                log_id = new_id()
                self._objects.put(upload.path, f"logs/{log_id}")
                placed[sha256] = log_id
        kept = []
        try:
            with self._database.write() as session:
                records = _same_logs(session, owner, digests)
                if digests.keys() - records.keys() - placed.keys():
                    return None
                for upload, name in arrived:
                    secret = None
                    if upload.sha256 not in records:
                        secret = new_secret()
                        records[upload.sha256] = LogRecord(
                            id=placed[upload.sha256],
                            owner=owner,
                            name=name,
                            size=upload.size,
                            sha256=upload.sha256,
                            received=datetime.now(UTC),
                            delete_digest=digest(secret),
                        )
                        session.add(records[upload.sha256])
                    kept.append(AcceptedLog(Log.model_validate(records[upload.sha256]), secret))
                session.flush()
                if any(received.delete_token is not None for received in kept):
                    self._quota.check_logs(_count_logs(session, owner))
                    stored = session.scalar(select(func.sum(LogRecord.size)).where(LogRecord.owner == owner))
                    self._quota.check_bytes(int(stored or 0))
        except IntegrityError:
            return None
        return kept

    def _forget(self, log_ids: Iterable[str]) -> None:
        """Remove bytes that no row names; what cannot be removed now, housekeeping finds later."""
        for log_id in log_ids:
            with suppress(OSError):
                self._objects.remove(f"logs/{log_id}")

    def find_log(self, log_id: str, owner: str) -> Log:
        """Look a log up; ProblemError if the owner has none of this id."""
        with self._database.read() as session:
            return Log.model_validate(get(session, LogRecord, log_id, owner))

    def count_logs(self, owner: str) -> int:
        """Count the logs of an owner."""
        with self._database.read() as session:
            return _count_logs(session, owner)

    def list_logs(self, owner: str, *, limit: int, after: str | None = None, name: str = "") -> list[Log]:
        """List the newest logs, or those after a log of this list, whose names contain `name`."""
        with self._database.read() as session:
            query = select(LogRecord)
            if name:
                query = query.where(contains_text(name, LogRecord.name))
            return [
                Log.model_validate(record)
                for record in newest(session, LogRecord, query, LogRecord.received, owner, limit, after)
            ]

    def may_delete_log(self, log_id: str, secret: str) -> str:
        """Return the owner of the log that a delete token is for; ProblemError if it is for another or none."""
        with self._database.read() as session:
            record = session.get(LogRecord, log_id) if is_id(log_id) else None
            if record is None or record.delete_digest != digest(secret):
                raise missing(LogRecord)
            return record.owner

    def delete_log(self, log_id: str, owner: str) -> None:
        """Remove a log and every analysis of it."""
        self._at_a_full_disk_too(lambda: self._delete_log(log_id, owner))

    def _at_a_full_disk_too(self, delete: Callable[[], None]) -> None:
        """Delete with what room is kept for it, where there is no other."""
        try:
            delete()
        except OperationalError:
            if not self._database.release_reserve():
                raise
            delete()
        finally:
            self._database.keep_reserve()

    def _delete_log(self, log_id: str, owner: str) -> None:
        with self._database.write() as session:
            record = get(session, LogRecord, log_id, owner, lock=True)  # nobody orders an analysis of it meanwhile
            analyses = list(session.scalars(select(AnalysedLog.analysis_id).where(AnalysedLog.log_id == log_id)))
            gone = or_(FlightRecord.log_id == log_id, FlightRecord.analysis_id.in_(analyses))
            flights = list(session.scalars(select(FlightRecord).where(gone)))
            forget(session, flights, "was deleted")
            # Flights of other logs that were analysed together with this one stay with their craft.
            others = {flight.log_id for flight in flights if flight.log_id not in (None, log_id)}
            for log in session.scalars(select(LogRecord).where(LogRecord.id.in_(others))):
                session.add(_new_analysis(owner, {}, [log]))
            session.execute(delete(AnalysedLog).where(AnalysedLog.analysis_id.in_(analyses)))
            session.execute(delete(AnalysisRecord).where(AnalysisRecord.id.in_(analyses)))
            session.delete(record)
        self._objects.remove(f"logs/{log_id}")
        for analysis in analyses:
            self._objects.remove(f"analyses/{analysis}")

    def order(self, log_ids: Sequence[str], configuration: Mapping[str, Any], owner: str) -> Analysis:
        """Put an analysis of one or several logs of the owner's into the queue; KeyError names a log there is not."""
        with self._database.write() as session:
            open_ = AnalysisRecord.state.in_((State.QUEUED, State.RUNNING))
            unfinished = select(func.count()).where(AnalysisRecord.owner == owner, open_)
            self._quota.check_order(session.scalar(unfinished) or 0)
            logs = {}
            for log_id in sorted(set(log_ids)):  # one order for all, so that no two wait for each other
                log = find(session, LogRecord, log_id, owner, lock=True)  # nobody deletes it meanwhile
                if log is None:
                    raise KeyError(log_id)
                logs[log_id] = log
            record = _new_analysis(owner, configuration, [logs[log_id] for log_id in dict.fromkeys(log_ids)])
            session.add(record)
            session.flush()
            return Analysis.model_validate(record)

    def find_analysis(self, analysis_id: str, owner: str | None) -> Analysis:
        """Look an analysis up; ProblemError if the owner (anybody, when None) has none of this id."""
        with self._database.read() as session:
            record = session.get(AnalysisRecord, analysis_id) if is_id(analysis_id) else None
            if record is None or owner not in (None, record.owner):
                raise missing(AnalysisRecord)
            return Analysis.model_validate(record)

    def list_analyses(
        self,
        owner: str,
        *,
        limit: int,
        after: str | None = None,
        state: State | None = None,
        log: str | None = None,
        text: str = "",
    ) -> list[Analysis]:
        """List the newest analyses, or those after one of this list, of a state, of a log or with a text.

        The text is part of a log's name, of the craft, the day of flight or the health.
        """
        with self._database.read() as session:
            query = select(AnalysisRecord)
            if state is not None:
                query = query.where(AnalysisRecord.state == state)
            if log is not None:
                if not is_id(log):
                    return []
                query = query.where(AnalysisRecord.members.any(AnalysedLog.log_id == log))
            if text:
                named = AnalysisRecord.members.any(AnalysedLog.log.has(contains_text(text, LogRecord.name)))
                columns = (AnalysisRecord.craft, AnalysisRecord.flown, AnalysisRecord.health, AnalysisRecord.happened)
                said = contains_text(text, *columns)
                query = query.where(or_(named, said))
            records = newest(session, AnalysisRecord, query, AnalysisRecord.created, owner, limit, after)
            return [Analysis.model_validate(record) for record in records]

    def cancel(self, analysis_id: str, owner: str) -> Analysis:
        """End an analysis that has not ended."""
        with self._database.write() as session:
            record = get(session, AnalysisRecord, analysis_id, owner)
            queue.cancel(session, analysis_id)
            session.refresh(record)
            return Analysis.model_validate(record)

    def delete_analysis(self, analysis_id: str, owner: str) -> None:
        """Remove an analysis and its results."""
        self._at_a_full_disk_too(lambda: self._delete_analysis(analysis_id, owner))

    def _delete_analysis(self, analysis_id: str, owner: str) -> None:
        with self._database.write() as session:
            record = get(session, AnalysisRecord, analysis_id, owner)
            flights = list(session.scalars(select(FlightRecord).where(FlightRecord.analysis_id == analysis_id)))
            forget(session, flights, "was deleted with its analysis")
            craft = None if record.craft_id is None else session.get(CraftRecord, record.craft_id)
            if craft is not None and record.configuration.get("flights") == craft.joint_of:
                craft.joint_of, craft.joint_lost = [], "their analysis was deleted"
            session.execute(delete(AnalysisRecord).where(AnalysisRecord.id == analysis_id))
        self._objects.remove(f"analyses/{analysis_id}")

    def object_of(self, analysis: Analysis, name: str) -> str | None:
        """Return the key of a file of an analysis; None when it has none of this name."""
        if name not in analysis.files:  # as long as it runs, without asking again
            return None
        with self._database.read() as session:
            record = session.get(AnalysisRecord, analysis.id)
            if record is None or record.results is None or name not in record.files:
                return None
            return f"analyses/{record.id}/{record.results}/{name}"


def order_joint_fit(session: Session, craft: CraftRecord, flights: Sequence[FlightRecord], mass: float | None) -> None:
    """Put the joint fit of flights of a craft into the queue."""
    logs = {flight.log_id for flight in flights}
    records = session.scalars(select(LogRecord).where(LogRecord.id.in_(logs)).order_by(LogRecord.received))
    configuration: dict[str, Any] = {"flights": [flight.id for flight in flights]}
    analysis = _new_analysis(craft.owner, configuration | ({} if mass is None else {"mass": mass}), list(records))
    analysis.craft_id = craft.id
    session.add(analysis)


def _new_analysis(owner: str, configuration: Mapping[str, Any], logs: Sequence[LogRecord]) -> AnalysisRecord:
    return AnalysisRecord(
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


def _same_logs(session: Session, owner: str, digests: Iterable[str]) -> dict[str, LogRecord]:
    """Find the logs of an owner with these digests."""
    query = select(LogRecord).where(LogRecord.owner == owner, LogRecord.sha256.in_(list(digests)))
    return {record.sha256: record for record in session.scalars(query)}


def _count_logs(session: Session, owner: str) -> int:
    return session.scalar(select(func.count()).where(LogRecord.owner == owner)) or 0


#: Seconds between two looks at the database: workers may be in other processes and on other computers.
_LOOK = 0.25


async def changes(catalog: Catalog, analysis: Analysis, stopping: Callable[[], bool]) -> AsyncIterator[Analysis]:
    """Yield an analysis as it is, and again whenever it has changed, up to its end, its removal or ours."""
    yield analysis
    while not (analysis.state.ended or stopping()):
        await asyncio.sleep(_LOOK)
        try:
            now = await run_in_threadpool(catalog.find_analysis, analysis.id, None)
        except ProblemError:
            return
        if now != analysis:
            analysis = now
            yield analysis


async def ended(catalog: Catalog, analysis: Analysis, stopping: Callable[[], bool]) -> Analysis:
    """Wait for the end of an analysis, or until the service stops, and give it as it is then."""
    async for now in changes(catalog, analysis, stopping):
        analysis = now
    return analysis
