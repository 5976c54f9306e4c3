"""How much one client may send: uploads in a time, and logs in all."""

import time
from http import HTTPStatus

from fastapi import Request
from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from api.problems import Problem, ProblemError

#: Wrong tokens from one address.
_SIGN_INS = parse("10/minute")


def _address(request: Request) -> str:
    return request.client.host if request.client else ""


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

    def check_sign_ins(self, request: Request) -> None:
        """Refuse another try where an address has sent too many wrong tokens; those of others are not held up."""
        if not self._limiter.test(_SIGN_INS, "sign-in", _address(request)):
            free = self._limiter.get_window_stats(_SIGN_INS, "sign-in", _address(request)).reset_time
            wait = max(1, round(free - time.time()))
            raise ProblemError(
                Problem.named(
                    "too-many-sign-ins",
                    "Too many wrong tokens",
                    HTTPStatus.TOO_MANY_REQUESTS,
                    f"Too many wrong tokens came from your address. Try again in {wait} s.",
                ),
                {"Retry-After": str(wait)},
            )

    def count_wrong_token(self, request: Request) -> None:
        """Count a sign-in that failed."""
        self._limiter.hit(_SIGN_INS, "sign-in", _address(request))

    def count_upload(self, request: Request, owner: str) -> None:
        """Count an upload; a problem when there were too many."""
        if self._uploads is None:
            return
        client = owner or _address(request)
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
