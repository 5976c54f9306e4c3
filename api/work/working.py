"""A worker without a server: takes analyses out of the queue of a service, on whichever computer it runs.

It needs the database and the storage, and nothing else of the server: no port, no tokens, no pages.
"""

import logging
import signal
import tempfile
import threading
from collections.abc import Sequence
from pathlib import Path

from api.settings import Settings
from api.store.database import Database
from api.store.objects import Objects
from api.work.jobs import Runner
from api.work.watch import PRELOAD, Workplace
from api.work.worker import Analyze, analyze_logs

_log = logging.getLogger("rotorid.api")


def work_until_told(settings: Settings, analyze: Analyze = analyze_logs, *, preload: Sequence[str] = PRELOAD) -> None:
    """Work until SIGTERM or SIGINT; what is being worked on then goes back into the queue.

    Parameters
    ----------
    settings : Settings
        Of the service.
    analyze : callable
        The analysis, called with a task and a function that takes progress.
    preload : sequence of str
        Modules to import once for all analyses.

    Raises
    ------
    OSError
        The storage cannot be written.
    sqlalchemy.exc.SQLAlchemyError
        The database cannot be used.
    """
    database = Database(settings.database_url)
    database.migrate()
    Objects(settings.storage_url).prepare()
    told = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: told.set())
    with tempfile.TemporaryDirectory(prefix="rotorid-worker-", dir=_here(settings)) as scratch:
        workplace = Workplace.of(settings, analyze, preload, Path(scratch))
        runner = Runner(database, workplace, workers=settings.workers)
        runner.open()
        _log.info("%d analyses at a time from %s", settings.workers, settings.storage_url)
        told.wait()
        runner.close()
    database.close()


def _here(settings: Settings) -> Path | None:
    """Return where temporary files go: beside a storage on this computer, from where results then move at no cost."""
    folder = Objects(settings.storage_url).folder
    return None if folder is None else folder.parent
