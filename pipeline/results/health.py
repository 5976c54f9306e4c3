"""What happened in a flight, and which part of it can serve models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from logparse import FlightEvent
    from pipeline.results.flight import Span


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightHealth:
    """Timeline of a log, with the part of the analysed flight that trains and judges models.

    Attributes
    ----------
    events : tuple of FlightEvent
        In the order of time, of all flights of the log.
    sound : Span or None
        The part of the analysed flight before a motor failed or control was lost for good; the whole flight where
        nothing of the kind happened, None without a flight.
    cause : FlightEvent or None
        Why the rest is left out; None where nothing is.
    motors_missing : str
        Why failing motors could not be looked for; empty where they were.
    """

    events: tuple[FlightEvent, ...]
    sound: Span | None
    cause: FlightEvent | None = None
    motors_missing: str = ""

    @property
    def notable(self) -> tuple[FlightEvent, ...]:
        """Events that a healthy flight does not have."""
        return tuple(event for event in self.events if event.notable)
