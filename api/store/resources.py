"""What the service keeps and shows: logs and their analyses."""

import math
from datetime import UTC, datetime
from enum import StrEnum
from typing import Annotated, Any, Generic, Self, TypeVar
from urllib.parse import quote

from pydantic import BaseModel, ConfigDict, Field, JsonValue, computed_field, model_validator

from api.problems import Problem
from core.summary import listed
from pipeline.config import SETTINGS, AnalysisConfig


class Given(BaseModel):
    """What a request brings: a key that is not known is refused, for whoever misspells one believes it was heard."""

    model_config = ConfigDict(extra="forbid")


class Log(BaseModel):
    """An uploaded file."""

    model_config = ConfigDict(frozen=True, from_attributes=True)

    id: str = Field(examples=["5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"])
    name: str = Field(description="The file's name as uploaded, for people only.", examples=["00000012.BIN"])
    size: int = Field(description="Bytes.", examples=[2756608])
    sha256: str = Field(
        description="Of the file's content; the same content uploaded again is the same log.",
        examples=["9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08"],
    )
    received: datetime = Field(examples=["2026-03-14T09:26:53Z"])


class UploadedLog(Log):
    """A log just uploaded."""

    delete_token: str | None = Field(
        default=None,
        description="Lets whoever has it delete the log; told once, when the log is uploaded for the first time.",
        examples=["bT3nJ0cO0WjS5mJX1m3Zt0pB8xq2w4u6y8A0C2E4G6I"],
    )


class UploadedLogs(BaseModel):
    """Logs uploaded in one form."""

    logs: list[UploadedLog]


class State(StrEnum):
    """How far an analysis is."""

    QUEUED = "queued"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def ended(self) -> bool:
        """Whether nothing more will happen."""
        return self in (State.DONE, State.FAILED, State.CANCELLED)


def _offered(name: str, example: object = None, max_length: int | None = None) -> Any:
    """Return the field of a setting of `AnalysisConfig`, in its words and limits."""
    setting = SETTINGS[name]
    limits = {"ge": setting.least, "le": setting.most} if math.isfinite(setting.most) else {"max_length": max_length}
    default = AnalysisConfig.__dataclass_fields__[name].default
    return Field(default=None, description=setting.help, examples=[example or default], **limits)


class Configuration(Given):
    """Settings of an analysis; what is left out has the default of `rotorid analyze`."""

    model_config = ConfigDict(allow_inf_nan=False)

    rate: float | None = _offered("rate")
    poles: int | None = _offered("poles")
    zeros: int | None = _offered("zeros")
    mass: float | None = _offered("mass", example=4.3)
    training_fraction: float | None = _offered("training_fraction")
    training: list[str] | None = _offered("training", example=["march*"], max_length=200)

    def chosen(self) -> dict[str, JsonValue]:
        """Return what was set."""
        return self.model_dump(exclude_none=True)


class Progress(BaseModel):
    """How far an analysis is."""

    model_config = ConfigDict(frozen=True, from_attributes=True)

    configuration: dict[str, JsonValue] = Field(
        default={}, description="What was set when it was ordered.", examples=[{"poles": 4}]
    )
    state: State = State.QUEUED
    stage: str = Field(default="", description="What is being done now.", examples=["transfer functions"])
    progress: float = Field(default=0.0, ge=0.0, le=1.0, description="Part of the work that is done.")
    created: datetime = Field(default_factory=lambda: datetime.now(UTC), examples=["2026-03-14T09:26:54Z"])
    started: datetime | None = None
    ended: datetime | None = None
    problem: Problem | None = Field(default=None, description="Why it failed.")
    files: dict[str, int] = Field(
        default={},
        description="Files of its results by name, with their size in bytes.",
        examples=[{"report.html": 2416301, "rmse.csv": 1893}],
    )


class Results(BaseModel):
    """What an analysis found, as far as it is asked for."""

    findings: list[dict[str, JsonValue]] | None = Field(
        default=None, description="What was noticed in the logs and the fits, with advice (`include=findings`)."
    )
    report: dict[str, JsonValue] | None = Field(
        default=None, description="Contents of report.json: all that was found (`include=report`)."
    )
    models: dict[str, JsonValue] | None = Field(
        default=None, description="Contents of models.json: the fitted models (`include=models`)."
    )


class Analysis(Progress):
    """One run of the pipeline on one or several logs."""

    id: str = Field(examples=["0a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"])
    logs: list[Log] = Field(min_length=1)
    attempts: int = Field(default=0, description="How often it was begun; more than once when a worker died.")
    craft: str | None = Field(default=None, description="What flew, as its logs describe it.")
    flown: str | None = Field(default=None, description="Day of its first flight.", examples=["2026-03-14"])
    happened: str | None = Field(
        default=None, description="What happened, in a sentence, of several flights in the worst; there before models."
    )
    health: str | None = Field(default=None, description="The same in a few words.")
    tone: str | None = Field(default=None, description="How good that is: good, care, bad or unknown.")
    craft_id: str | None = Field(default=None, description="The craft that it fits the flights of jointly.")

    @computed_field(description="The first of its logs.")  # type: ignore[prop-decorator]
    @property
    def log(self) -> Log:
        """The first of its logs, mostly the only one."""
        return self.logs[0]

    @computed_field(  # type: ignore[prop-decorator]
        description="Where to find this analysis and, once it is done, its files.",
        examples=[{"self": "/api/v1/analyses/0a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"}],
    )
    @property
    def links(self) -> dict[str, str]:
        """Addresses of an analysis, of its page and log and, once it is done, of its files."""
        here = f"/api/v1/analyses/{self.id}"
        page, log = f"/analyses/{self.id}", f"/api/v1/logs/{self.log.id}"
        links = {"self": here, "events": f"{here}/events", "log": log, "page": page}
        return links | {name: f"{here}/{quote(name)}" for name in self.files}

    @property
    def title(self) -> str:
        """What it is of, for people."""
        return listed([log.name for log in self.logs], 1)


class AnalysisAnswer(Analysis, Results):
    """An analysis with its results, once it is done."""

    answers: dict[str, list[dict[str, JsonValue]]] | None = Field(
        default=None, description="By flight the first screen of its report: an answer for each purpose."
    )
    rmse: list[dict[str, JsonValue]] | None = Field(
        default=None, description="Contents of rmse.csv: errors of all models."
    )
    coefficients: dict[str, dict[str, JsonValue]] | None = Field(
        default=None,
        description="By flight or craft and model the coefficients of its transfer functions, by output and input.",
    )


class Extra(StrEnum):
    """What an answer holds only where it is asked for."""

    REPORT = "report"
    MODELS = "models"
    FINDINGS = "findings"


class SharedLog(BaseModel):
    """A log as whoever has a link sees it: without what would tell it from others, or find it."""

    name: str = Field(examples=["00000012.BIN"])
    size: int = Field(description="Bytes.", examples=[2756608])


class SharedAnalysis(Progress, Results):
    """An analysis as whoever has a link sees it."""

    logs: list[SharedLog]
    links: dict[str, str] = Field(examples=[{"self": "/api/v1/shared/SECRET"}])


_LogId = Annotated[str, Field(examples=["5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"], max_length=64)]


class AnalysisOrder(Given):
    """What to analyse: one log, or several, whose flights of the same craft are then fitted jointly."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"logs": ["5f0c1d3e9a7b4c2d8e6f0a1b2c3d4e5f"], "configuration": {"poles": 4, "zeros": 2}}]
        },
    )

    log: _LogId | None = Field(default=None, description="Id of an uploaded log.")
    logs: list[_LogId] = Field(default=[], max_length=500, description="Ids of uploaded logs.")
    configuration: Configuration = Configuration()

    @model_validator(mode="after")
    def _names_logs(self) -> Self:
        if not self.ids:
            raise ValueError("name at least one log in `logs`")
        return self

    @property
    def ids(self) -> list[str]:
        """All logs named."""
        return [*([] if self.log is None else [self.log]), *self.logs]


Item = TypeVar("Item")


class Page(BaseModel, Generic[Item]):
    """A part of a list, the newest first."""

    items: list[Item]
    next: str | None = Field(description="Address of the next part; null at the end.", examples=[None])


_ID = "7a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"


class JointFit(BaseModel):
    """The models fitted to several flights of a craft at once."""

    analysis: str | None = Field(description="Id of the analysis that made them; null before there are any.")
    flights: list[str] = Field(description="Names of the flights that they are made of.", examples=[["00000012"]])
    waiting: str | None = Field(description="Id of the analysis that makes them anew.", examples=[None])
    lost: str = Field(description="Why earlier ones do not hold any more.", examples=[""])
    next_at: int = Field(description="Number of usable flights with which they are fitted anew.", examples=[3])


class CraftSummary(BaseModel):
    """An aircraft and its flights, in short."""

    model_config = ConfigDict(frozen=True)

    id: str = Field(examples=[_ID])
    name: str = Field(description="As its owner calls it, or as its logs describe it.", examples=["Survey octo 2"])
    kind: str = Field(description="As its logs describe it.", examples=["ArduCopter octa plus"])
    flights: int = Field(examples=[12])
    first: datetime | None = Field(description="When its first flight took off.", examples=["2026-03-14T09:26:53Z"])
    last: datetime | None = Field(examples=["2026-05-02T14:03:10Z"])
    health: str | None = Field(description="What happened in its newest flight.", examples=["motor fault, crash"])
    tone: str | None = Field(description="How good that is: good, care, bad or unknown.", examples=["good"])
    alerts: int = Field(description="Alerts of the last 30 days.", examples=[0])
    changed: datetime = Field(examples=["2026-05-02T15:00:00Z"])
    current: bool = Field(description="Whether all its flights have been looked at.")
    links: dict[str, str] = Field(examples=[{"self": f"/api/v1/crafts/{_ID}"}])


class CraftFlight(BaseModel):
    """A flight of a craft."""

    model_config = ConfigDict(from_attributes=True, populate_by_name=True)

    id: str = Field(examples=["9a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"])
    name: str = Field(examples=["00000012"])
    start: datetime | None = Field(description="Take-off; null where the log does not tell.")
    added: datetime
    log: str | None = Field(validation_alias="log_id", description="Id of its log; null for a flight of a folder.")
    analysis: str | None = Field(validation_alias="analysis_id", description="Id of its analysis.")
    answers: list[dict[str, Any]] = Field(description="The first screen of its report: an answer for each purpose.")
    trust: str = Field(description="The most that is said of a model of it: yes, limited, no or unknown.")


class Note(BaseModel):
    """What was done to a craft."""

    model_config = ConfigDict(from_attributes=True)

    id: str
    at: datetime
    text: str
    boundary: bool = Field(description="Flights before it are not pooled with those after it.")


class NewNote(Given):
    """What was done to a craft, and when."""

    text: Annotated[str, Field(min_length=1, max_length=500, examples=["new propellers"])]
    at: datetime | None = Field(default=None, description="UTC; now, where it is left out.")
    boundary: bool = Field(default=False, description="Do not pool flights before it with those after it.")


class RaisedAlert(BaseModel):
    """Something about a craft that left its band."""

    id: str
    craft: str = Field(description="Its id.")
    name: str = Field(description="Of the craft.")
    kind: str = Field(examples=["motor-weakening"])
    severity: str = Field(examples=["warning"])
    text: str
    flight: str = Field(description="After which flight it was seen.")
    created: datetime


class CraftAnswer(CraftSummary):
    """A craft with its flights, notes, alerts, and what the flights say together."""

    notes: list[Note]
    joint: JointFit
    review: dict[str, Any] | None = Field(
        description="What its flights say together: drift and change points of every parameter and of each motor, what "
        "changed with the last boundary, remarks. Null before the first look."
    )
    recent: list[RaisedAlert] = Field(description="Its newest alerts.")


class CraftChange(Given):
    """What the owner sets of a craft."""

    name: str = Field(max_length=100, description="Empty to call it as its logs do.", examples=["Survey octo 2"])


class Merge(Given):
    """Which craft becomes part of another."""

    craft: str = Field(max_length=64, description="Id of the craft whose flights, notes and alerts come over.")


class Move(Given):
    """Which flights go to another craft."""

    flights: list[Annotated[str, Field(max_length=64)]] = Field(min_length=1, max_length=5000)
    to: str | None = Field(default=None, max_length=64, description="Id of the craft; a new one, where it is left out.")
    later: bool = Field(default=False, description="Flights that come later and look like these go there as well.")
