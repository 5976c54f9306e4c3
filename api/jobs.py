"""Handing claimed analyses to whoever works: threads of this server, or a Dask cluster."""

import logging
import threading
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from functools import partial

from sqlalchemy.exc import SQLAlchemyError

from api.database import Database
from api.watch import Workplace, work

_log = logging.getLogger("rotorid.api")

#: Seconds between two looks into the queue when nobody says that something is there: other servers may have put it in.
_LOOK = 1.0


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
        self._queue = workplace.queue(database)
        self._workplace = workplace
        self._scheduler = scheduler
        self._free = threading.Semaphore(workers)
        self._workers = workers
        self._woken = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._dispatch, name="dispatch", daemon=True)
        self._executor: Executor | None = None

    def open(self) -> None:
        """Start to work."""
        if self._scheduler is None:
            self._workplace.warm_up()
            self._executor = ThreadPoolExecutor(self._workers, thread_name_prefix="analysis")
            self._work = partial(work, stopping=self.stopping)
        else:
            from distributed import Client

            self._executor = Client(self._scheduler).get_executor(pure=False)  # type: ignore[no-untyped-call]
            self._work = partial(work)
        self._thread.start()

    def close(self) -> None:
        """Stop: what is being worked on goes back into the queue, for the next server or another one."""
        self._closing.set()
        self._woken.set()
        if self._thread.is_alive():
            self._thread.join()
        if self._executor is not None:
            self._executor.shutdown(wait=self._scheduler is None)

    def stopping(self) -> bool:
        """Say whether the service is about to end."""
        return self._closing.is_set()

    def wake(self) -> None:
        """Say that something was put into the queue."""
        self._woken.set()

    def _dispatch(self) -> None:
        """Claim analyses and hand them out, until the server stops."""
        assert self._executor is not None
        while not self._closing.is_set():
            if not self._free.acquire(timeout=_LOOK):
                continue
            claim = None
            try:
                self._woken.clear()
                claim = self._queue.claim()
            except SQLAlchemyError as error:
                _log.warning("the queue cannot be read: %s", error)
            if claim is None:
                self._free.release()
                self._woken.wait(_LOOK)
                continue
            future = self._executor.submit(self._work, self._workplace, claim)
            future.add_done_callback(self._done)

    def _done(self, future: Future[None]) -> None:
        """Free the place of an analysis; whatever it failed of, its lease will run out."""
        self._free.release()
        self._woken.set()
        error = future.exception() if not future.cancelled() else None
        if error is not None:
            _log.error("a worker failed: %s: %s", type(error).__name__, error)
