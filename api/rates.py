"""How much one client may send: uploads in a time, and logs in all."""

import time
from http import HTTPStatus

from fastapi import Request
from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from api.problems import Problem, ProblemError


class Rates:
    """Counts uploads of every owner or, where the service is open to all, of every address.

    Parameters
    ----------
    uploads : str
        Such as ``"120/minute"``; empty for no limit.
    """

    def __init__(self, uploads: str) -> None:
        self._uploads: RateLimitItem | None = parse(uploads) if uploads else None
        self._limiter = MovingWindowRateLimiter(MemoryStorage())

    def count_upload(self, request: Request, owner: str) -> None:
        """Count an upload; a problem when there were too many."""
        if self._uploads is None:
            return
        client = owner or (request.client.host if request.client else "")
        if self._limiter.hit(self._uploads, client):
            return
        free = self._limiter.get_window_stats(self._uploads, client).reset_time
        wait = max(1, round(free - time.time()))
        raise ProblemError(
            Problem.named(
                "too-many-uploads",
                "Too many uploads",
                HTTPStatus.TOO_MANY_REQUESTS,
                f"This service takes {self._uploads} from one client. Try again in {wait} s.",
            ),
            {"Retry-After": str(wait)},
        )
