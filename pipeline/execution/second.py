"""A part of one analysis done on a second processor meanwhile, where there is one."""

import os
import pickle
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TypeVar, cast

from pipeline.execution.machine import processors

T = TypeVar("T")

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
