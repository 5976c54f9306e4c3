"""Processes that analyse logs side by side, and outlive those that a log takes down with it.

Pebble's pool knows which call a process died of, so that only this call is tried again, alone, and only it fails in the
end; here it has the interface of `concurrent.futures`, as the workers of a cluster have.
"""

import logging
import multiprocessing
import os
import pickle
import shutil
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor, Future, wait
from contextlib import contextmanager, suppress
from functools import partial
from itertools import islice
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar, cast

from core.lazy import lazy
from pipeline.execution.machine import available_memory, collect_seldom, pin_threads, processors, trim_heap

if TYPE_CHECKING:
    import pebble
else:
    pebble = lazy("pebble")  # a log that is analysed alone needs no pool

_LOG = logging.getLogger("rotorid.pipeline")

T = TypeVar("T")
R = TypeVar("R")


def count_workers(sizes: Sequence[int], memory: int | None = None, cores: int | None = None) -> int:
    """Choose how many logs to analyse at the same time: as many as there are processors, and memory for."""
    # Part of the available memory that workers may plan with.
    left = 0.8 * (available_memory() if memory is None else memory)
    count = 0
    for size in sorted(sizes, reverse=True)[: processors() if cores is None else cores]:
        # Memory of a worker, bytes: of the imported packages, and for each byte of its log (measured, see
        # docs/scaling.md).
        left -= 450_000_000 + 4.0 * size
        if left < 0:
            break
        count += 1
    return max(1, count)


@contextmanager
def processes(count: int | None, sizes: Sequence[int], preload: Sequence[str] = ()) -> Iterator["Processes"]:
    """Return an executor of `count` processes, or as many as suit this computer and the logs' sizes in bytes.

    Whatever ends the ``with`` early, such as Ctrl-C, ends the processes at once. The process that they are forked from
    imports `preload` once for all: each starts at once and shares its memory.
    """
    chosen = count_workers(sizes) if count is None else max(1, min(count, len(sizes)))
    with Processes(chosen, preload) as executor:
        yield executor


def as_done(executor: Executor, function: Callable[[T], R], tasks: Iterable[T]) -> Iterator[tuple[T, Future[R]]]:
    """Make a function called for each task, and give each with its outcome as it ends.

    However many tasks there are, only a few more than there are workers are in flight. What took a process down, by
    taking too much memory for one, is tried again at the end, with nothing beside it.
    """
    left = iter(tasks)
    waiting: dict[Future[R], T] = {}
    died: list[T] = []
    while True:
        for task in islice(left, max(0, busy(executor) - len(waiting))):
            waiting[_submit(executor, function, task)] = task
        if not waiting:
            break
        done, _ = wait(waiting, return_when=FIRST_COMPLETED)
        for future in done:
            task = waiting.pop(future)
            if isinstance(executor, Processes) and isinstance(future.exception(), WorkerDiedError):
                died.append(task)
            else:
                yield task, future
    for task in died:
        future = _submit(executor, function, task)
        wait([future])
        yield task, future


def outcomes(
    executor: Executor | None, function: Callable[[T], R], tasks: Iterable[T]
) -> Iterator[tuple[T, "R | WorkerDiedError"]]:
    """Yield each task with its result as it ends, or with why its worker has none; without an executor one by one."""
    if executor is None:
        yield from ((task, function(task)) for task in tasks)
        return
    for task, future in as_done(executor, function, tasks):
        error = future.exception()
        if error is not None and not isinstance(error, WorkerDiedError):  # it died, or its result could not come back
            _LOG.error("a worker failed", exc_info=error)
            error = WorkerDiedError(f"the worker process failed: {type(error).__name__}: {error}")
        yield task, future.result() if error is None else error


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
    """The process that worked on a call died; the message says so to the person who has the log."""


class Processes(Executor):
    """So many worker processes, which end when whoever started them does.

    They are forked from a fresh process that has imported the packages once, never from this one: threads of a progress
    display do not survive a fork.
    """

    def __init__(self, count: int, preload: Sequence[str] = ()) -> None:
        pin_threads()
        methods = multiprocessing.get_all_start_methods()
        context: Any = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
        if "forkserver" in methods:
            context.set_forkserver_preload(list(preload))
        self.count = count
        #: Where the processes leave temporary files.
        self._scratch = Path(tempfile.mkdtemp(prefix="rotorid-"))
        self._pool = pebble.ProcessPool(count, context=context, initializer=_begin, initargs=(self._scratch,))

    @property
    def in_flight(self) -> int:
        """How many calls keep all workers busy: one is ready for each that ends."""
        return 2 * self.count

    def submit(self, function: Callable[..., R], /, *args: Any, **named: Any) -> Future[R]:
        """Make a function called in one of the processes; `WorkerDiedError` where it takes the process down."""
        future: Future[R] = Future()
        theirs = self._pool.schedule(_call, (function, args, named))
        theirs.add_done_callback(partial(_hand_over, future))
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the workers when they have done what was submitted, or at once with `cancel_futures`."""
        if cancel_futures:
            self._pool.stop()  # type: ignore[no-untyped-call]
        else:
            self._pool.close()  # type: ignore[no-untyped-call]
        if wait:
            self._pool.join()
            shutil.rmtree(self._scratch, ignore_errors=True)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """End the workers: at once where the ``with`` ends by an exception."""
        self.shutdown(cancel_futures=error is not None)


def _hand_over(future: Future[Any], theirs: Future[bytes]) -> None:
    """Return the outcome of a call in the pool to whoever waits for it."""
    succeeded, outcome = False, None
    try:
        succeeded, outcome = pickle.loads(theirs.result())
    except pebble.ProcessExpired as death:
        outcome = WorkerDiedError(_epitaph(death.exitcode))
    except (Exception, CancelledError) as error:  # it could not be sent, or the pool was stopped
        outcome = error
    if not future.set_running_or_notify_cancel():
        return
    if succeeded:
        future.set_result(outcome)
    else:
        future.set_exception(outcome)


def _epitaph(exit_code: int | None) -> str:
    """Report what the processes died of."""
    if exit_code is None or exit_code >= 0:
        how = f"ended with exit code {exit_code}"
    else:
        known = -exit_code in {member.value for member in signal.Signals}
        name = signal.Signals(-exit_code).name if known else f"signal {-exit_code}"
        system = ", as the system does when memory runs out" if -exit_code == signal.SIGKILL else ""
        how = f"was killed ({name}){system}"
    return f"the process that worked on it {how}, the last time with nothing else beside it"


def _begin(scratch: Path) -> None:
    """Prepare a worker process, which ends when the one that started it is gone, however that ended."""
    parent = multiprocessing.parent_process()
    assert parent is not None

    def end() -> None:
        parent.join()
        shutil.rmtree(scratch, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()
    tempfile.tempdir = str(scratch)
    collect_seldom()


def _call(function: Callable[..., object], args: tuple[Any, ...], named: dict[str, Any]) -> bytes:
    """Do a call in a worker process: whether it succeeded, and its result or exception."""
    outcome: object
    try:
        succeeded, outcome = True, function(*args, **named)
    except Exception as error:
        error.add_note("".join(traceback.format_exception(error)))  # tracebacks do not travel
        succeeded, outcome = False, error
    trim_heap()  # a large log leaves much
    try:
        answer = pickle.dumps((succeeded, outcome), pickle.HIGHEST_PROTOCOL)
        if not succeeded:
            pickle.loads(answer)  # exceptions may be pickled in ways that cannot be undone
    except Exception as error:
        what = f"{type(outcome).__name__} cannot be sent between processes: {error}"
        answer = pickle.dumps((False, TypeError(what)), pickle.HIGHEST_PROTOCOL)
    return answer


#: Longest that a copy may take, s: it may wait for ever for a lock that another thread held when it was made.
_LONGEST = 600.0


def begin(work: Callable[[], T], longest: float = _LONGEST) -> Callable[[], T]:
    """Begin work in a copy of this process, and return a function that waits for its result.

    The copy knows all that this process knows, and what it changes stays with it. Only a process that has no other work
    in its threads may be copied. With one processor, without Linux, or when the copy comes to nothing, the work is done
    when its result is asked for.
    """
    if not sys.platform.startswith("linux") or processors() < 2:
        return work
    reading, writing = os.pipe()
    pid = os.fork()
    if pid == 0:
        _work(work, reading, writing, longest)
    os.close(writing)

    def result() -> T:
        with os.fdopen(reading, "rb") as file:
            made = file.read()
        with suppress(ChildProcessError):  # somebody else waited for it
            os.waitpid(pid, 0)
        try:
            return cast(T, pickle.loads(made))
        except (EOFError, pickle.UnpicklingError):
            return work()

    return result


def _work(work: Callable[[], object], reading: int, writing: int, longest: float) -> None:
    """Write the result of the work and end this process at once, without what its original has to do at its end."""
    try:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends the process whatever it waits for
        signal.setitimer(signal.ITIMER_REAL, longest)
        os.close(reading)
        made = pickle.dumps(work(), pickle.HIGHEST_PROTOCOL)
        with os.fdopen(writing, "wb") as file:
            file.write(made)
    finally:
        os._exit(0)
