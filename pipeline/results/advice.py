"""One thing to do better next time, with its reason, what it gains, and the settings to make."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.results.entry import FlightEntry

#: Flights that a sentence names.
_MOST_NAMED = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice:
    """What to do next time."""

    id: str  #: Stable kebab-case name.
    #: Lower is more useful: below 10 nothing can be identified without it, below 20 results are wrong or at risk, below
    #: 30 a parameter or an axis stays unknown, above that it is better known.
    rank: int
    do: str  #: In the imperative.
    why: str  #: What these flights lacked, in numbers.
    gain: str  #: What it brings.
    #: Parameters of the autopilot to set; those that hold bits are whole numbers.
    settings: Mapping[str, int | float] = field(default_factory=dict)
    flights: tuple[str, ...] = ()  #: That it is about; empty when about all.


def names_of(flights: Sequence[FlightEntry], total: int) -> str:
    """Name flights in a sentence; all of several are not listed."""
    if len(flights) == total:
        return f"all {total} flights" if total > 1 else "this flight"
    names = [flight.name for flight in flights[:_MOST_NAMED]]
    more = len(flights) - len(names)
    return ", ".join(names) + (f" and {more} more" if more else "")


def having(flights: Sequence[FlightEntry], *findings: str) -> list[FlightEntry]:
    """Choose the flights with one of these findings."""
    return [flight for flight in flights if any(finding.id in findings for finding in flight.findings)]
