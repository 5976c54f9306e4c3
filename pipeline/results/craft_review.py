"""A craft looked at as a whole after each of its flights: what is pooled, what changed, and what is worth an alert."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime

from logparse import Severity
from pipeline.results.drift import Drift
from pipeline.results.quantity import ParameterChange
from sysid.autopilot.values import AutopilotValues


@dataclass(frozen=True, slots=True, kw_only=True)
class Note:
    """What was done to a craft, as its owner wrote it down."""

    at: datetime  #: UTC.
    text: str
    boundary: bool = False  #: Flights before it are not pooled with those after it.


@dataclass(frozen=True, slots=True, kw_only=True)
class Alert:
    """Something that left its band; equal `about` is the same alert, however often it is found."""

    about: str
    id: str  #: As a finding has it.
    severity: Severity
    text: str
    flight: str  #: After which flight it was seen.


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftReview:
    """What the flights of one craft say together without a joint fit: sums over what each says by itself."""

    flights: tuple[str, ...]  #: In order.
    #: Of them those since the last boundary, and among those again the ones built as the newest is.
    pooled: tuple[str, ...]
    boundary: Note | None  #: The last before the newest flight.
    drift: Drift | None  #: Of the pooled flights.
    whole: Drift | None  #: Of all flights, where not all are pooled.
    since: tuple[ParameterChange, ...]  #: What changed with the boundary.
    alerts: tuple[Alert, ...]
    autopilot: AutopilotValues | None = None  #: What the pooled flights propose to the autopilot; None of nothing.
    #: Of the pooled flights those that joint models can use; empty where they are fewer than two.
    joint: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()  #: What about the flights as a series is strange, and what was done about it.
