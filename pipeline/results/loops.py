"""How the loops of the autopilot behaved in one flight, chirps or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLoops:
    """What ordinary flight shows of the loops; margins are those of `RotationResult`."""

    #: Frequency at which an axis oscillates by itself, Hz; empty where none does.
    oscillations_hz: Mapping[str, float] = field(default_factory=dict)
    #: RMS difference between asked and flown roll and pitch, rad; empty where it was not logged.
    tracking_rad: Mapping[str, float] = field(default_factory=dict)
