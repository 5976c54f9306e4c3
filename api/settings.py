"""What an operator can set, by environment variables that start with ``ROTORID_``."""

import os
from pathlib import Path

from pydantic import ByteSize, Field, PositiveFloat, PositiveInt
from pydantic_settings import BaseSettings, SettingsConfigDict


def _spare_cores() -> int:
    """All cores but one, which stays free to answer requests."""
    return max(1, (os.cpu_count() or 1) - 1)


class Settings(BaseSettings):
    """Settings of the service; sizes may be written as ``200MB`` or ``4GB``."""

    model_config = SettingsConfigDict(env_prefix="ROTORID_", frozen=True)

    data: Path = Field(
        default=Path("data"), description="Folder that keeps uploaded logs and their reports; made when missing."
    )
    upload_limit: ByteSize = Field(default=ByteSize(10**9), gt=0, description="Largest log accepted, in bytes.")
    upload_stall: PositiveFloat = Field(
        default=60.0, description="An upload that brings no byte for so long is given up [s]."
    )
    workers: PositiveInt = Field(default_factory=_spare_cores, description="Analyses that run at the same time.")
    time_limit: PositiveFloat = Field(default=900.0, description="Longest time one analysis may take [s].")
    memory_limit: ByteSize = Field(
        default=ByteSize(4 * 10**9), gt=0, description="Most memory one analysis may use, in bytes."
    )
