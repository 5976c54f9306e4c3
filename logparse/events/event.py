"""`FlightEvent`: one thing that happened in a flight, with its time, its evidence and what to do."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from core.findings import Severity


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightEvent:
    """One entry of a flight's timeline."""

    id: str  #: Stable kebab-case name, such as ``"gps-lost"``; docs/findings.md explains each.
    #: First and last moment, s on the log's boot clock; equal for what has no duration.
    t: float
    end: float
    #: INFO for what belongs to a healthy flight, WARNING for what should be looked into, ERROR for what endangers.
    severity: Severity
    reason: str  #: What happened, in a sentence.
    advice: str = ""  #: What to do about it; empty when there is nothing to do.
    #: Numbers behind the reason, SI units unless the name says otherwise.
    evidence: Mapping[str, str | int | float | bool | None] = field(default_factory=dict)
    source: str = ""  #: Where the limit comes from; empty when no limit is involved.

    @property
    def duration(self) -> float:
        """Seconds from the first to the last moment."""
        return self.end - self.t

    @property
    def notable(self) -> bool:
        """Whether a healthy flight has no such event."""
        return self.severity is not Severity.INFO
