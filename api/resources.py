"""What the service keeps and shows: logs and their analyses."""

from datetime import UTC, datetime
from enum import StrEnum
from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from api.problems import Problem


class Log(BaseModel):
    """An uploaded file."""

    model_config = ConfigDict(frozen=True)

    id: str = Field(examples=["5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"])
    name: str = Field(description="The file's name as uploaded, for people only.", examples=["00000012.BIN"])
    size: int = Field(description="Bytes.", examples=[2756608])
    received: datetime


class State(StrEnum):
    """How far an analysis is."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen."""
        return self in (State.DONE, State.FAILED)


class Analysis(BaseModel):
    """One run of the pipeline on a log."""

    model_config = ConfigDict(frozen=True)

    id: str = Field(examples=["0a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"])
    log: Log
    state: State = State.QUEUED
    stage: str = Field(default="", description="What is being done now.", examples=["transfer functions"])
    progress: float = Field(default=0.0, ge=0.0, le=1.0, description="Part of the work that is done.")
    created: datetime = Field(default_factory=lambda: datetime.now(UTC))
    started: datetime | None = None
    ended: datetime | None = None
    problem: Problem | None = Field(default=None, description="Why it failed.")


class AnalysisAnswer(Analysis):
    """An analysis with its results, once it is done."""

    links: dict[str, str] = Field(description="Where to find this analysis and, once it is done, its files.")
    report: dict[str, Any] | None = Field(
        default=None, description="Contents of report.json: what was found, RMSE, findings."
    )
    models: dict[str, Any] | None = Field(default=None, description="Contents of models.json: the fitted models.")


class AnalysisOrder(BaseModel):
    """What to analyse."""

    model_config = ConfigDict(extra="forbid")

    log: str = Field(description="Id of an uploaded log.", examples=["5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"])
