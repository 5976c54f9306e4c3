"""Handing claimed analyses to whoever works: threads of this server, or a Dask cluster."""

import logging
import threading
import time
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial

from sqlalchemy.exc import SQLAlchemyError

from api.store.database import Database
from api.work.queue import Claim
from api.work.watch import Workplace, work
from pipeline.execution.cluster import Cluster, SchedulerError

_log = logging.getLogger("rotorid.api")

#: Seconds between two looks into the queue when nobody says that something is there: other servers may have put it in.
_LOOK = 1.0

#: Seconds after which a scheduler that did not answer is asked again.
_RECONNECT = 5.0


class Runner:
    """Keeps `workers` analyses going as long as there are any.

    Parameters
    ----------
    database : Database
    workplace : Workplace
    workers : int
        Analyses at the same time.
    scheduler : str or None
        Address of a Dask scheduler whose workers do the work.
    """

    def __init__(self, database: Database, workplace: Workplace, *, workers: int, scheduler: str | None = None) -> None:
        self.queue = workplace.queue(database)
        self._workplace = workplace
        self._scheduler = scheduler
        self._free = threading.Semaphore(workers)
        self._workers = workers
        self._woken = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._dispatch, name="dispatch", daemon=True)
        self._executor: Executor | None = None
        #: Claims handed out that nobody may have begun to work on: they are kept alive from here.
        self._waiting: dict[Future[None], Claim] = {}
        self._prolonged = 0.0

    def open(self) -> None:
        """Start to work; a server without workers leaves that to others."""
        if self._workers == 0:
            return
        if self._scheduler is None:
            self._workplace.warm_up()
        self._thread.start()

    def close(self) -> None:
        """Stop: what is being worked on here goes back into the queue, for the next server or another one.

        A cluster finishes what it works on; the database and the storage are all that it needs for that.
        """
        self._closing.set()
        self._woken.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._executor is not None:
            self._executor.shutdown(wait=True)

    def stopping(self) -> bool:
        """Return whether the service is about to end."""
        return self._closing.is_set()

    def wake(self) -> None:
        """Report that something was put into the queue."""
        self._woken.set()

    def _dispatch(self) -> None:
        """Claim analyses and hand them out, until the server stops."""
        while not self._closing.is_set():
            self._keep_alive()
            if self._executor is None and not self._connect():
                self._closing.wait(_RECONNECT)
                continue
            if not self._free.acquire(timeout=_LOOK):
                continue
            claim = None
            try:
                self._woken.clear()
                claim = self.queue.claim()
            except SQLAlchemyError as error:
                _log.warning("the queue cannot be read: %s", error)
            if claim is None or not self._submit(claim):
                self._free.release()
                self._woken.wait(_LOOK)

    def _connect(self) -> bool:
        """Find whoever does the work; False when it does not answer."""
        if self._scheduler is None:
            self._executor = ThreadPoolExecutor(self._workers, thread_name_prefix="analysis")
            return True
        try:
            self._executor = Cluster(self._scheduler)
        except SchedulerError as error:
            _log.warning("%s", error)
        return self._executor is not None

    def _submit(self, claim: Claim) -> bool:
        """Hand a claim out; False when nobody takes it, and it is back in the queue."""
        assert self._executor is not None
        # The work on a cluster does not end with this server.
        task = partial(work) if self._scheduler else partial(work, stopping=self.stopping)
        try:
            future = self._executor.submit(task, self._workplace, claim)
        except Exception as error:  # a cluster's client that lost its scheduler fails in many ways
            _log.warning("analysis %s cannot be handed out: %s", claim.analysis, error)
            self._executor = None
            try:
                self.queue.give_back(claim)
            except SQLAlchemyError:
                _log.warning("analysis %s waits until its lease is over", claim.analysis)
            return False
        self._waiting[future] = claim
        future.add_done_callback(self._done)
        return True

    def _keep_alive(self) -> None:
        """Prolong what a busy cluster has not begun yet; whoever has begun does so under a lease of its own."""
        if self._scheduler is None or time.monotonic() < self._prolonged + self._workplace.lease / 3:
            return
        self._prolonged = time.monotonic()
        for future, claim in list(self._waiting.items()):
            try:
                if not self.queue.prolong(claim):
                    self._waiting.pop(future, None)
            except SQLAlchemyError as error:
                _log.warning("analysis %s: no sign of life can be given: %s", claim.analysis, error)

    def _done(self, future: Future[None]) -> None:
        """Free the place of an analysis; whatever it failed of, its lease will run out."""
        self._waiting.pop(future, None)
        self._free.release()
        self._woken.set()
        error = future.exception() if not future.cancelled() else None
        if error is not None:
            _log.error("a worker failed: %s: %s", type(error).__name__, error)
