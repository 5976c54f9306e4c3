"""Addresses by which the frame of a signed-in visitor fetches a report and what it links to.

A report is shown in a sandbox with an origin of its own, so that a browser sends no cookie along when somebody follows
a link in it. The address says instead for which token, for which analysis and until when it was made, and a code that
only who has the token's digest could have made says that this is so. Nothing is kept; a token revoked ends its keys.
"""

import hmac
from datetime import UTC, datetime, timedelta

from sqlalchemy import select

from api.store.database import Database
from api.store.ids import digest
from api.store.records import AnalysisRecord, TokenRecord

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
