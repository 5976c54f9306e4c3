"""Threads that work on analyses: of this server, or of a worker without a server on any other computer.

A worker needs the database and the storage, and nothing else of the server: no port, no tokens, no pages.
"""

import logging
import signal
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

from api.settings import Settings
from api.store.database import Database
from api.work.queue import Queue
from api.work.rounds import Rounds
from api.work.watch import Workplace, work
from api.work.worker import Analyze, analyze_logs
from pipeline.storage.store import open_store
from reports import PRELOAD

_log = logging.getLogger("rotorid.api")

#: Seconds between two looks into the queue when nobody says that something is there: other servers may have put it in.
_LOOK = 1.0


class Runner:
    """Keeps as many analyses going as the settings say, as long as there are any."""

    def __init__(self, workplace: Workplace) -> None:
        self.queue = workplace.queue
        self._workplace = workplace
        self._closing = threading.Event()
        self._workers = [_Worker(workplace, self.queue, number) for number in range(workplace.settings.workers)]

    def open(self) -> None:
        """Start to work; a server without workers leaves that to others."""
        if self._workers:
            self._workplace.warm_up()
        for worker in self._workers:
            worker.open()

    def close(self) -> None:
        """Stop: what is being worked on here goes back into the queue, for the next server or another one."""
        self._closing.set()
        for worker in self._workers:
            worker.stop()
        for worker in self._workers:
            worker.close()

    def stopping(self) -> bool:
        """Return whether the service is about to end."""
        return self._closing.is_set()

    def wake(self) -> None:
        """Report that something was put into the queue."""
        for worker in self._workers:
            worker.wake()


class _Worker(Rounds):
    """Works on one analysis after the other; whatever one fails of, its lease will run out."""

    def __init__(self, workplace: Workplace, queue: Queue, number: int) -> None:
        super().__init__(f"worker {number}", _LOOK)
        self._workplace, self._queue = workplace, queue

    def go_round(self) -> None:
        """Work until the queue is empty."""
        while not self.closing and (claim := self._queue.claim()) is not None:
            work(self._workplace, claim, lambda: self.closing)


def work_until_told(settings: Settings, analyze: Analyze = analyze_logs, *, preload: Sequence[str] = PRELOAD) -> None:
    """Work until SIGTERM or SIGINT; what is being worked on then goes back into the queue."""
    database, objects = Database(settings.database_url), open_store(settings.storage_url)
    database.migrate()
    objects.prepare()
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    # Beside a storage on this computer, from where results move at no cost.
    beside = None if objects.folder is None else objects.folder.parent
    with tempfile.TemporaryDirectory(prefix="rotorid-worker-", dir=beside) as scratch:
        runner = Runner(Workplace(database, objects, settings, Path(scratch), analyze, preload))
        runner.open()
        _log.info("%d analyses at a time from %s", settings.workers, settings.storage_url)
        stop.wait()
        runner.close()
    database.close()
