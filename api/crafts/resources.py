"""What the service shows of craft: their flights, notes and alerts."""

from datetime import datetime
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

_ID = "7a1b2c3d4e5f5f0c1d3e9a7b4c2d8e6f"


class JointFit(BaseModel):
    """The models fitted to several flights of a craft at once."""

    analysis: str | None = Field(description="Id of the analysis that made them; null before there are any.")
    flights: list[str] = Field(description="Names of the flights that they are made of.", examples=[["00000012"]])
    waiting: str | None = Field(description="Id of the analysis that makes them anew.", examples=[None])
    lost: str = Field(description="Why earlier ones do not hold any more.", examples=[""])
    next_at: int = Field(description="Number of usable flights with which they are fitted anew.", examples=[3])


class Craft(BaseModel):
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


class NewNote(BaseModel):
    """What was done to a craft, and when."""

    model_config = ConfigDict(extra="forbid")

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


class CraftAnswer(Craft):
    """A craft with its flights, notes, alerts, and what the flights say together."""

    notes: list[Note]
    joint: JointFit
    review: dict[str, Any] | None = Field(
        description="What its flights say together: drift and change points of every parameter and of each motor, what "
        "changed with the last boundary, remarks. Null before the first look."
    )
    recent: list[RaisedAlert] = Field(description="Its newest alerts.")


class CraftChange(BaseModel):
    """What the owner sets of a craft."""

    model_config = ConfigDict(extra="forbid")

    name: str = Field(max_length=100, description="Empty to call it as its logs do.", examples=["Survey octo 2"])


class Merge(BaseModel):
    """Which craft becomes part of another."""

    model_config = ConfigDict(extra="forbid")

    craft: str = Field(max_length=64, description="Id of the craft whose flights, notes and alerts come over.")


class Move(BaseModel):
    """Which flights go to another craft."""

    model_config = ConfigDict(extra="forbid")

    flights: list[Annotated[str, Field(max_length=64)]] = Field(min_length=1, max_length=5000)
    to: str | None = Field(default=None, max_length=64, description="Id of the craft; a new one, where it is left out.")
    later: bool = Field(default=False, description="Flights that come later and look like these go there as well.")
