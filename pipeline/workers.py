"""Processes that analyse logs side by side."""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager


@contextmanager
def pool(count: int) -> Iterator[Executor | None]:
    """Give an executor of `count` processes; None, for this process, when one is enough.

    The processes are forked from a fresh one that has imported the rooms once, never from this one: threads of the
    progress display do not survive a fork.
    """
    if count <= 1:
        yield None
        return
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    if "forkserver" in methods:
        context.set_forkserver_preload(["pipeline.flight"])
    executor = ProcessPoolExecutor(count, mp_context=context)
    try:
        yield executor
    finally:
        executor.shutdown(cancel_futures=True)
