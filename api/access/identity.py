"""Who asks: everybody where the service is open, otherwise whoever has a token, and then only for what is theirs."""

from datetime import UTC, datetime, timedelta
from typing import NamedTuple

from fastapi import Request
from sqlalchemy import delete, select

from api.problems import ProblemError
from api.store.database import Database
from api.store.ids import digest, new_id, new_secret
from api.store.records import ShareRecord, TokenRecord

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
            return [Token(each.id, each.owner, each.created, each.expires) for each in records]

    def revoke(self, token_id: str) -> bool:
        """Make a token worthless; False when there is none of this id."""
        with self._database.write() as session:
            found = session.get(TokenRecord, token_id)
            if found is not None:
                session.delete(found)
            return found is not None

    def owner_of(self, secret: str) -> str | None:
        """Report whose token this is; None when it is nobody's, or has expired."""
        with self._database.read() as session:
            found = session.scalar(select(TokenRecord).where(TokenRecord.digest == digest(secret)))
            return None if found is None or _expired(found) else found.owner


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
            found = session.scalar(select(ShareRecord).where(ShareRecord.digest == digest(secret)))
            return None if found is None or _expired(found) else found.analysis_id


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
