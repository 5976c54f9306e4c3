"""Work on a second processor: the same result, whatever becomes of the process that does it."""

import os
import threading

import pytest

from pipeline.execution import second


def test_what_a_copy_finds_comes_back() -> None:
    result = second.begin(lambda: (os.getpid(), b"x" * 1_000_000))
    pid, made = result()
    assert len(made) == 1_000_000
    assert (pid != os.getpid()) == (second.processors() > 1)


def test_what_a_copy_does_not_bring_is_made_when_it_is_asked_for() -> None:
    here = os.getpid()

    def dies_in_the_copy() -> str:
        if os.getpid() != here:
            os._exit(9)
        return "done"

    assert second.begin(dies_in_the_copy)() == "done"


def test_a_copy_that_waits_for_ever_is_given_up() -> None:
    here, lock = os.getpid(), threading.Lock()
    lock.acquire()

    def waits_in_the_copy() -> str:
        if os.getpid() != here:
            lock.acquire()
        return "done"

    assert second.begin(waits_in_the_copy, longest=0.1)() == "done"


def test_an_error_of_the_work_is_raised_here() -> None:
    def fails() -> None:
        raise ValueError("of the work")

    result = second.begin(fails)
    with pytest.raises(ValueError, match="of the work"):
        result()
