"""Running analyses: each in a process of its own, so many at a time, within limits of time and memory."""

import asyncio
import logging
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from datetime import UTC, datetime
from http import HTTPStatus
from multiprocessing import forkserver
from multiprocessing.context import ForkServerProcess

from api import sizes, worker
from api.problems import Problem
from api.resources import Analysis, Log, State
from api.storage import Storage, new_id

_log = logging.getLogger("rotorid.api")

#: What the process that workers are forked from has imported already, so that an analysis starts at once.
PRELOAD = ("pipeline.flight", "reports.html")


class Runner:
    """Takes analyses, runs `workers` of them at a time and keeps their records up to date.

    A thread watches over each worker process; the threads' queue is the queue of analyses.
    """

    def __init__(
        self,
        storage: Storage,
        analyze: worker.Analyze = worker.analyze_log,
        *,
        workers: int,
        time_limit: float,
        memory_limit: int,
        preload: Sequence[str] = PRELOAD,
    ) -> None:
        self._storage = storage
        self._analyze = analyze
        self._time_limit = time_limit
        self._memory_limit = memory_limit
        self._preload = preload
        self._context = multiprocessing.get_context("forkserver")
        self._watchers = ThreadPoolExecutor(workers, thread_name_prefix="analysis")
        self._lock = threading.Lock()
        self._live: dict[str, Analysis] = {}
        self._futures: dict[str, Future[None]] = {}
        self._processes: set[ForkServerProcess] = set()
        self._closed = False

    def open(self) -> None:
        """Start the process that workers are forked from; it imports the pipeline while the server starts."""
        # Our matrices are small: BLAS threads only hurt them and each other. The workers inherit this.
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
        self._context.set_forkserver_preload(["__main__", "api.worker", "logparse", *self._preload])
        forkserver.ensure_running()

    def close(self) -> None:
        """End the running analyses and forget the waiting ones: from now on `find` says that they were interrupted."""
        with self._lock:
            self._closed = True
            for process in self._processes:
                process.kill()
        self._watchers.shutdown(wait=True, cancel_futures=True)

    def submit(self, log: Log) -> Analysis:
        """Accept an analysis of a log; OSError when its record cannot be written."""
        analysis = Analysis(id=new_id(), log=log)
        self._storage.save_analysis(analysis)
        with self._lock:
            if self._closed:
                return analysis
            self._live[analysis.id] = analysis
            future = self._watchers.submit(self._watch, analysis)
            self._futures[analysis.id] = future
        future.add_done_callback(lambda _: self._futures.pop(analysis.id, None))
        return analysis

    def find(self, analysis_id: str) -> Analysis | None:
        """Give the present state of an analysis; None when there is none of this id."""
        live = self._live.get(analysis_id)
        if live is not None and not self._closed:
            return live
        analysis = self._storage.load_analysis(analysis_id)
        if analysis is not None and not analysis.state.ended:
            return _failed(analysis, _INTERRUPTED)
        return analysis

    async def wait(self, analysis: Analysis) -> Analysis:
        """Wait for the end of an analysis and give its last state."""
        if future := self._futures.get(analysis.id):
            # `asyncio.wait` and not `await`: whoever waits may go away, and the analysis goes on.
            await asyncio.wait([asyncio.wrap_future(future)])
        return self.find(analysis.id) or analysis

    def _watch(self, analysis: Analysis) -> None:
        """Run one analysis from start to end; works in a thread of `_watchers`."""
        analysis = analysis.model_copy(update={"state": State.RUNNING, "started": datetime.now(UTC)})
        self._live[analysis.id] = analysis
        try:
            self._storage.save_analysis(analysis)
            problem = self._run(analysis)
            if problem is None:
                self._storage.keep_results(analysis)
                analysis = _ended(analysis, State.DONE)
            else:
                self._storage.drop_scratch(analysis)
                analysis = _failed(analysis, problem)
            self._storage.save_analysis(analysis)
        except OSError as error:
            _log.exception("analysis %s: cannot keep its results", analysis.id)
            self._live[analysis.id] = _failed(analysis, _unkept(error))
        else:
            del self._live[analysis.id]

    def _run(self, analysis: Analysis) -> Problem | None:
        """Let a worker process do the analysis; gives what went wrong, or None when the results are there."""
        receiver, sender = self._context.Pipe(duplex=False)
        process = self._context.Process(
            target=worker.run,
            args=(
                sender,
                self._analyze,
                self._storage.log_path(analysis.log),
                analysis.log.name,
                self._storage.scratch(analysis),
                self._time_limit,
                self._memory_limit,
            ),
            daemon=True,
        )
        with self._lock:
            if self._closed:
                return _INTERRUPTED
            process.start()
            self._processes.add(process)
        sender.close()
        deadline = time.monotonic() + self._time_limit
        try:
            while receiver.poll(max(0.0, deadline - time.monotonic())):
                report = receiver.recv()
                if not isinstance(report, worker.Advanced):
                    return self._judge(analysis, report)
                self._live[analysis.id] = self._live[analysis.id].model_copy(
                    update={"stage": report.stage, "progress": report.progress}
                )
            return _too_slow(self._time_limit)
        except (EOFError, OSError):
            process.join()
            return self._judge_exit(analysis, process.exitcode)
        finally:
            process.kill()
            process.join()
            with self._lock:
                self._processes.discard(process)
            process.close()
            receiver.close()

    def _judge(self, analysis: Analysis, report: worker.Report) -> Problem | None:
        """Say what a worker's last report means for the user."""
        match report:
            case worker.Refused(reason):
                return _unusable(reason)
            case worker.OutOfMemory():
                return _too_large(self._memory_limit)
            case worker.Crashed(traceback):
                _log.error("analysis %s of %r met a bug:\n%s", analysis.id, analysis.log.name, traceback)
                return _bug(analysis)
        return None

    def _judge_exit(self, analysis: Analysis, exit_code: int | None) -> Problem:
        """Say what the silent death of a worker means for the user."""
        if self._closed:
            return _INTERRUPTED
        if exit_code == -signal.SIGKILL:  # Not by us, so by the kernel when memory ran out.
            return _too_large(self._memory_limit)
        _log.error("analysis %s of %r died with exit code %s", analysis.id, analysis.log.name, exit_code)
        return _bug(analysis)


def _ended(analysis: Analysis, state: State) -> Analysis:
    return analysis.model_copy(update={"state": state, "stage": "", "progress": 1.0, "ended": datetime.now(UTC)})


def _failed(analysis: Analysis, problem: Problem) -> Analysis:
    return _ended(analysis, State.FAILED).model_copy(update={"problem": problem})


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


def _bug(analysis: Analysis) -> Problem:
    return Problem.named(
        "analysis-crashed",
        "The analysis crashed",
        HTTPStatus.UNPROCESSABLE_ENTITY,
        "rotorid met something in this log that it does not handle. That is a mistake of rotorid, not yours; please "
        f"report it with the log and the number {analysis.id}, under which the service's own log has the details.",
    )


def _unkept(error: OSError) -> Problem:
    return Problem.named(
        "results-not-kept",
        "The results could not be kept",
        HTTPStatus.INSUFFICIENT_STORAGE,
        f"The service could not write the results: {error.strerror}. Its operator has to make room; then try again.",
    )


_INTERRUPTED = Problem.named(
    "analysis-interrupted",
    "The analysis was interrupted",
    HTTPStatus.SERVICE_UNAVAILABLE,
    "The service was stopped during this analysis. The log is kept; start the analysis again.",
)
