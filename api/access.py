"""Who asks: everybody where the service is open, otherwise whoever has a token, and then only for what is theirs."""

import hmac
import time
from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from fastapi import Request
from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import MovingWindowRateLimiter
from sqlalchemy import delete, select

from api.problems import ProblemError
from api.store.database import Database
from api.store.ids import digest, new_id, new_secret
from api.store.records import AnalysisRecord, ShareRecord, TokenRecord

#: Owner of everything in a service without tokens.
EVERYBODY = ""

#: Cookie in which a browser keeps its token.
COOKIE = "rotorid_token"


class Token(NamedTuple):
    """A token as its operator sees it."""

    id: str
    owner: str
    created: datetime
    expires: datetime | None


class Tokens:
    """Bearer tokens; the database has only their digests."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, owner: str, days: float | None = None) -> str:
        """Make a token for an owner and give it: it cannot be read again."""
        secret, now = new_secret(), datetime.now(UTC)
        expires = None if days is None else now + timedelta(days=days)
        with self._database.write() as session:
            session.add(TokenRecord(id=new_id(), digest=digest(secret), owner=owner, created=now, expires=expires))
        return secret

    def list(self) -> list[Token]:
        """List all tokens, without their secrets."""
        with self._database.read() as session:
            records = session.scalars(select(TokenRecord).order_by(TokenRecord.created))
            return [Token(record.id, record.owner, record.created, record.expires) for record in records]

    def revoke(self, token_id: str) -> bool:
        """Make a token worthless; False when there is none of this id."""
        with self._database.write() as session:
            record = session.get(TokenRecord, token_id)
            if record is not None:
                session.delete(record)
            return record is not None

    def owner_of(self, secret: str) -> str | None:
        """Report whose token this is; None when it is nobody's, or has expired."""
        with self._database.read() as session:
            record = session.scalar(select(TokenRecord).where(TokenRecord.digest == digest(secret)))
            return None if record is None or _expired(record) else record.owner


class Shares:
    """Links that let whoever has them read one analysis; the database has only their digests."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(self, analysis: str, days: float | None) -> tuple[str, datetime | None]:
        """Make a link's secret; gives it and when it expires."""
        secret, now = new_secret(), datetime.now(UTC)
        expires = None if days is None else now + timedelta(days=days)
        with self._database.write() as session:
            session.add(
                ShareRecord(id=new_id(), digest=digest(secret), analysis_id=analysis, created=now, expires=expires)
            )
        return secret, expires

    def revoke_all(self, analysis: str) -> None:
        """Make all links to an analysis worthless."""
        with self._database.write() as session:
            session.execute(delete(ShareRecord).where(ShareRecord.analysis_id == analysis))

    def analysis_of(self, secret: str) -> str | None:
        """Report which analysis a link is to; None when there is none, or it has expired."""
        with self._database.read() as session:
            record = session.scalar(select(ShareRecord).where(ShareRecord.digest == digest(secret)))
            return None if record is None or _expired(record) else record.analysis_id


def _expired(record: TokenRecord | ShareRecord) -> bool:
    return record.expires is not None and record.expires <= datetime.now(UTC)


def bearer(request: Request) -> str | None:
    """Return the token of a request: of its Authorization header, or of the cookie of a browser that signed in."""
    scheme, _, secret = request.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and secret.strip():
        return secret.strip()
    return request.cookies.get(COOKIE)


def unauthorized() -> ProblemError:
    """Make the answer to a request without a valid token."""
    return ProblemError.of(
        "token-needed",
        "This service knows its users by tokens. Sign in, or send the header `Authorization: Bearer TOKEN`; the "
        "operator makes tokens with `rotorid token`.",
    )


#: How long a page may stay open with working links.
VALID = timedelta(hours=12)


class ReportKeys:
    """Makes keys for reports and checks them; keys are good for as long as `valid`."""

    def __init__(self, database: Database, valid: timedelta = VALID) -> None:
        self._database, self._valid = database, valid

    def make(self, secret: str, analysis: str) -> str:
        """Make a key with which the owner of a token can read one analysis."""
        with self._database.read() as session:
            token = session.scalars(select(TokenRecord).where(TokenRecord.digest == digest(secret))).one()
            until = int((datetime.now(UTC) + self._valid).timestamp())
            return f"{token.id}.{analysis}.{until}.{_code(token, analysis, until)}"

    def analysis_of(self, key: str) -> str | None:
        """Report which analysis a key is for; None when it is for none, or its time is over."""
        parts = key.split(".")
        if len(parts) != 4 or not (parts[2].isascii() and parts[2].isdigit() and len(parts[2]) < 12):
            return None
        token_id, analysis_id, until, code = parts[0], parts[1], int(parts[2]), parts[3]
        now = datetime.now(UTC)
        with self._database.read() as session:
            token, analysis = session.get(TokenRecord, token_id), session.get(AnalysisRecord, analysis_id)
            if token is None or analysis is None or analysis.owner != token.owner or until < now.timestamp():
                return None
            if token.expires is not None and token.expires <= now:
                return None
            genuine = hmac.compare_digest(code.encode(), _code(token, analysis_id, until).encode())
            return analysis_id if genuine else None


def _code(token: TokenRecord, analysis: str, until: int) -> str:
    return hmac.new(token.digest.encode(), f"{analysis}.{until}".encode(), "sha256").hexdigest()


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
        """Count a request whose token is nobody's; ProblemError if there were too many. A right one is not held up."""
        if not self._limiter.hit(BEARERS, "bearer", _address(request)):
            raise self._too_many("wrong tokens", BEARERS, "bearer", _address(request))

    def count_upload(self, request: Request, owner: str) -> None:
        """Count an upload; ProblemError if there were too many."""
        client = owner or _address(request)
        if self._uploads is not None and not self._limiter.hit(self._uploads, client):
            raise self._too_many("uploads", self._uploads, client)

    def _too_many(self, what: str, rate: RateLimitItem, *of: str) -> ProblemError:
        free = self._limiter.get_window_stats(rate, *of).reset_time
        wait = max(1, round(free - time.time()))
        name = "too-many-uploads" if what == "uploads" else "too-many-sign-ins"
        detail = f"This service takes {rate} {what} from one client. Try again in {wait} s."
        return ProblemError.of(name, detail, {"Retry-After": str(wait)})
