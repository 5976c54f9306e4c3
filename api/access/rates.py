"""How much one client may send: uploads in a time, and logs in all."""

import time

from fastapi import Request
from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter

from api.problems import ProblemError

#: Wrong tokens from one address: at the page that asks for one, and with requests, of which a page left open after its
#: token was revoked sends thirty.
SIGN_INS, BEARERS = parse("10/minute"), parse("60/minute")


def _address(request: Request) -> str:
    return request.client.host if request.client else ""


class Rates:
    """Counts uploads of every owner or, where the service is open to all, of every address."""

    def __init__(self, uploads: str) -> None:
        self._uploads: RateLimitItem | None = parse(uploads) if uploads else None
        self._limiter = MovingWindowRateLimiter(MemoryStorage())

    def check_sign_ins(self, request: Request) -> None:
        """Refuse another sign-in where an address has sent too many wrong tokens; those of others are not held up."""
        if not self._limiter.test(SIGN_INS, "sign-in", _address(request)):
            raise self._too_many("wrong tokens", SIGN_INS, "sign-in", _address(request))

    def count_wrong_token(self, request: Request) -> None:
        """Count a sign-in that failed."""
        self._limiter.hit(SIGN_INS, "sign-in", _address(request))

    def count_wrong_bearer(self, request: Request) -> None:
        """Count a request whose token is nobody's; a problem when there were too many. A right one is not held up."""
        if not self._limiter.hit(BEARERS, "bearer", _address(request)):
            raise self._too_many("wrong tokens", BEARERS, "bearer", _address(request))

    def count_upload(self, request: Request, owner: str) -> None:
        """Count an upload; a problem when there were too many."""
        client = owner or _address(request)
        if self._uploads is not None and not self._limiter.hit(self._uploads, client):
            raise self._too_many("uploads", self._uploads, client)

    def _too_many(self, what: str, rate: RateLimitItem, *of: str) -> ProblemError:
        free = self._limiter.get_window_stats(rate, *of).reset_time
        wait = max(1, round(free - time.time()))
        name = "too-many-uploads" if what == "uploads" else "too-many-sign-ins"
        detail = f"This service takes {rate} {what} from one client. Try again in {wait} s."
        return ProblemError.of(name, detail, {"Retry-After": str(wait)})
