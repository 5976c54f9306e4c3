"""Processes that analyse logs side by side, and outlive those that a log takes down with it.

`Processes` is a `concurrent.futures.Executor` like the pool of the standard library, except that it knows which call a
process died of: only that call is tried again, alone, and only it fails in the end.
"""

import multiprocessing
import os
import pickle
import shutil
import signal
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager
from itertools import islice
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import psutil

from pipeline.execution.machine import available_memory, pin_threads, processors
from pipeline.execution.memory import collect_seldom

T = TypeVar("T")
R = TypeVar("R")

#: What the process that workers are forked from has imported already: each starts at once and shares its memory.
PRELOAD = ("pipeline.execution.compiling", "pipeline.fleet.job")

#: How many processes may die of one call: by the first it was perhaps only unlucky to be beside a larger one.
ATTEMPTS = 3

#: Memory of a worker, bytes: of the imported packages, and for each byte of its log (measured, see docs/scaling.md).
BASE_MEMORY = 450_000_000
MEMORY_PER_BYTE = 4.0

#: Part of the available memory that workers may plan with.
PLANNED = 0.8

#: A worker that holds this much more than at its start, bytes, after its call is replaced: memory that allocators
#: do not give back after a large log would be missing elsewhere.
KEPT_MEMORY = 300_000_000


def count_workers(sizes: Sequence[int], memory: int | None = None, cores: int | None = None) -> int:
    """Choose how many logs to analyse at the same time: as many as there are processors, and memory for."""
    left = PLANNED * (available_memory() if memory is None else memory)
    count = 0
    for size in sorted(sizes, reverse=True)[: processors() if cores is None else cores]:
        left -= BASE_MEMORY + MEMORY_PER_BYTE * size
        if left < 0:
            break
        count += 1
    return max(1, count)


@contextmanager
def processes(count: int | None, sizes: Sequence[int], preload: Sequence[str] = PRELOAD) -> Iterator["Processes"]:
    """Return an executor of `count` processes, or as many as suit this computer and the logs' sizes in bytes.

    Whatever ends the ``with`` early, such as Ctrl-C, ends the processes at once.
    """
    chosen = count_workers(sizes) if count is None else max(1, min(count, len(sizes)))
    with Processes(chosen, preload) as executor:
        yield executor


def as_done(executor: Executor, function: Callable[[T], R], tasks: Iterable[T]) -> Iterator[tuple[T, Future[R]]]:
    """Make a function called for each task, and give each with its outcome as it ends.

    However many tasks there are, only a few more than there are workers are in flight.
    """
    left = iter(tasks)
    waiting: dict[Future[R], T] = {}
    while True:
        for task in islice(left, max(0, busy(executor) - len(waiting))):
            waiting[_submit(executor, function, task)] = task
        if not waiting:
            return
        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
        for future in done:
            yield waiting.pop(future), future


def busy(executor: Executor) -> int:
    """Report how many calls keep all workers of an executor busy."""
    width = getattr(executor, "in_flight", None)
    return width if isinstance(width, int) else 2 * processors()


def _submit(executor: Executor, function: Callable[[T], R], task: T) -> Future[R]:
    """Submit a call; where the executor has broken, the call fails and not the loop over all of them."""
    try:
        return executor.submit(function, task)
    except BrokenExecutor as error:
        failed: Future[R] = Future()
        failed.set_exception(error)
        return failed


class WorkerDiedError(BrokenExecutor):
    """Every process that worked on a call died of it; the message says so to the person who has the log."""


class Processes(Executor):
    """Worker processes, each with a thread here that hands it one call at a time.

    They are forked from a fresh process that has imported the packages once, never from this one: threads of a progress
    display do not survive a fork.

    Parameters
    ----------
    count : int
        Workers, and so calls at the same time.
    preload : sequence of str
        Modules that calls use and that are worth importing once for all workers.
    """

    def __init__(self, count: int, preload: Sequence[str] = PRELOAD) -> None:
        pin_threads()
        methods = multiprocessing.get_all_start_methods()
        self._context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
        if "forkserver" in methods:
            self._context.set_forkserver_preload(list(preload))
        self.count = count
        self._threads = ThreadPoolExecutor(count, thread_name_prefix="worker")
        self._scratch = Path(tempfile.mkdtemp(prefix="rotorid-"))
        self._idle: list[_Worker] = []
        self._busy: set[_Worker] = set()
        self._lock = threading.Lock()
        self._alone = _Precedence()
        self._killed = False

    @property
    def in_flight(self) -> int:
        """How many calls keep all workers busy: one is ready for each that ends."""
        return 2 * self.count

    def submit(self, function: Callable[..., R], /, *args: Any, **named: Any) -> Future[R]:
        """Make a function called in one of the processes.

        The future raises `WorkerDiedError` where the call took down every process that it was tried in.
        """
        return self._threads.submit(self._call, function, args, named)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers when they have done what was submitted, or what they are at with `cancel_futures`."""
        self._threads.shutdown(wait=wait, cancel_futures=cancel_futures)
        with self._lock:
            idle, self._idle = self._idle, []
        for worker in idle:
            worker.close()
        if wait:
            shutil.rmtree(self._scratch, ignore_errors=True)

    def kill(self) -> None:
        """End the workers at once, whatever they are at."""
        with self._lock:
            self._killed = True
            for worker in self._busy:
                worker.kill()
        self.shutdown(cancel_futures=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the workers: at once where the ``with`` ends by an exception."""
        if error is None:
            self.shutdown()
        else:
            self.kill()

    def __enter__(self) -> Self:
        return self

    def _call(self, function: Callable[..., R], args: tuple[Any, ...], named: dict[str, Any]) -> R:
        """Run one call, from the thread that waits for it."""
        call = pickle.dumps((function, args, named), pickle.HIGHEST_PROTOCOL)
        for attempt in range(ATTEMPTS):
            # What took a process down, by taking too much memory for one, is tried again with nobody beside it.
            with self._alone.others_wait() if attempt else self._alone.beside_others():
                worker = self._take()
                try:
                    succeeded, outcome = worker.do(call)
                except _DeathError as death:
                    exit_code = death.exit_code
                    if self._killed:
                        raise CancelledError from None
                    continue
                finally:
                    self._put_back(worker)
            if succeeded:
                return outcome  # type: ignore[no-any-return]
            raise outcome
        raise WorkerDiedError(_epitaph(exit_code))

    def _take(self) -> "_Worker":
        """Return an idle worker, or a new one."""
        with self._lock:
            if self._killed:
                raise CancelledError
            worker = self._idle.pop() if self._idle else _Worker(self._context, self._scratch)
            self._busy.add(worker)
        return worker

    def _put_back(self, worker: "_Worker") -> None:
        """Keep a worker for the next call, unless it is dead or has grown."""
        keep = worker.alive and worker.grown <= KEPT_MEMORY
        with self._lock:
            self._busy.discard(worker)
            if keep:
                self._idle.append(worker)
        if not keep:
            worker.close()


def _epitaph(exit_code: int | None) -> str:
    """Report what the processes died of."""
    if exit_code is not None and exit_code < 0:
        try:
            name = signal.Signals(-exit_code).name
        except ValueError:
            name = f"signal {-exit_code}"
        how = f"was killed ({name})"
        if -exit_code == signal.SIGKILL:
            how += ", as the system does when memory runs out"
    else:
        how = f"ended with exit code {exit_code}"
    return f"the process that worked on it {how}, {ATTEMPTS} times, the last with nothing else beside it"


class _Precedence:
    """A lock of two kinds: calls run beside each other, or one alone, for which the others wait."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._running = 0
        self._alone = False

    @contextmanager
    def beside_others(self) -> Iterator[None]:
        """Run as soon as nobody runs alone."""
        with self._changed:
            self._changed.wait_for(lambda: not self._alone)
            self._running += 1
        try:
            yield
        finally:
            with self._changed:
                self._running -= 1
                self._changed.notify_all()

    @contextmanager
    def others_wait(self) -> Iterator[None]:
        """Keep others from beginning, and run when those that have begun are done."""
        with self._changed:
            self._changed.wait_for(lambda: not self._alone)
            self._alone = True
            self._changed.wait_for(lambda: not self._running)
        try:
            yield
        finally:
            with self._changed:
                self._alone = False
                self._changed.notify_all()


class _DeathError(Exception):
    """A worker died."""

    def __init__(self, exit_code: int | None) -> None:
        super().__init__(exit_code)
        self.exit_code = exit_code


class _Worker:
    """One process and the pipe to it."""

    def __init__(self, context: Any, scratch: Path) -> None:
        #: Where the process leaves temporary files; whoever kills it leaves them to us.
        self._folder = Path(tempfile.mkdtemp(dir=scratch))
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, self._folder), daemon=True)
        self._process.start()
        theirs.close()
        self.alive = True
        #: How much more memory than at its start it held after the last call, bytes.
        self.grown = 0

    def do(self, call: bytes) -> tuple[bool, Any]:
        """Make a call done: whether it succeeded, and its result or exception."""
        try:
            self._pipe.send_bytes(call)
            answer = self._pipe.recv_bytes()
        except (EOFError, OSError):
            self.alive = False
            self._process.join()
            raise _DeathError(self._process.exitcode) from None
        succeeded, outcome, self.grown = pickle.loads(answer)
        return succeeded, outcome

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()

    def close(self) -> None:
        """End the process, which waits for calls, and clear up after it."""
        self._pipe.close()
        self._process.join()
        self._process.close()
        shutil.rmtree(self._folder, ignore_errors=True)


def _end_with_parent(scratch: Path) -> None:
    """End this process when the one that started it is gone, however that ended: nobody waits for the call then."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    shutil.rmtree(scratch.parent, ignore_errors=True)
    os._exit(1)


def _work(pipe: Connection, scratch: Path) -> None:
    """Do calls in a worker process until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for whoever started us, who ends us.
    threading.Thread(target=_end_with_parent, args=(scratch,), daemon=True).start()
    tempfile.tempdir = str(scratch)
    collect_seldom()
    own = psutil.Process()
    at_start = own.memory_info().rss
    while True:
        try:
            call = pipe.recv_bytes()
        except EOFError:
            return
        succeeded, outcome = _attempt(call)
        grown = own.memory_info().rss - at_start
        try:
            answer = pickle.dumps((succeeded, outcome, grown), pickle.HIGHEST_PROTOCOL)
            if not succeeded:
                pickle.loads(answer)  # exceptions may be pickled in ways that cannot be undone
        except Exception as error:
            what = f"{type(outcome).__name__} cannot be sent between processes: {error}"
            answer = pickle.dumps((False, TypeError(what), grown), pickle.HIGHEST_PROTOCOL)
        del call, outcome
        try:
            pipe.send_bytes(answer)
        except BrokenPipeError:  # nobody waits for it any more
            return


def _attempt(call: bytes) -> tuple[bool, Any]:
    """Do a call: whether it succeeded, and its result or exception."""
    try:
        function, args, named = pickle.loads(call)
        return True, function(*args, **named)
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))  # tracebacks do not travel
        return False, error
