"""Signs of life of whoever works on an analysis, given by a thread of their own, whatever the work is busy with."""

import logging
import threading
from types import TracebackType
from typing import Self

from sqlalchemy.exc import SQLAlchemyError

from api.work.queue import Claim, Queue

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
        self._reached = ("", 0.0)
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

    def reach(self, stage: str, progress: float) -> None:
        """Report how far the work is, and let others know soon."""
        self._reached = (stage, progress)
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
                if not self._queue.prolong(self._claim, *self._reached):
                    self._lost.set()
                    return
            except SQLAlchemyError as error:
                # A database that does not answer is no reason to stop before it says that the lease is over.
                _log.warning("analysis %s: no sign of life can be given: %s", self._claim.analysis, error)
            self._left.wait(_QUICKEST)
