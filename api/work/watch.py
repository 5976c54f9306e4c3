"""Working on one claimed analysis: fetch its logs, let a process analyse them, keep the claim alive, keep the results.

This runs in a thread of the server, or of a Dask worker on another computer; either way the analysis is a process of
its own, which can be ended when it takes too long, and the database and the storage are the only things shared.
"""

import errno
import logging
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from sqlalchemy import make_url
from sqlalchemy.exc import SQLAlchemyError

from api.problems import Problem
from api.settings import LogFormat, Settings
from api.store import sizes
from api.store.database import Database
from api.store.objects import Objects
from api.work import worker
from api.work.craft_members import members_of
from api.work.flown import read_flown
from api.work.found import read_found
from api.work.heartbeat import Heartbeat, LostError
from api.work.queue import Claim, Queue
from pipeline.names import folder_names

_log = logging.getLogger("rotorid.api")

#: What the process that workers are forked from has imported already, so that an analysis starts at once.
PRELOAD = (
    "pipeline.fleet.job",
    "pipeline.fleet.joint",
    "pipeline.fleet.crafts",
    "reports.files.folder",
    "reports.files.fleet",
)

#: How processes that do the work are made.
CONTEXT = multiprocessing.get_context("forkserver")

#: Seconds for which the end of an analysis is kept ready while the database cannot take it.
_PATIENCE = 120.0


@dataclass(frozen=True, slots=True)
class Workplace:
    """What every worker is told, wherever it works."""

    #: URLs.
    database: str
    objects: str
    scratch: Path | None  #: Where temporary folders are made; the computer's own place for them by default.
    analyze: worker.Analyze  #: What to do with a task; a function of a module.
    limits: worker.Limits  #: Of one analysis.
    lease: float  #: Seconds without a sign of life after which a worker is taken for dead.
    deaths: int  #: How many processes may die of one analysis.
    preload: Sequence[str] = PRELOAD  #: Modules that `analyze` uses and that are worth importing once for all analyses.
    log_format: LogFormat = LogFormat.TEXT  #: How processes of analyses write what goes wrong in them.

    @classmethod
    def of(
        cls, settings: Settings, analyze: worker.Analyze, preload: Sequence[str], scratch: Path | None
    ) -> "Workplace":
        """Return the workplace that settings describe.

        Parameters
        ----------
        settings : Settings
            Of the service.
        analyze : callable
            The analysis, called with a task and a function that takes progress.
        preload : sequence of str
            Modules to import once for all analyses.
        scratch : Path or None
            Folder for temporary files; None for the system's.
        """
        return cls(
            database=settings.database_url,
            objects=settings.storage_url,
            scratch=scratch,
            analyze=analyze,
            limits=worker.Limits(settings.time_limit, settings.memory_limit, settings.upload_limit, _kept(settings)),
            lease=settings.lease,
            deaths=settings.deaths,
            preload=preload,
            log_format=settings.log_format,
        )

    def queue(self, database: Database) -> Queue:
        """Return the queue as this workplace's rules are."""
        return Queue(database, lease=self.lease, deaths=self.deaths)

    def warm_up(self) -> None:
        """Start the process that analyses are forked from; it imports the pipeline meanwhile."""
        # Our matrices are small: BLAS threads only hurt them and each other. The workers inherit this.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # The kernel ends a child with the thread that started it: only the main thread is sure to outlast the others.
        mortal = ["api.work.mortal"] if threading.current_thread() is threading.main_thread() else []
        CONTEXT.set_forkserver_preload([*mortal, "__main__", "api.work.worker", "logparse", *self.preload])
        forkserver.ensure_running()


def _kept(settings: Settings) -> tuple[Path, ...]:
    """Return where the service keeps its logs, results and database on this computer."""
    database, storage = make_url(settings.database_url), Objects(settings.storage_url).folder
    file = database.database if database.get_backend_name() == "sqlite" else None
    return (settings.data, *([storage] if storage else []), *([Path(file)] if file else []))


def work(workplace: Workplace, claim: Claim, stopping: Callable[[], bool] = bool) -> None:
    """Work on a claimed analysis until it has ended, the claim is lost, or `stopping` says so.

    Parameters
    ----------
    workplace : Workplace
        Database, storage and limits.
    claim : Claim
        The analysis and its lease.
    stopping : callable
        Return whether to stop and put the analysis back.
    """
    workplace.warm_up()
    database = Database(workplace.database)
    try:
        queue = workplace.queue(database)
        own = queue.begin(claim)
        if own is not None:
            _work(workplace, own, database, queue, stopping)
    finally:
        database.close()


def _work(workplace: Workplace, claim: Claim, database: Database, queue: Queue, stopping: Callable[[], bool]) -> None:
    objects = Objects(workplace.objects)

    def persist(change: Callable[[], bool]) -> bool:
        return _persist(database, change)

    with Heartbeat(queue, claim, workplace.lease) as heartbeat:
        try:
            with tempfile.TemporaryDirectory(prefix="rotorid-", dir=workplace.scratch) as name:
                folder = Path(name)
                logs = [] if claim.craft else _fetch(claim, objects, folder, heartbeat)
                members = _fetch_members(claim, database, objects, folder, heartbeat) if claim.craft else []
                task = worker.Task(logs, claim.configuration, folder / "results", members)
                task.folder.mkdir()
                problem = _analyse(workplace, claim, heartbeat, task, stopping)
                if problem is not None:
                    persist(lambda: queue.fail(claim, problem))
                    return
                found, flown = read_found(task.folder / "report.json"), read_flown(task.folder)
                files = _keep(claim, objects, task.folder, heartbeat)
                if not persist(lambda: queue.finish(claim, files, found, flown)):
                    objects.remove(f"analyses/{claim.analysis}/{claim.lease}")
        except _StoppedError:
            queue.give_back(claim)
        except _DiedError as death:
            if not persist(lambda: queue.retry(claim)):
                given_up = _judge_exit(workplace, claim, death.exit_code)
                persist(lambda: queue.fail(claim, given_up))
        except LostError:
            objects.remove(f"analyses/{claim.analysis}/{claim.lease}")
            _log.info("analysis %s was cancelled, or given to another worker", claim.analysis)
        except FileNotFoundError:
            _log.exception("analysis %s: a log is gone", claim.analysis)
            persist(lambda: queue.fail(claim, _GONE))
        except OSError as error:
            _log.exception("analysis %s: cannot keep its results", claim.analysis)
            unkept = _unkept(error)
            persist(lambda: queue.fail(claim, unkept))


class _StoppedError(Exception):
    """The server stops."""


class _DiedError(Exception):
    """The process died without a word, and not by our hand."""

    def __init__(self, exit_code: int | None) -> None:
        super().__init__(f"exit code {exit_code}")
        self.exit_code = exit_code


def _fetch(claim: Claim, objects: Objects, folder: Path, heartbeat: Heartbeat) -> list[tuple[Path, str]]:
    """Bring the logs to this computer, under names of which nothing is taken on trust."""
    safe = folder_names([name for _, name in claim.logs])
    logs = []
    for number, (log_id, name) in enumerate(claim.logs, start=1):
        heartbeat.check()
        path = folder / "logs" / str(number) / safe[name]  # logs of one analysis may have the same name
        path.parent.mkdir(parents=True)
        objects.fetch(f"logs/{log_id}", path)
        logs.append((path, name))
    return logs


def _fetch_members(
    claim: Claim, database: Database, objects: Objects, folder: Path, heartbeat: Heartbeat
) -> list[worker.Member]:
    """Bring the experiments of the flights of a craft to this computer."""
    members = []
    for number, flight in enumerate(members_of(database, claim), start=1):
        experiments = {}
        for kind, key in flight.experiments.items():
            heartbeat.check()
            experiments[kind] = folder / "flights" / str(number) / f"{kind}.parquet"
            experiments[kind].parent.mkdir(parents=True, exist_ok=True)
            objects.fetch(key, experiments[kind])
        members.append(worker.Member(flight.name, flight.entry, experiments))
    return members


def _keep(claim: Claim, objects: Objects, folder: Path, heartbeat: Heartbeat) -> dict[str, int]:
    """Move the results to the storage; gives every file's size by its name."""
    files = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            heartbeat.check()
            name = path.relative_to(folder).as_posix()
            files[name] = path.stat().st_size
            with path.open("rb") as file:
                os.fsync(file.fileno())
            objects.put(path, f"analyses/{claim.analysis}/{claim.lease}/{name}")
    return files


def _analyse(
    workplace: Workplace, claim: Claim, heartbeat: Heartbeat, task: worker.Task, stopping: Callable[[], bool]
) -> Problem | None:
    """Run the task in a process; return what went wrong, or None when the results are there."""
    with _process(workplace, task) as (process, receiver):
        deadline = time.monotonic() + workplace.limits.time
        last = worker.Advanced("", 0.0)
        while time.monotonic() < deadline:
            if stopping():
                raise _StoppedError
            heartbeat.check()
            try:
                if not receiver.poll(min(0.25, max(0.0, deadline - time.monotonic()))):
                    continue
                report = receiver.recv()
            except (EOFError, OSError):
                process.join()
                _log.error("analysis %s: its process died with exit code %s", claim.analysis, process.exitcode)
                raise _DiedError(process.exitcode) from None
            if not isinstance(report, worker.Advanced):
                return _judge(workplace, claim, report)
            if report.stage != last.stage or report.progress >= last.progress + 0.02:
                last = report
                heartbeat.reach(report.stage, report.progress)
        return _too_slow(workplace.limits.time)


@contextmanager
def _process(workplace: Workplace, task: worker.Task) -> Iterator[tuple[ForkServerProcess, Connection]]:
    """Start a process for a task; it is gone afterwards, whatever it was doing."""
    receiver, sender = CONTEXT.Pipe(duplex=False)
    process = CONTEXT.Process(
        target=worker.run,
        args=(sender, workplace.analyze, task, workplace.limits, workplace.log_format),
        daemon=True,
    )
    process.start()
    sender.close()
    try:
        yield process, receiver
    finally:
        process.kill()
        process.join()
        process.close()
        receiver.close()


def _persist(database: Database, change: Callable[[], bool]) -> bool:
    """Write the end of an analysis down, at a full disk too, waiting for a database that does not answer."""
    deadline, pause = time.monotonic() + _PATIENCE, 0.5
    while True:
        try:
            changed = change()
        except SQLAlchemyError:
            if database.release_reserve():
                continue
            if time.monotonic() + pause > deadline:
                raise
            time.sleep(pause)
            pause = min(2.0 * pause, 5.0)
        else:
            database.keep_reserve()
            return changed


def _judge(workplace: Workplace, claim: Claim, report: worker.Report) -> Problem | None:
    """Report what a process' last report means for the user."""
    match report:
        case worker.Refused(reason):
            return _unusable(reason)
        case worker.OutOfMemory():
            return _too_large(workplace.limits.memory)
        case worker.DiskFull():
            return _unkept(OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
        case worker.Crashed(traceback):
            _log.error("analysis %s met a bug:\n%s", claim.analysis, traceback)
            return _bug(claim)
    return None


def _judge_exit(workplace: Workplace, claim: Claim, exit_code: int | None) -> Problem:
    """Report what the silent death of one process after the other means for the user."""
    # Not killed by us, so by the kernel when memory ran out.
    return _too_large(workplace.limits.memory) if exit_code == -signal.SIGKILL else _bug(claim)


def _unusable(reason: str) -> Problem:
    return Problem.named("unusable-log", "The log cannot be analysed", HTTPStatus.UNPROCESSABLE_ENTITY, reason)


def _too_slow(limit: float) -> Problem:
    return Problem.named(
        "analysis-too-slow",
        "The analysis took too long",
        HTTPStatus.UNPROCESSABLE_ENTITY,
        f"The analysis was ended after {limit:g} s, the most that this service allows. Analyse a shorter log, or run "
        "`rotorid analyze` yourself, which has no limit.",
    )


def _too_large(limit: int) -> Problem:
    return Problem.named(
        "analysis-too-large",
        "The analysis needed too much memory",
        HTTPStatus.UNPROCESSABLE_ENTITY,
        f"The analysis needed more than the {sizes.in_words(limit)} that this service allows. Analyse a "
        "shorter log, or run `rotorid analyze` yourself, which has no limit.",
    )


def _bug(claim: Claim) -> Problem:
    return Problem.named(
        "analysis-crashed",
        "The analysis crashed",
        HTTPStatus.INTERNAL_SERVER_ERROR,
        "rotorid met something in this log that it does not handle. That is a mistake of rotorid, not yours; please "
        f"report it with the log and the reference {claim.analysis}, under which the service's log has the details.",
    )


def _unkept(error: OSError) -> Problem:
    return Problem.named(
        "results-not-kept",
        "The results could not be kept",
        HTTPStatus.INSUFFICIENT_STORAGE,
        f"The service could not write the results: {error.strerror or error}. Its operator has to make room; then try "
        "again.",
    )


_GONE = Problem.named(
    "log-gone",
    "The log is gone",
    HTTPStatus.UNPROCESSABLE_ENTITY,
    "The log was deleted before its analysis began. Upload it again.",
)
