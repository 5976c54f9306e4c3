"""Envelope of a craft: ranges that its training flights covered, and where held-out flights leave them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from logparse import Finding
from pipeline.results.coverage import Cell


@dataclass(frozen=True, slots=True, kw_only=True)
class RangeFlown:
    """Time at values of a quantity, of flights that train and of those that judge."""

    title: str
    unit: str
    step: float  #: Width of a bin.
    first: int  #: Number of the first bin, which begins at ``first * step``.
    #: s in each bin.
    training: tuple[float, ...]
    held_out: tuple[float, ...]
    #: Range that holds all but `MARGIN` of the training time at either end; None without any.
    fitted: tuple[float, float] | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Excursion:
    """A judging flight beyond what models were fitted to: for which part of its time, and how far."""

    flight: str
    quantity: str
    part: float
    reach: float
    fitted: tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class EnvelopeMap:
    """Time at each ground speed and altitude, fitted and judged."""

    training: tuple[Cell, ...]
    held_out: tuple[Cell, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightWind:
    """Mean wind of a flight: speed and its error [m/s], and where it came from, rad clockwise from north."""

    flight: str
    part: str
    speed: float
    direction: float
    sigma: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Envelope:
    """What the flights of a craft covered together."""

    training: tuple[str, ...]
    held_out: tuple[str, ...]
    quantities: Mapping[str, RangeFlown]  #: By the names of `pipeline.results.coverage.QUANTITIES`.
    map: EnvelopeMap
    winds: tuple[FlightWind, ...]  #: Of flights whose wind is known.
    outside: tuple[Excursion, ...]
    findings: tuple[Finding, ...]
