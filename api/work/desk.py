"""Answers that need the numerical packages while somebody waits: from a process of their own.

The server itself does without those 200 MB, and whatever a log does to its reader it does not do to the server.
"""

import logging
import resource
import threading
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures import TimeoutError as LateError
from concurrent.futures.process import BrokenProcessPool
from http import HTTPStatus
from importlib import import_module
from pathlib import Path
from typing import Any

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
        self._limits = (memory, unpacked)
        self.patience = patience
        self._lock = threading.Lock()
        self._process: ProcessPoolExecutor | None = None

    def ask(self, question: str, *arguments: object) -> Any:
        """Ask a function of `api.machine.questions`."""
        process = self._running()
        try:
            answer, problem = process.submit(_answer, question, arguments).result(timeout=self.patience)
        except (LateError, BrokenProcessPool, MemoryError) as error:
            _log.warning("the question %s found no answer: %s", question, type(error).__name__)
            self._give_up(process)
            detail = "The answer took too long, or needed more memory than this service has for it. Try again."
            raise ProblemError.of("no-answer", detail) from error
        if problem:
            raise ProblemError.of("not-possible", problem)
        return answer

    def open(self) -> None:
        """Start the process: what it imports takes seconds, which nobody need wait for."""
        self._running().submit(_import_questions)

    def _running(self) -> ProcessPoolExecutor:
        with self._lock:
            if self._process is None:
                self._process = ProcessPoolExecutor(
                    1, CONTEXT, initializer=_limit, initargs=self._limits, max_tasks_per_child=_ANSWERS
                )
            return self._process

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
        with self._lock:
            process, self._process = self._process, None
        if process is not None:
            _end(process)

    def _give_up(self, process: ProcessPoolExecutor) -> None:
        with self._lock:
            if self._process is process:
                self._process = None
        _end(process)


def _end(process: ProcessPoolExecutor) -> None:
    for each in list((process._processes or {}).values()):  # nothing public ends one that does not answer
        each.kill()
    process.shutdown(wait=False, cancel_futures=True)


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
