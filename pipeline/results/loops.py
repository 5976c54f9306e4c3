"""How the loops of the autopilot behaved in one flight, chirps or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLoops:
    """What ordinary flight shows of the loops; margins are those of `RotationResult`.

    Attributes
    ----------
    oscillations : mapping of str to float
        Frequency at which an axis oscillates by itself, Hz; empty where none does.
    tracking : mapping of str to float
        RMS difference between asked and flown roll and pitch, rad; empty where it was not logged.
    """

    oscillations: Mapping[str, float] = field(default_factory=dict)
    tracking: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return numbers for JSON."""
        return {"oscillations_hz": dict(self.oscillations), "tracking_rad": dict(self.tracking)}
