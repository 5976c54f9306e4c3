"""Envelope of a craft: ranges that its training flights covered, and where held-out flights leave them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from logparse import Finding


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeFlown:
    """Time at values of a quantity, of flights that train and of those that judge.

    Attributes
    ----------
    title, unit : str
    step : float
        Width of a bin.
    first : int
        Number of the first bin, which begins at ``first * step``.
    training, held_out : tuple of float
        s in each bin.
    fitted : tuple of 2 float or None
        Range that holds all but `MARGIN` of the training time at either end; None without any.
    """

    title: str
    unit: str
    step: float
    first: int
    training: tuple[float, ...]
    held_out: tuple[float, ...]
    fitted: tuple[float, float] | None

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        numbers = {name: getattr(self, name) for name in ("title", "unit", "step", "first")}
        return numbers | {
            "training": list(self.training),
            "held_out": list(self.held_out),
            "fitted": None if self.fitted is None else list(self.fitted),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Excursion:
    """A judging flight beyond what models were fitted to: for which part of its time, and how far."""

    flight: str
    quantity: str
    part: float
    reach: float
    fitted: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {name: getattr(self, name) for name in ("flight", "quantity", "part", "reach")} | {
            "fitted": list(self.fitted)
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """What the flights of a craft covered together.

    Attributes
    ----------
    training, held_out : tuple of str
    quantities : mapping of str to RangeFlown
        By the names of `pipeline.results.coverage.QUANTITIES`.
    map : mapping
        ``x y x_step y_step`` and the cells ``[i, j, s]`` of ``training`` and ``held_out``.
    winds : tuple of mapping
        ``flight part speed from sigma`` of flights whose wind is known.
    outside : tuple of Excursion
    flights : tuple of mapping
        ``flight part start_utc place seconds acceleration_rms`` of each flight.
    findings : tuple of Finding
    """

    training: tuple[str, ...]
    held_out: tuple[str, ...]
    quantities: Mapping[str, RangeFlown]
    map: Mapping[str, Any]
    winds: tuple[Mapping[str, Any], ...]
    outside: tuple[Excursion, ...]
    flights: tuple[Mapping[str, Any], ...]
    findings: tuple[Finding, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        return {
            "training": list(self.training),
            "held_out": list(self.held_out),
            "quantities": {name: each.to_dict() for name, each in self.quantities.items()},
            "map": dict(self.map),
            "winds": [dict(wind) for wind in self.winds],
            "outside": [each.to_dict() for each in self.outside],
            "flights": [dict(flight) for flight in self.flights],
            "findings": [finding.to_dict() for finding in self.findings],
        }
