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
        Index("ix_analyses_craft", "craft_id"),
        Index("ix_analyses_turn", "owner", "started"),
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
    #: See `api.work.outcome.Outcome`.
    craft: Mapped[str | None] = mapped_column(String(200))
    flown: Mapped[str | None] = mapped_column(String(10))
    happened: Mapped[str | None] = mapped_column(String(300))
    health: Mapped[str | None] = mapped_column(String(40))
    tone: Mapped[str | None] = mapped_column(String(10))
    #: The craft that it is a joint fit of; the logs are those of its flights then.
    craft_id: Mapped[str | None] = mapped_column(String(ID_LENGTH))
    trust: Mapped[str | None] = mapped_column(
        String(10)
    )  #: The most that is said of a model: `pipeline.results.model.Trust`.
    members: Mapped[list["AnalysedLog"]] = relationship(
        order_by="AnalysedLog.position", cascade="all, delete-orphan", lazy="selectin"
    )

    @property
    def logs(self) -> list[LogRecord]:
        """The logs in the order given."""
        return [member.log for member in self.members]


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


class CraftRecord(Record):
    """An aircraft, which its flights are kept below."""

    __tablename__ = "crafts"
    __table_args__ = (Index("ix_crafts_owner", "owner", "changed"),)

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100))
    name: Mapped[str] = mapped_column(String(100), default="")  #: As its owner calls it; empty where they do not.
    kind: Mapped[str] = mapped_column(String(200))  #: As its logs describe it.
    created: Mapped[datetime]
    changed: Mapped[datetime]
    #: Counts what changed about its flights and notes, and up to where that was looked at.
    revision: Mapped[int] = mapped_column(default=1)
    reviewed: Mapped[int] = mapped_column(default=0)
    review: Mapped[dict[str, Any] | None]  #: `pipeline.results.drift.CraftReview`.
    #: Names of the flights that its last joint models were made of; empty before there are any, or where one is gone.
    joint_of: Mapped[list[Any]] = mapped_column(default=list)
    joint_lost: Mapped[str] = mapped_column(String(300), default="")  #: Why earlier joint models do not hold any more.


class CraftKeyRecord(Record):
    """What tells that a log is of a craft: the digest of what `pipeline.flight.craft.fingerprint` says of it."""

    __tablename__ = "craft_keys"

    owner: Mapped[str] = mapped_column(String(100), primary_key=True)
    digest: Mapped[str] = mapped_column(String(DIGEST_LENGTH), primary_key=True)
    craft_id: Mapped[str] = mapped_column(ForeignKey("crafts.id", ondelete="CASCADE"), index=True)


class FlightRecord(Record):
    """A flight of a craft: of an uploaded log by its analysis, or of a folder that `rotorid analyze` wrote."""

    __tablename__ = "flights"
    __table_args__ = (UniqueConstraint("owner", "source", "number", name="uq_flights_source"),)

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100))
    craft_id: Mapped[str] = mapped_column(ForeignKey("crafts.id", ondelete="CASCADE"), index=True)
    source: Mapped[str] = mapped_column(String(64))  #: Id of the log; of a folder's flight a digest of its place.
    number: Mapped[int]  #: Which flight of its log it is.
    log_id: Mapped[str | None] = mapped_column(ForeignKey("logs.id", ondelete="CASCADE"), index=True)
    analysis_id: Mapped[str | None] = mapped_column(ForeignKey("analyses.id", ondelete="CASCADE"), index=True)
    folder: Mapped[str] = mapped_column(String(400))  #: Of its products, in the results or the folder.
    name: Mapped[str] = mapped_column(String(200))  #: Unique for the owner.
    start: Mapped[datetime | None]
    added: Mapped[datetime]
    entry: Mapped[dict[str, Any]]  #: `pipeline.results.fleet.FlightEntry`.
    answers: Mapped[list[Any]]  #: Of `pipeline.results.answer.AnswerLine`.
    trust: Mapped[str] = mapped_column(String(10))  #: The most that is said of a model of this flight alone.


class NoteRecord(Record):
    """What was done to a craft, as its owner wrote it down."""

    __tablename__ = "notes"

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    craft_id: Mapped[str] = mapped_column(ForeignKey("crafts.id", ondelete="CASCADE"), index=True)
    at: Mapped[datetime]
    text: Mapped[str] = mapped_column(String(500))
    boundary: Mapped[bool]
    created: Mapped[datetime]


class AlertRecord(Record):
    """Something about a craft that left its band; raised once."""

    __tablename__ = "alerts"
    __table_args__ = (UniqueConstraint("craft_id", "about", name="uq_alerts_about"),)

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    craft_id: Mapped[str] = mapped_column(ForeignKey("crafts.id", ondelete="CASCADE"), index=True)
    about: Mapped[str] = mapped_column(String(DIGEST_LENGTH))
    kind: Mapped[str] = mapped_column(String(60))
    severity: Mapped[str] = mapped_column(String(10))
    text: Mapped[str] = mapped_column(String(2000))
    flight: Mapped[str] = mapped_column(String(200))
    created: Mapped[datetime] = mapped_column(index=True)


class HookRecord(Record):
    """Where alerts of an owner are sent; or the digest of the secret of a feed that is read without a token."""

    __tablename__ = "hooks"

    id: Mapped[str] = mapped_column(String(ID_LENGTH), primary_key=True)
    owner: Mapped[str] = mapped_column(String(100), index=True)
    url: Mapped[str] = mapped_column(String(500))  #: Empty for a feed.
    secret: Mapped[str] = mapped_column(String(100))  #: Signs what is sent; of a feed the digest of its secret.
    created: Mapped[datetime]
    state: Mapped[str] = mapped_column(String(300), default="")  #: What became of the last delivery.


class DeliveryRecord(Record):
    """An alert that is still to be sent to a hook."""

    __tablename__ = "deliveries"

    alert_id: Mapped[str] = mapped_column(ForeignKey("alerts.id", ondelete="CASCADE"), primary_key=True)
    hook_id: Mapped[str] = mapped_column(ForeignKey("hooks.id", ondelete="CASCADE"), primary_key=True)
    attempts: Mapped[int] = mapped_column(default=0)
    due: Mapped[datetime] = mapped_column(index=True)
