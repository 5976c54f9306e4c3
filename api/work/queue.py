"""The queue of analyses, kept in the database: orders are claimed under a lease, kept alive, and ended once.

A worker claims an analysis for a short time and keeps prolonging that. When it dies, its lease runs out and another
worker may claim the analysis. A worker that lost its lease, because it was too slow or the analysis was cancelled, can
change nothing any more: every change names the lease.

Every change may be asked for again when the connection broke before the answer came.
"""

import logging
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from types import TracebackType
from typing import Any, Self

from sqlalchemy import ColumnElement, and_, func, or_, select, update
from sqlalchemy.engine import CursorResult
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from api.problems import Problem
from api.store.database import Database, now
from api.store.ids import new_id
from api.store.records import AnalysisRecord
from api.store.resources import State
from api.work import craft_flights
from api.work.outcome import Outcome, Reached


@dataclass(frozen=True, slots=True)
class Claim:
    """The right to work on an analysis, as long as its lease is prolonged."""

    analysis: str  #: Its id.
    lease: str  #: Names this claim, and the place of its results.
    deaths: int  #: How many processes that worked on it have died already.
    logs: tuple[tuple[str, str], ...]  #: tuple of (id, name)
    configuration: Mapping[str, Any]
    craft: str | None = None  #: Id of the craft that it is a joint fit of.


#: How often the worker of an analysis may be lost with its whole computer or server, which is rarely the log's fault.
_LOST = 20


#: Leases from now after which none ends that was given by this clock.
_PLAUSIBLE = 3


_BEGUN, _NOTHING = Reached(), Outcome()


class Queue:
    """Claims analyses and records how they go."""

    def __init__(self, database: Database, *, lease: float, deaths: int) -> None:
        self._database = database
        self._lease = timedelta(seconds=lease)
        self._deaths = deaths

    def claim(self) -> Claim | None:
        """Claim an analysis that waits or whose worker has died; None when there is none.

        Owners take turns, whoever has the fewest running first and then who waited longest since their last began; of
        one owner the oldest comes first.
        """
        with self._database.write() as session:
            time = now(session)
            # A lease far in the future was given before the clock stepped back, and nobody may be left to prolong it.
            over = or_(AnalysisRecord.lease_until < time, AnalysisRecord.lease_until > time + _PLAUSIBLE * self._lease)
            left = and_(AnalysisRecord.state == State.RUNNING, over)
            session.execute(
                update(AnalysisRecord)
                .where(left, AnalysisRecord.attempts - AnalysisRecord.deaths >= _LOST)
                .values(**_end(session, State.FAILED), problem=abandoned(_LOST).model_dump(mode="json"))
            )
            record = _next(session, or_(AnalysisRecord.state == State.QUEUED, left))
            if record is None:
                return None
            record.state = State.RUNNING
            record.stage, record.progress, record.happened = "", 0.0, None
            record.lease, record.lease_until = new_id(), time + self._lease
            record.attempts += 1
            record.started = time
            return Claim(
                analysis=record.id,
                lease=record.lease,
                deaths=record.deaths,
                logs=tuple((member.log.id, member.log.name) for member in record.members),
                configuration=record.configuration,
                craft=record.craft_id,
            )

    def prolong(self, claim: Claim, reached: Reached = _BEGUN) -> bool:
        """Return a sign of life and say how far the work is; False when the lease is lost and the work for nothing."""
        with self._database.write() as session:
            return _change(session, claim, lease_until=now(session) + self._lease, **asdict(reached))

    def finish(self, claim: Claim, files: Mapping[str, int], outcome: Outcome = _NOTHING) -> bool:
        """End an analysis well, its flights to their craft; False, with nothing changed, when the lease is lost."""
        line = {name: getattr(outcome, name) for name in ("craft", "flown", "happened", "health", "tone", "trust")}
        with self._database.write() as session:
            if _change(session, claim, **_end(session, State.DONE), files=dict(files), results=claim.lease, **line):
                analysis = session.get_one(AnalysisRecord, claim.analysis, populate_existing=True)
                if claim.craft is not None:
                    craft_flights.joined(session, analysis)
                else:
                    craft_flights.register(session, analysis, outcome.flights)
                return True
            # Asked for again: it was done before, and the results must not be taken for another's.
            ended = session.get(AnalysisRecord, claim.analysis)
            return ended is not None and ended.results == claim.lease

    def fail(self, claim: Claim, problem: Problem) -> bool:
        """End an analysis that cannot be done; False, with nothing changed, when the lease is lost."""
        with self._database.write() as session:
            return _change(session, claim, **_end(session, State.FAILED), problem=problem.model_dump(mode="json"))

    def give_back(self, claim: Claim) -> bool:
        """Return the work to the queue after an orderly stop, as if it had not been begun."""
        with self._database.write() as session:
            return _change(session, claim, **_WAITING, attempts=AnalysisRecord.attempts - 1)

    def retry(self, claim: Claim) -> bool:
        """Return the work to the queue after its process has died; False when too many have, or the lease is lost."""
        if claim.deaths + 1 >= self._deaths:
            return False
        with self._database.write() as session:
            return _change(session, claim, **_WAITING, deaths=claim.deaths + 1)


def _next(session: Session, ready: ColumnElement[bool]) -> AnalysisRecord | None:
    """Choose among the analyses that are ready, and keep others from choosing it."""
    owners = list(session.scalars(select(AnalysisRecord.owner).where(ready).distinct()))
    if len(owners) > 1:
        counted = session.execute(
            select(AnalysisRecord.owner, func.count())
            .where(AnalysisRecord.state == State.RUNNING)
            .group_by(AnalysisRecord.owner)
        )
        running = {row[0]: row[1] for row in counted}
        last = {
            owner: session.scalar(select(func.max(AnalysisRecord.started)).where(AnalysisRecord.owner == owner))
            for owner in owners
        }
        owners.sort(key=lambda owner: (running.get(owner, 0), last[owner] or datetime.min.replace(tzinfo=UTC), owner))
    for owner in owners:
        record = session.scalar(
            select(AnalysisRecord)
            .where(ready, AnalysisRecord.owner == owner)
            .order_by(AnalysisRecord.created)
            .limit(1)
            .with_for_update(skip_locked=True)
        )
        if record is not None:
            return record
    return None


def cancel(session: Session, analysis: str) -> bool:
    """End an analysis because its owner wants so; False when it had ended before."""
    open_ = AnalysisRecord.state.in_((State.QUEUED, State.RUNNING))
    changed = session.execute(
        update(AnalysisRecord).where(AnalysisRecord.id == analysis, open_).values(**_end(session, State.CANCELLED))
    )
    return isinstance(changed, CursorResult) and changed.rowcount == 1


def abandoned(attempts: int) -> Problem:
    """Report that an analysis lost its worker as often as it may."""
    return Problem.of(
        "analysis-crashed",
        f"The analysis was begun {attempts} times and each time ended without a word, most likely because it needed "
        "more memory than the computer has. Analyse a shorter log, or run `rotorid analyze` yourself.",
    )


#: What a row says that waits for a worker.
_WAITING: dict[str, Any] = {"state": State.QUEUED, "stage": "", "progress": 0.0, "lease": None, "lease_until": None}


def _end(session: Session, state: State) -> dict[str, Any]:
    return {
        "state": state,
        "stage": "",
        "progress": 1.0 if state is State.DONE else AnalysisRecord.progress,
        "ended": now(session),
        "lease": None,
        "lease_until": None,
    }


def _change(session: Session, claim: Claim, **values: Any) -> bool:
    changed = session.execute(
        update(AnalysisRecord)
        .where(AnalysisRecord.id == claim.analysis, AnalysisRecord.lease == claim.lease)
        .values(**values)
    )
    return isinstance(changed, CursorResult) and changed.rowcount == 1


_log = logging.getLogger("rotorid.api")

#: Part of a lease after which it is prolonged: two signs of life may be lost.
_PROLONG = 1 / 3

#: Least seconds between two signs of life when there is progress to tell.
_QUICKEST = 0.2


class LostError(Exception):
    """Somebody else has the analysis now, or nobody wants it any more."""


class Heartbeat:
    """Prolongs a claim until it is left."""

    def __init__(self, queue: Queue, claim: Claim, lease: float) -> None:
        self._queue = queue
        self._claim = claim
        self._interval = lease * _PROLONG
        self._reached = _BEGUN
        self._news, self._lost, self._left = threading.Event(), threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)

    def __enter__(self) -> Self:
        """Begin."""
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Stop; the last sign of life may still be on its way, and comes to nothing once the analysis has ended."""
        self._left.set()
        self._news.set()
        self._thread.join()

    def reach(self, reached: Reached) -> None:
        """Report how far the work is, and let others know soon."""
        self._reached = reached
        self._news.set()

    def check(self) -> None:
        """Raise `LostError` when the claim is lost."""
        if self._lost.is_set():
            raise LostError

    def _beat(self) -> None:
        while not self._left.is_set():
            self._news.wait(self._interval)
            self._news.clear()
            if self._left.is_set():
                return
            try:
                if not self._queue.prolong(self._claim, self._reached):
                    self._lost.set()
                    return
            except SQLAlchemyError as error:
                # A database that does not answer is no reason to stop before it says that the lease is over.
                _log.warning("analysis %s: no sign of life can be given: %s", self._claim.analysis, error)
            self._left.wait(_QUICKEST)
