"""The latest models of a craft that may be trusted: joint ones first, then those of its newest flight that has some."""

from collections.abc import Iterator
from enum import StrEnum
from typing import NamedTuple

from sqlalchemy import select
from sqlalchemy.orm import Session

from api.problems import ProblemError
from api.store.database import Database
from api.store.records import AnalysisRecord, CraftRecord, FlightRecord
from api.store.resources import State
from pipeline.storage.manifest import FLIGHTS


class LeastTrust(StrEnum):
    """How far a model must be trusted to be handed out."""

    YES = "yes"
    LIMITED = "limited"


#: Files that are handed out under stable names, and what they are.
FILES = {
    "models.json": "all models with their covariances",
    "models.mat": "transfer functions for MATLAB",
    "craft.json": "the rigid body with its covariance, and the linear hover model",
    "craft.mat": "the same for MATLAB",
    "sitl_frame.json": "frame for ArduPilot's simulator",
    "parameters.csv": "physical parameters by every method",
    "proposed.param": "proposed gains and filters",
}

#: Those that have evidence of their own, whatever the models are worth.
_OF_ITSELF = frozenset({"proposed.param"})


class LatestModel(NamedTuple):
    """Where the latest model is."""

    analysis: str
    results: str  #: Key of what its files lie below.
    files: tuple[str, ...]
    trust: str
    flights: tuple[str, ...]  #: That it was fitted to.
    joint: bool


def latest(database: Database, craft_id: str, least: LeastTrust, name: str | None = None) -> LatestModel:
    """Find the latest models of a craft, those that have the file `name` where one is wanted."""
    trusted = ["yes"] if least is LeastTrust.YES else ["yes", "limited"]
    with database.read() as session:
        said = []
        for candidate in _candidates(session, craft_id):
            if name is not None and name not in candidate.files:
                continue
            if candidate.trust in trusted or name in _OF_ITSELF:
                return candidate
            said.append(candidate.trust)
    if name in _OF_ITSELF:
        detail = "No flight of this craft supports a proposal; `rotorid tune` of its logs says what is missing."
    elif not said:
        detail = f"No analysis of this craft has {name or 'a model'}."
    else:
        detail = "No analysis of this craft has a model that may be trusted" + (
            "; with `trust=limited` those are answered that may be used with care."
            if "limited" in said and least is LeastTrust.YES
            else "."
        )
    raise ProblemError.of("no-trusted-model", detail)


def _candidates(session: Session, craft_id: str) -> Iterator[LatestModel]:
    craft = session.get_one(CraftRecord, craft_id)
    joint = session.scalars(
        select(AnalysisRecord)
        .where(AnalysisRecord.craft_id == craft_id, AnalysisRecord.state == State.DONE)
        .order_by(AnalysisRecord.ended.desc())
        .limit(1)
    ).all()
    for analysis in joint if craft.joint_of else []:
        names = session.scalars(select(FlightRecord.name).where(FlightRecord.id.in_(craft.joint_of)))
        yield _model(analysis, analysis.trust or "unknown", tuple(sorted(names)), joint=True)
    flights = session.execute(
        select(FlightRecord, AnalysisRecord)
        .join(AnalysisRecord, AnalysisRecord.id == FlightRecord.analysis_id)
        .where(FlightRecord.craft_id == craft_id)
    ).all()
    for flight, analysis in sorted(flights, key=lambda row: row[0].start or row[0].added, reverse=True):
        # Of several flights analysed together each has files of its own; the others are not of this flight alone.
        own = f"{FLIGHTS}/{flight.folder}/"
        of_several = len(analysis.members) > 1 or any(name.startswith(own) for name in analysis.files)
        yield _model(analysis, flight.trust, (flight.name,), below=own if of_several else "")


def _model(
    analysis: AnalysisRecord, trust: str, flights: tuple[str, ...], *, joint: bool = False, below: str = ""
) -> LatestModel:
    place = f"analyses/{analysis.id}/{analysis.results}/{below}".removesuffix("/")
    files = tuple(name.removeprefix(below) for name in analysis.files if name.startswith(below))
    return LatestModel(analysis.id, place, files, trust, flights, joint)
