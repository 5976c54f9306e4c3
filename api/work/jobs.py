"""Handing claimed analyses to threads of this server, or of a worker without a server on any other computer.

A worker needs the database and the storage, and nothing else of the server: no port, no tokens, no pages.
"""

import logging
import signal
import tempfile
import threading
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from sqlalchemy.exc import SQLAlchemyError

from api.settings import Settings
from api.store.database import Database
from api.store.objects import Objects
from api.work.watch import PRELOAD, Workplace, work
from api.work.worker import Analyze, analyze_logs

_log = logging.getLogger("rotorid.api")

#: Seconds between two looks into the queue when nobody says that something is there: other servers may have put it in.
_LOOK = 1.0


class Runner:
    """Keeps `workers` analyses going as long as there are any."""

    def __init__(self, workplace: Workplace) -> None:
        self.queue = workplace.queue
        self._workplace = workplace
        self._workers = workplace.settings.workers
        self._free = threading.Semaphore(self._workers)
        self._woken = threading.Event()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._dispatch, name="dispatch", daemon=True)
        self._executor: ThreadPoolExecutor | None = None

    def open(self) -> None:
        """Start to work; a server without workers leaves that to others."""
        if self._workers == 0:
            return
        self._workplace.warm_up()
        self._executor = ThreadPoolExecutor(self._workers, thread_name_prefix="analysis")
        self._thread.start()

    def close(self) -> None:
        """Stop: what is being worked on here goes back into the queue, for the next server or another one."""
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
        assert self._executor is not None
        while not self._closing.is_set():
            if not self._free.acquire(timeout=_LOOK):
                continue
            claim = None
            try:
                self._woken.clear()
                claim = self.queue.claim()
            except SQLAlchemyError as error:
                _log.warning("the queue cannot be read: %s", error)
            if claim is None:
                self._free.release()
                self._woken.wait(_LOOK)
            else:
                self._executor.submit(work, self._workplace, claim, self.stopping).add_done_callback(self._done)

    def _done(self, future: Future[None]) -> None:
        """Free the place of an analysis; whatever it failed of, its lease will run out."""
        self._free.release()
        self._woken.set()
        error = future.exception() if not future.cancelled() else None
        if error is not None:
            _log.error("a worker failed: %s: %s", type(error).__name__, error)


def work_until_told(settings: Settings, analyze: Analyze = analyze_logs, *, preload: Sequence[str] = PRELOAD) -> None:
    """Work until SIGTERM or SIGINT; what is being worked on then goes back into the queue."""
    database, objects = Database(settings.database_url), Objects(settings.storage_url)
    database.migrate()
    objects.prepare()
    told = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: told.set())
    # Beside a storage on this computer, from where results move at no cost.
    beside = None if objects.folder is None else objects.folder.parent
    with tempfile.TemporaryDirectory(prefix="rotorid-worker-", dir=beside) as scratch:
        runner = Runner(Workplace(database, objects, settings, Path(scratch), analyze, preload))
        runner.open()
        _log.info("%d analyses at a time from %s", settings.workers, settings.storage_url)
        told.wait()
        runner.close()
    database.close()
