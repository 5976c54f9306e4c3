"""Looking at craft whenever something about them changed: drift, alerts, and whether joint models are to be made anew.

The looking itself is done in the process of `api.work.desk`. Several servers may look at the same craft: what
they write names the revision that they looked at, and an alert is raised once.
"""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import select
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from api.crafts.registry import Crafts, next_fit
from api.logs.catalog import order_joint_fit
from api.store.database import Database
from api.store.ids import digest, new_id
from api.store.records import AlertRecord, AnalysisRecord, CraftRecord, DeliveryRecord, FlightRecord, HookRecord
from api.store.resources import State
from api.work.rounds import Rounds

#: Seconds between two looks for craft that changed.
_LOOK = 1.0

#: Craft that are looked at before others get a turn, and most alerts that one look raises.
_AT_ONCE, _MOST_ALERTS = 20, 50


class Reviews(Rounds):
    """Looks at craft in a thread of its own."""

    def __init__(
        self,
        database: Database,
        crafts: Crafts,
        ask: Callable[..., Any],
        wake: Callable[[], None],
        bring: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__("reviews", _LOOK)
        self._bring = bring
        self._database = database
        self._crafts = crafts
        self._ask = ask
        self._wake = wake

    def go_round(self) -> None:
        """Bring flights from elsewhere, and look at the craft that changed."""
        self._bring()
        self.look()

    def look(self) -> None:
        """Look at the craft that changed."""
        with self._database.read() as session:
            changed = select(CraftRecord.id, CraftRecord.revision).where(CraftRecord.reviewed < CraftRecord.revision)
            waiting = session.execute(changed.order_by(CraftRecord.changed).limit(_AT_ONCE)).all()
        for craft_id, revision in waiting:
            if self.closing:
                return
            review = self._ask("review_craft", *self._crafts.entries(craft_id))
            try:
                with self._database.write() as session:
                    ordered = _settle(session, craft_id, revision, review)
            except IntegrityError:  # another server was faster
                continue
            if ordered:
                self._wake()


def _settle(session: Session, craft_id: str, revision: int, review: dict[str, Any]) -> bool:
    """Write down what was found; return whether a joint fit was ordered."""
    craft = session.get(CraftRecord, craft_id, with_for_update=True)
    if craft is None or craft.reviewed >= revision:
        return False
    craft.review, craft.reviewed = review, revision
    flights = list(session.scalars(select(FlightRecord).where(FlightRecord.craft_id == craft_id)))
    _raise(session, craft, [*review["alerts"], *_of_health(flights)])
    # What changed meanwhile is looked at again, and then the joint models.
    return craft.revision == revision and _joint(session, craft, flights, review["joint"])


def _of_health(flights: Sequence[FlightRecord]) -> list[dict[str, Any]]:
    """List flights that ended badly or were in danger."""
    return [
        {
            "about": f"health|{flight.id}",
            "id": "flight-unhealthy",
            "severity": "warning",
            "text": f"{flight.name}: {line['word']}. {line['text']}",
            "flight": flight.name,
        }
        for flight in flights
        for line in flight.answers
        if line["purpose"] == "Happened" and line["tone"] == "bad"
    ]


def _raise(session: Session, craft: CraftRecord, alerts: Sequence[dict[str, Any]]) -> None:
    known = set(session.scalars(select(AlertRecord.about).where(AlertRecord.craft_id == craft.id)))
    hooks = list(session.scalars(select(HookRecord.id).where(HookRecord.owner == craft.owner, HookRecord.url != "")))
    now = datetime.now(UTC)
    new = {about: alert for alert in alerts if (about := digest(alert["about"])) not in known}
    for about, alert in list(new.items())[-_MOST_ALERTS:]:
        record = AlertRecord(
            id=new_id(),
            craft_id=craft.id,
            about=about,
            kind=alert["id"],
            severity=alert["severity"],
            text=alert["text"][:2000],
            flight=alert["flight"][:200],
            created=now,
        )
        session.add(record)
        session.flush()
        session.add_all(DeliveryRecord(alert_id=record.id, hook_id=hook, due=now, attempts=0) for hook in hooks)


def _joint(session: Session, craft: CraftRecord, flights: Sequence[FlightRecord], usable: Sequence[str]) -> bool:
    """Order joint models where there are none, where one of their flights is gone, or where there are many more."""
    wanted = [flight for flight in flights if flight.name in set(usable) and flight.analysis_id is not None]
    ids = {flight.id for flight in wanted}
    if craft.joint_of and not ids.issuperset(craft.joint_of):
        craft.joint_of, craft.joint_lost = [], "they held flights that are not pooled any more"
    if len(wanted) < next_fit(len(craft.joint_of)):
        return False
    open_ = select(AnalysisRecord).where(
        AnalysisRecord.craft_id == craft.id, AnalysisRecord.state.in_((State.QUEUED, State.RUNNING))
    )
    failed = select(AnalysisRecord).where(AnalysisRecord.craft_id == craft.id, AnalysisRecord.state == State.FAILED)
    if session.scalar(open_.limit(1)) is not None:
        return False  # its end is a change
    order = [flight.id for flight in wanted]
    if any(record.configuration.get("flights") == order for record in session.scalars(failed)):
        return False
    newest = max(wanted, key=lambda flight: flight.start or flight.added)
    analysis = session.get(AnalysisRecord, newest.analysis_id)
    order_joint_fit(session, craft, wanted, None if analysis is None else analysis.configuration.get("mass"))
    return True
