"""Work that a server does again and again in a thread of its own: analyses, housekeeping, reviews, webhooks."""

import logging
import threading
from abc import ABC, abstractmethod

from sqlalchemy.exc import SQLAlchemyError

from api.problems import ProblemError

_log = logging.getLogger("rotorid.api")


class Rounds(ABC):
    """Goes round until it is closed; a round that fails is logged, and the next one may do better."""

    def __init__(self, name: str, interval: float) -> None:
        self._interval = interval
        self._closing, self._woken = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._go_on, name=name, daemon=True)

    @abstractmethod
    def go_round(self) -> None:
        """Do one round."""

    @property
    def closing(self) -> bool:
        """Whether the round that is being done should end soon."""
        return self._closing.is_set()

    def open(self) -> None:
        """Start."""
        self._thread.start()

    def wake(self) -> None:
        """Begin the next round at once."""
        self._woken.set()

    def stop(self) -> None:
        """Begin no further round."""
        self._closing.set()
        self.wake()

    def close(self) -> None:
        """Stop after what is being done."""
        self.stop()
        if self._thread.is_alive():
            self._thread.join()

    def _go_on(self) -> None:
        while not self.closing:
            self._woken.clear()
            try:
                self.go_round()
            except (SQLAlchemyError, ProblemError) as error:
                _log.warning("%s must wait: %s", self._thread.name, error)
            except Exception:  # a bug, or a storage that fails in a way of its own, must not end all further rounds
                _log.exception("%s failed", self._thread.name)
            if not self.closing:
                self._woken.wait(self._interval)
