"""Answers that need the numerical packages while somebody waits: from a process of their own.

The server itself does without those 200 MB, and whatever a log does to its reader it does not do to the server.
"""

import logging
import resource
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from http import HTTPStatus
from importlib import import_module
from pathlib import Path
from typing import Any

from pebble import ProcessExpired, ProcessPool

from api.problems import ProblemError
from api.work.confinement import die_with_parent
from api.work.watch import CONTEXT
from logparse.containers import MAX_UNPACKED_BYTES, limit_unpacked

_log = logging.getLogger("rotorid.api")

#: Answers after which the process is replaced, so that what it keeps of logs does not grow for ever.
_ANSWERS = 500


class Desk:
    """One process that answers one question after the other; started with the first."""

    def __init__(self, memory: int, patience: float = 90.0, unpacked: int = MAX_UNPACKED_BYTES) -> None:
        self.patience = patience  #: Seconds for one answer.
        self._make = partial(
            ProcessPool, 1, max_tasks=_ANSWERS, initializer=_limit, initargs=(memory, unpacked), context=CONTEXT
        )
        self._process = self._make()

    def ask(self, question: str, *arguments: object) -> Any:
        """Ask a function of `api.machine.questions`."""
        if not self._process.active:  # it was killed while it had nothing to do
            self._process = self._make()
        try:
            answer, problem = self._process.schedule(_answer, (question, arguments), timeout=self.patience).result()
        except (TimeoutError, ProcessExpired, BrokenProcessPool, MemoryError) as error:
            _log.warning("the question %s found no answer: %s", question, type(error).__name__)
            detail = "The answer took too long, or needed more memory than this service has for it. Try again."
            raise ProblemError.of("no-answer", detail) from error
        if problem:
            raise ProblemError.of("not-possible", problem)
        return answer

    def open(self) -> None:
        """Start the process: what it imports takes seconds, which nobody need wait for."""
        self._process.schedule(_import_questions)

    def refuse_junk(self, file: Path, name: str) -> None:
        """Raise ProblemError if a file does not begin like a log; one that nobody can look at now passes."""
        try:
            self.ask("recognise", file, name)
        except ProblemError as error:
            if error.problem.status == HTTPStatus.SERVICE_UNAVAILABLE:
                return
            detail = f"{error.problem.detail.rstrip('.')}."
            raise ProblemError.of("unusable-log", detail) from error

    def close(self) -> None:
        """End the process."""
        self._process.stop()  # type: ignore[no-untyped-call]
        self._process.join()


def _import_questions() -> None:
    import_module("api.machine.questions")


def _limit(memory: int, unpacked: int) -> None:
    die_with_parent()  # which waits for questions without end, also where nobody is left to ask
    limit_unpacked(unpacked)
    resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))


def _answer(question: str, arguments: tuple[object, ...]) -> tuple[Any, str]:
    """Answer in the process: the answer, and why there is none."""
    questions = import_module("api.machine.questions")
    try:
        return getattr(questions, question)(*arguments), ""
    except questions.QuestionError as error:
        return None, str(error)
