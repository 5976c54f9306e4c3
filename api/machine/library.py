"""What machine access reads from: flights and craft of the service, or of a folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pipeline.results.craft_review import CraftReview
from pipeline.results.quantity import ParameterChange
from pipeline.results.report import FlightReport

#: What stands in every answer where there is no number.
NOT_DETERMINED = "not determined"


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightRef:
    """A flight that can be asked about."""

    id: str
    name: str
    craft: str  #: Id of its craft.
    craft_name: str
    start_utc: str | None  #: Take-off.
    healthy: str  #: A word.


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftRef:
    """A craft that can be asked about."""

    id: str
    name: str
    kind: str
    flights: int


class Library(Protocol):
    """Flights and craft, to be read only."""

    def flights(self, craft: str = "", text: str = "", limit: int | None = None) -> tuple[Sequence[FlightRef], int]:
        """List flights, the newest first, and count them."""
        ...

    def flight(self, name: str) -> str | None:
        """Return the id of a flight by that id or its name; None where there is none."""
        ...

    def crafts(self) -> Sequence[CraftRef]:
        """List the craft."""
        ...

    def report(self, flight: str) -> FlightReport | None:
        """Read the report of a flight by its id."""
        ...

    def review(self, craft: str) -> CraftReview | None:
        """Read what the flights of a craft say together."""
        ...

    def compare(self, a: str, b: str) -> Sequence[ParameterChange] | None:
        """Compare the parameters of two flights as `reports.numbers.comparison` does; None where one is not there."""
        ...
