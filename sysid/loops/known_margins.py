"""Margins of a loop as numbers with errors, which reports keep: read without the numerical packages."""

from __future__ import annotations

from dataclasses import dataclass

from core.parameter import Parameter
from core.quantity import uncertain
from core.summary import Summarised

#: Names, units and what is missing when the band shows no margin.
MARGINS = {
    "gain_db": ("dB", "the phase does not reach -180 deg within the measured band"),
    "phase_deg": ("deg", "the gain does not fall through one within the measured band"),
    "crossover_hz": ("Hz", "the gain does not fall through one within the measured band"),
    "rejection_hz": ("Hz", "disturbances are not rejected at the lowest measured frequency"),
    "peak_db": ("dB", ""),
}


@dataclass(frozen=True, slots=True, repr=False)
class Margins(Summarised):
    """Margins of a loop broken at the mixer, each with its standard error; None where the band shows none.

    `intervals` holds the 95 % interval of each that is known; `unstable` is the part of the responses that the data
    leave possible for which the closed loop is unstable.
    """

    gain_db: Parameter
    phase_deg: Parameter
    crossover_hz: Parameter
    rejection_hz: Parameter
    peak_db: Parameter
    intervals: dict[str, tuple[float, float]]
    stable: bool
    unstable: float

    def summary(self) -> dict[str, str]:
        """Return each margin that the band shows, and whether the loop is stable."""
        determined = {name: e for name in MARGINS if (e := getattr(self, name)).value is not None}
        margins = {name: uncertain(e.value, e.sigma, e.unit) for name, e in determined.items()}
        return {"loop": "stable" if self.stable else "UNSTABLE"} | margins
