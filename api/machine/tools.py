"""What programs and assistants can ask: numbers with unit, error and provenance, and nothing that changes anything.

The same questions are asked over HTTP (`api.routes.questions`) and over MCP (`api.machine.mcp_server`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated

from fastapi import Query

from api.machine.answers import (
    NOT_DETERMINED,
    Answers,
    Changes,
    ComparedFlights,
    CraftList,
    Events,
    FlightList,
    LoopMargins,
    NextFlights,
    Parameters,
    Predictions,
)
from api.machine.library import Library
from pipeline.results.report import FlightReport
from reports.numbers.quantities import (
    answers_of,
    craft_parameters,
    health_of,
    margins_of,
    parameters_of,
    predictions_of,
)

#: Most items of one answer.
MOST = 1000


# Queries of HTTP are fields of pydantic, as which the tools of MCP describe them too.
Flight = Annotated[str, Query(max_length=200, description="Id or name of a flight.")]
CraftName = Annotated[str, Query(max_length=200, description="Id or name of a craft.")]
Part = Annotated[str, Query(max_length=200, description="Part of a flight's name.")]
Most = Annotated[int, Query(ge=1, le=MOST, description="Items at most.")]


class UnknownError(Exception):
    """There is no flight or craft of this id or name."""


class UnclearError(UnknownError):
    """A question does not say of which flight or craft it is."""


@dataclass(frozen=True, slots=True)
class Tools:
    """The questions, asked of a library."""

    library: Library

    def list_flights(self, craft: CraftName = "", text: Part = "", limit: Most = 100) -> FlightList:
        """List flights, the newest first: id, name, craft, take-off (UTC), and what happened in them."""
        self.library.refresh()
        chosen = self._craft(craft) if craft else ""
        found, total = self.library.flights(chosen, text, min(max(limit, 1), MOST))
        return FlightList(found, total)

    def list_craft(self) -> CraftList:
        """List craft: id, name, kind, and how many flights each has."""
        self.library.refresh()
        return CraftList(list(self.library.crafts()))

    def get_answers(self, flight: Flight) -> Answers:
        """Get the first screen of a flight: what happened, the state of the craft, loops, parameters, models."""
        return Answers(answers_of(self._report(flight)))

    def get_parameters(self, flight: Flight = "", craft: CraftName = "") -> Parameters:
        """Get physical parameters by every method: of one flight, or of a craft over its flights (name one of both)."""
        if craft and not flight:
            review = self.library.review(self._craft(craft))
            if review is None:
                raise UnknownError(f"{craft} has not been looked at yet")
            return Parameters(craft_parameters(review))
        if not flight:
            raise UnclearError("name a flight or a craft")
        return Parameters(parameters_of(self._report(flight)))

    def get_margins(self, flight: Flight) -> LoopMargins:
        """Get gain and phase margins, crossover, disturbance rejection and peaks of each axis, and bandwidths."""
        return LoopMargins(margins_of(self._report(flight)))

    def get_health(self, flight: Flight) -> Events:
        """Get what happened in a flight, when (s on the log's boot clock), how grave it was, and what to do."""
        return Events(health_of(self._report(flight)))

    def get_predictions(self, flight: Flight) -> Predictions:
        """Get how far ahead each model of a flight predicts (s), and its RMS error there (m) on held-out time."""
        return Predictions(predictions_of(self._report(flight)))

    def get_changes(self, craft: CraftName) -> Changes:
        """Get what changes over the flights of a craft: slopes and steps of each parameter, motors, what is strange."""
        review = self.library.review(self._craft(craft))
        if review is None:
            raise UnknownError(f"{craft} has not been looked at yet")
        drift = review.drift
        return Changes(
            flights=review.flights,
            pooled=review.pooled,
            changes=[] if drift is None else [each for each in drift.parameters if each.change is not None],
            motors=NOT_DETERMINED if drift is None or drift.motors is None else drift.motors.sentence,
            since=review.since,
            alerts=review.alerts,
            remarks=review.remarks,
        )

    def compare(self, before: Flight, after: Flight) -> ComparedFlights:
        """Compare the parameters of two flights: values, difference with its error, and the chance of it (p)."""
        rows = self.library.compare(self._flight(before), self._flight(after))
        if rows is None:
            raise UnknownError(f"{before} and {after} cannot be compared")
        return ComparedFlights(rows or NOT_DETERMINED)

    def what_to_fly(self, flight: Flight) -> NextFlights:
        """Get what to log and fly next time, the most useful first: what a flight lacked, what it would bring."""
        return NextFlights(sorted(self._report(flight).advice, key=lambda each: each.rank))

    def all(self) -> Sequence[Callable[..., object]]:
        """List the questions."""
        return (
            self.list_flights,
            self.list_craft,
            self.get_answers,
            self.get_parameters,
            self.get_margins,
            self.get_health,
            self.get_predictions,
            self.get_changes,
            self.compare,
            self.what_to_fly,
        )

    def _report(self, flight: str) -> FlightReport:
        report = self.library.report(self._flight(flight))
        if report is None:
            raise UnknownError(f"{flight} has no report of this version; analyse its log again")
        return report

    def _flight(self, name: str) -> str:
        """Find a flight by its id or its name."""
        self.library.refresh()
        found = self.library.flight(name)
        if found is None:
            raise UnknownError(f"there is no flight {name!r}; list_flights tells which there are")
        return found

    def _craft(self, name: str) -> str:
        """Find a craft by its id or its name, which must not mean several."""
        self.library.refresh()
        crafts = self.library.crafts()
        found = [each.id for each in crafts if name == each.id] or [each.id for each in crafts if name == each.name]
        if len(found) > 1:
            raise UnclearError(f"several craft are called {name!r}; see list_craft")
        if not found:
            raise UnknownError(f"no craft is called {name!r}; see list_craft")
        return found[0]
