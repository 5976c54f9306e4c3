"""Working on one claimed analysis: fetch its logs, let a process analyse them, keep the claim alive, keep the results.

This runs in a thread of a server or worker; the analysis is a process of its own, which can be ended when it takes too
long, and the database and the storage are the only things shared.
"""

import logging
import multiprocessing
import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import forkserver
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path

from sqlalchemy import make_url, select
from sqlalchemy.exc import SQLAlchemyError

from api.problems import Problem
from api.settings import Settings
from api.store.database import Database
from api.store.records import AnalysisRecord, FlightRecord
from api.work import worker
from api.work.outcome import Reached, read_outcome
from api.work.queue import Claim, Heartbeat, LostError, Queue
from pipeline.names import folder_names
from pipeline.storage.store import Store, open_store
from reports import PRELOAD

_log = logging.getLogger("rotorid.api")

#: How processes that do the work are made.
CONTEXT = multiprocessing.get_context("forkserver")

#: Seconds for which the end of an analysis is kept ready while the database cannot take it.
_PATIENCE = 120.0


@dataclass(frozen=True, slots=True)
class Workplace:
    """What every thread that works is told."""

    database: Database
    objects: Store
    settings: Settings
    scratch: Path  #: Where temporary folders are made.
    analyze: worker.Analyze  #: What to do with a task; a function of a module.
    preload: Sequence[str] = PRELOAD  #: Modules that `analyze` uses and that are worth importing once for all analyses.

    @property
    def queue(self) -> Queue:
        """The queue under the rules of the settings."""
        return Queue(self.database, lease=self.settings.lease, deaths=self.settings.deaths)

    def warm_up(self) -> None:
        """Start the process that analyses are forked from; it imports the pipeline meanwhile."""
        # Our matrices are small: BLAS threads only hurt them and each other. The workers inherit this.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        # The kernel ends a child with the thread that started it: only the main thread is sure to outlast the others.
        mortal = ["api.work.mortal"] if threading.current_thread() is threading.main_thread() else []
        CONTEXT.set_forkserver_preload([*mortal, "__main__", "api.work.worker", "logparse", *self.preload])
        forkserver.ensure_running()


def limits_of(settings: Settings) -> worker.TaskLimits:
    """Return what one analysis may take, and where the service keeps what is none of its business."""
    database, storage = make_url(settings.database_url), open_store(settings.storage_url).folder
    file = database.database if database.get_backend_name() == "sqlite" else None
    closed = (settings.data, *([storage] if storage else []), *([Path(file)] if file else []))
    return worker.TaskLimits(settings.time_limit, settings.memory_limit, settings.upload_limit, closed)


def work(workplace: Workplace, claim: Claim, stopping: Callable[[], bool]) -> None:
    """Work on a claimed analysis until it has ended, the claim is lost, or `stopping` says so."""
    workplace.warm_up()
    queue, objects = workplace.queue, workplace.objects

    def persist(change: Callable[[], bool]) -> bool:
        return _persist(workplace.database, change)

    with Heartbeat(queue, claim, workplace.settings.lease) as heartbeat:
        try:
            with tempfile.TemporaryDirectory(prefix="rotorid-", dir=workplace.scratch) as name:
                folder = Path(name)
                fetch = _fetch_members if claim.craft else _fetch_logs
                task = fetch(workplace, claim, folder, heartbeat)
                task.folder.mkdir()
                problem = _analyse(workplace, claim, heartbeat, task, stopping)
                if problem is not None:
                    persist(lambda: queue.fail(claim, problem))
                    return
                outcome = read_outcome(task.folder)
                files = _keep(claim, objects, task.folder, heartbeat)
                if not persist(lambda: queue.finish(claim, files, outcome)):
                    objects.remove(f"analyses/{claim.analysis}/{claim.lease}")
        except _StoppedError:
            queue.give_back(claim)
        except _DiedError as death:
            if not persist(lambda: queue.retry(claim)):
                # Not killed by us, so by the kernel when memory ran out.
                out_of_memory = death.exit_code == -signal.SIGKILL
                memory = workplace.settings.memory_limit
                last = worker.too_large(memory) if out_of_memory else worker.crashed(claim.analysis)
                persist(lambda: queue.fail(claim, last))
        except LostError:
            objects.remove(f"analyses/{claim.analysis}/{claim.lease}")
            _log.info("analysis %s was cancelled, or given to another worker", claim.analysis)
        except FileNotFoundError:
            _log.exception("analysis %s: a log is gone", claim.analysis)
            gone = Problem.of("log-gone", "The log was deleted before its analysis began. Upload it again.")
            persist(lambda: queue.fail(claim, gone))
        except OSError as error:
            _log.exception("analysis %s: cannot keep its results", claim.analysis)
            unkept = worker.unkept(error)
            persist(lambda: queue.fail(claim, unkept))


class _StoppedError(Exception):
    """The server stops."""


class _DiedError(Exception):
    """The process died without a word, and not by our hand."""

    def __init__(self, exit_code: int | None) -> None:
        super().__init__(f"exit code {exit_code}")
        self.exit_code = exit_code


def _fetch_logs(workplace: Workplace, claim: Claim, folder: Path, heartbeat: Heartbeat) -> worker.Task:
    """Bring the logs to this computer, under names of which nothing is taken on trust."""
    safe = folder_names([name for _, name in claim.logs])
    logs = []
    for number, (log_id, name) in enumerate(claim.logs, start=1):
        heartbeat.check()
        path = folder / "logs" / str(number) / safe[name]  # logs of one analysis may have the same name
        path.parent.mkdir(parents=True)
        workplace.objects.get(f"logs/{log_id}", path)
        logs.append((path, name))
    return worker.Task(logs, claim.configuration, folder / "results", reference=claim.analysis)


def _fetch_members(workplace: Workplace, claim: Claim, folder: Path, heartbeat: Heartbeat) -> worker.Task:
    """Bring the experiments of the flights of a joint fit to this computer, as they were when it was ordered."""
    wanted = claim.configuration["flights"]
    with workplace.database.read() as session:
        rows = session.execute(
            select(FlightRecord, AnalysisRecord)
            .join(AnalysisRecord, AnalysisRecord.id == FlightRecord.analysis_id)
            .where(FlightRecord.id.in_(wanted), FlightRecord.craft_id == claim.craft)
            .order_by(FlightRecord.added)
        ).all()
    if len(rows) < len(wanted):
        raise FileNotFoundError(f"of {len(wanted)} flights of the craft {len(rows)} are there")
    members = []
    for number, (flight, analysis) in enumerate(rows, start=1):
        experiments, mine = {}, f"/flight={flight.entry['folder']}/"  # experiments/KIND/.../flight=F/...
        for name in analysis.files:
            if name.startswith("experiments/") and mine in name:
                heartbeat.check()
                kind = name.split("/")[1]
                experiments[kind] = folder / "flights" / str(number) / f"{kind}.parquet"
                experiments[kind].parent.mkdir(parents=True, exist_ok=True)
                workplace.objects.get(f"analyses/{analysis.id}/{analysis.results}/{name}", experiments[kind])
        members.append(worker.Member(flight.name, flight.entry, experiments))
    return worker.Task([], claim.configuration, folder / "results", members, claim.analysis)


def _keep(claim: Claim, objects: Store, folder: Path, heartbeat: Heartbeat) -> dict[str, int]:
    """Move the results to the storage; gives every file's size by its name."""
    files = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            heartbeat.check()
            name = path.relative_to(folder).as_posix()
            files[name] = path.stat().st_size
            objects.put(path, f"analyses/{claim.analysis}/{claim.lease}/{name}")
    return files


def _analyse(
    workplace: Workplace, claim: Claim, heartbeat: Heartbeat, task: worker.Task, stopping: Callable[[], bool]
) -> Problem | None:
    """Run the task in a process; return what went wrong, or None when the results are there."""
    with _process(workplace, task) as (process, receiver):
        limit = workplace.settings.time_limit
        deadline = time.monotonic() + limit
        last = Reached()
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
            if isinstance(report, worker.Ended):
                if report.traceback:
                    _log.error("analysis %s met a bug:\n%s", claim.analysis, report.traceback)
                ended: Problem | None = report.problem
                return ended
            if report != replace(last, progress=report.progress) or report.progress >= last.progress + 0.02:
                last = report
                heartbeat.reach(report)
        return Problem.of(
            "analysis-too-slow",
            f"The analysis was ended after {limit:g} s, the most that this service allows. Analyse a shorter log, or "
            "run `rotorid analyze` yourself, which has no limit.",
        )


@contextmanager
def _process(workplace: Workplace, task: worker.Task) -> Iterator[tuple[ForkServerProcess, Connection]]:
    """Start a process for a task; it is gone afterwards, whatever it was doing."""
    receiver, sender = CONTEXT.Pipe(duplex=False)
    process = CONTEXT.Process(
        target=worker.run,
        args=(sender, workplace.analyze, task, limits_of(workplace.settings), workplace.settings.log_format),
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
