"""What an operator can set, by environment variables that start with ``ROTORID_``."""

import os
from enum import StrEnum
from pathlib import Path

from limits import parse
from pydantic import ByteSize, Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, PositiveInt, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict


def _spare_cores() -> int:
    """Return the number of cores but one, which stays free to answer requests."""
    return max(1, (os.cpu_count() or 1) - 1)


class Access(StrEnum):
    """Who may use the service."""

    AUTO = "auto"
    OPEN = "open"
    TOKENS = "tokens"


class Webhooks(StrEnum):
    """Where webhooks may lead."""

    PUBLIC = "public"
    ANY = "any"
    OFF = "off"


class LogFormat(StrEnum):
    """Format of the service's own log."""

    TEXT = "text"
    JSON = "json"


class Settings(BaseSettings):
    """Settings of the service; sizes may be written as ``200MB`` or ``4GB``."""

    model_config = SettingsConfigDict(env_prefix="ROTORID_", frozen=True)

    data: Path = Field(
        default=Path("data"),
        description="Folder of the service on this computer: uploads arrive there and, unless `database` and `storage` "
        "say otherwise, everything is kept there. Made when missing.",
    )
    database: str = Field(
        default="",
        description="SQLAlchemy URL of the database, such as postgresql+psycopg://rotorid@db/rotorid (needs the extra "
        "`postgresql`). By default a SQLite file in `data`.",
    )
    storage: str = Field(
        default="",
        description="Where logs and results are kept: a folder, or a URL that fsspec knows, such as s3://bucket/key "
        "(needs the extra `s3`). By default a folder in `data`.",
    )
    out: Path | None = Field(
        default=None,
        description="A folder that `rotorid analyze` wrote, whose flights an open service shows with its craft.",
    )
    access: Access = Field(
        default=Access.AUTO,
        description="`open`: whoever reaches the service sees everything. `tokens`: only with a token made by "
        "`rotorid token`, and only one's own logs. `auto`: open when it listens on this computer only.",
    )
    upload_limit: ByteSize = Field(default=ByteSize(10**9), gt=0, description="Largest log accepted, in bytes.")
    upload_stall: PositiveFloat = Field(
        default=60.0, description="An upload that brings no byte for so long is given up [s]."
    )
    upload_rate: str = Field(
        default="300/minute",
        description="Uploads taken from one client in a time, such as 300/minute or 5000/day; empty for any number.",
    )
    logs_limit: NonNegativeInt = Field(default=0, description="Most logs kept for one owner; 0 for any number.")
    bytes_limit: ByteSize = Field(default=ByteSize(0), description="Most bytes of logs kept for one owner; 0 for any.")
    queue_limit: NonNegativeInt = Field(
        default=1000, description="Most analyses of one owner that wait or run at a time; 0 for any number."
    )
    hosts: str = Field(
        default="",
        description="Names under which the service answers besides localhost, separated by commas, such as "
        "rotorid.lab; by default any.",
    )
    proxies: str = Field(
        default="",
        description="Addresses or networks of proxies in front, separated by commas, such as 127.0.0.1, whose "
        "`X-Forwarded-For` and `X-Forwarded-Proto` are believed; by default nobody's.",
    )
    workers: NonNegativeInt = Field(
        default_factory=_spare_cores,
        description="Analyses that run at the same time; 0 leaves them to `rotorid worker` on other computers.",
    )
    time_limit: PositiveFloat = Field(default=900.0, description="Longest time one analysis may take [s].")
    memory_limit: ByteSize = Field(
        default=ByteSize(4 * 10**9), gt=0, description="Most memory one analysis may use, in bytes."
    )
    deaths: PositiveInt = Field(
        default=5, description="How many processes may die of one analysis before it is given up."
    )
    lease: PositiveFloat = Field(
        default=15.0, description="A worker that gives no sign of life for so long is taken for dead [s]."
    )
    retention: NonNegativeFloat = Field(
        default=0.0, le=36500.0, description="Days after which logs and their analyses are removed; 0 keeps them."
    )
    webhooks: Webhooks = Field(
        default=Webhooks.PUBLIC,
        description="Where alerts may be sent: `public`: by https to addresses of the public internet; `any`: also to "
        "this network and by http; `off`: nowhere.",
    )
    log_format: LogFormat = Field(
        default=LogFormat.TEXT,
        description="How the service writes what it does: `text` for people, or `json`, an object a line, for "
        "programs. Messages go to stderr, a line for each request to stdout.",
    )

    @field_validator("upload_rate")
    @classmethod
    def _check_rate(cls, value: str) -> str:
        if value:
            try:
                parse(value)
            except ValueError:
                raise ValueError("write a number and a time, such as 300/minute, or nothing for any number") from None
        return value

    @property
    def host_names(self) -> frozenset[str]:
        """Names under which the service answers besides localhost; none for any."""
        return frozenset(name.strip().lower() for name in self.hosts.split(",") if name.strip())

    @property
    def database_url(self) -> str:
        """SQLAlchemy URL of the database."""
        return self.database or f"sqlite:///{(self.data / 'rotorid.db').absolute()}"

    @property
    def storage_url(self) -> str:
        """Fsspec URL of the storage."""
        return self.storage or str((self.data / "objects").absolute())
