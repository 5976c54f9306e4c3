"""Which flights a joint fit is made of: as they were when it was ordered, with where their experiments are."""

from typing import Any, NamedTuple

from sqlalchemy import select

from api.store.database import Database
from api.store.records import AnalysisRecord, FlightRecord
from api.work.queue import Claim

_EXPERIMENTS = "experiments/"


class MemberFlight(NamedTuple):
    """A flight that takes part in a joint fit."""

    name: str
    entry: dict[str, Any]
    experiments: dict[str, str]  #: Key of the object of each kind.


def members_of(database: Database, claim: Claim) -> list[MemberFlight]:
    """List the flights of a claimed joint fit; FileNotFoundError where one of them is gone."""
    wanted = claim.configuration["flights"]
    with database.read() as session:
        rows = session.execute(
            select(FlightRecord, AnalysisRecord)
            .join(AnalysisRecord, AnalysisRecord.id == FlightRecord.analysis_id)
            .where(FlightRecord.id.in_(wanted), FlightRecord.craft_id == claim.craft)
            .order_by(FlightRecord.added)
        ).all()
        if len(rows) < len(wanted):
            raise FileNotFoundError(f"of {len(wanted)} flights of the craft {len(rows)} are there")
        return [MemberFlight(flight.name, flight.entry, _experiments(flight, analysis)) for flight, analysis in rows]


def _experiments(flight: FlightRecord, analysis: AnalysisRecord) -> dict[str, str]:
    """Find the experiments of a flight among the files of its analysis: ``experiments/KIND/.../flight=F/...``."""
    mine = f"/flight={flight.entry['folder']}/"
    names = [name for name in analysis.files if name.startswith(_EXPERIMENTS) and mine in name]
    place = f"analyses/{analysis.id}/{analysis.results}"
    return {name.split("/")[1]: f"{place}/{name}" for name in names}
