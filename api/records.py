"""The tables of the database: what was uploaded, what is to be analysed and how far that is, and who may do what.

The `analyses` table is the queue: a row is a job. Nothing else remembers it, so that a server, a worker or both can die
at any moment.
"""

from datetime import UTC, datetime
from typing import Any, ClassVar

from sqlalchemy import JSON, BigInteger, DateTime, ForeignKey, Index, String, UniqueConstraint
from sqlalchemy.engine import Dialect
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship
from sqlalchemy.types import TypeDecorator

#: Length of an id and of a token's digest, hexadecimal digits.
ID_LENGTH, DIGEST_LENGTH = 32, 64


class UtcTime(TypeDecorator[datetime]):
    """A moment in UTC; SQLite keeps no time zone, so it is taken off on the way in and put back on the way out."""

    impl = DateTime
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Drop the time zone, which must be there."""
        del dialect
        return None if value is None else value.astimezone(UTC).replace(tzinfo=None)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """Report that it is UTC."""
        del dialect
        return None if value is None else value.replace(tzinfo=UTC)


class Record(DeclarativeBase):
    """Base of all tables."""

    type_annotation_map: ClassVar = {datetime: UtcTime, dict[str, Any]: JSON, list[Any]: JSON}


class LogRecord(Record):
    """An uploaded log; its bytes are the object ``logs/ID``. The same bytes of the same owner are kept once."""

    __tablename__ = "logs"
    __table_args__ = (
        UniqueConstraint("owner", "sha256", name="uq_logs_owner_sha256"),
        Index("ix_logs_received", "received"),
    )

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100))
    name: Mapped[str] = mapped_column(String(200))
    size: Mapped[int] = mapped_column(BigInteger)
    sha256: Mapped[str] = mapped_column(String(DIGEST_LENGTH))
    received: Mapped[datetime]
    delete_digest: Mapped[str] = mapped_column(String(DIGEST_LENGTH))


class AnalysisRecord(Record):
    """An analysis: ordered, waiting, being worked on or ended.

    While it is worked on, `lease` names who does so and `lease_until` says how long that is believed without a sign of
    life. Whoever changes the row as a worker must hold its lease.
    """

    __tablename__ = "analyses"
    __table_args__ = (
        Index("ix_analyses_queue", "state", "created"),
        Index("ix_analyses_owner", "owner", "created"),
    )

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100))
    configuration: Mapped[dict[str, Any]]
    state: Mapped[str] = mapped_column(String(10))
    stage: Mapped[str] = mapped_column(String(100), default="")
    progress: Mapped[float] = mapped_column(default=0.0)
    attempts: Mapped[int] = mapped_column(default=0)
    deaths: Mapped[int] = mapped_column(default=0)
    created: Mapped[datetime]
    started: Mapped[datetime | None]
    ended: Mapped[datetime | None]
    lease: Mapped[str | None] = mapped_column(String(ID_LENGTH))
    lease_until: Mapped[datetime | None]
    problem: Mapped[dict[str, Any] | None]
    #: Size of every file of the results by its name; their objects are ``analyses/ID/RESULTS/NAME``.
    files: Mapped[dict[str, Any]] = mapped_column(default=dict)
    results: Mapped[str | None] = mapped_column(String(ID_LENGTH))
    #: See `api.found.Found`.
    craft: Mapped[str | None] = mapped_column(String(200))
    flown: Mapped[str | None] = mapped_column(String(10))
    health: Mapped[str | None] = mapped_column(String(40))
    tone: Mapped[str | None] = mapped_column(String(10))
    members: Mapped[list["AnalysedLog"]] = relationship(
        order_by="AnalysedLog.position", cascade="all, delete-orphan", lazy="selectin"
    )


class AnalysedLog(Record):
    """Which logs an analysis is of, in the order given."""

    __tablename__ = "analysed_logs"

    analysis_id: Mapped[str] = mapped_column(ForeignKey("analyses.id", ondelete="CASCADE"), primary_key=True)
    position: Mapped[int] = mapped_column(primary_key=True)
    log_id: Mapped[str] = mapped_column(ForeignKey("logs.id"), index=True)
    log: Mapped[LogRecord] = relationship(lazy="joined")


class TokenRecord(Record):
    """A bearer token: only its digest is kept."""

    __tablename__ = "tokens"

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    digest: Mapped[str] = mapped_column(String(DIGEST_LENGTH), unique=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    created: Mapped[datetime]
    expires: Mapped[datetime | None]


class ShareRecord(Record):
    """A link that lets whoever has it read one analysis: only the digest of its secret is kept."""

    __tablename__ = "shares"

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    digest: Mapped[str] = mapped_column(String(DIGEST_LENGTH), unique=True)
    analysis_id: Mapped[str] = mapped_column(ForeignKey("analyses.id", ondelete="CASCADE"), index=True)
    created: Mapped[datetime]
    expires: Mapped[datetime | None]
