"""On which day and at which place flights took off."""

from __future__ import annotations

import math
from collections.abc import Sequence
from datetime import timedelta
from typing import TYPE_CHECKING

from pipeline.flight.craft import took_off

if TYPE_CHECKING:
    from pipeline.results.entry import FlightEntry

#: Flights that begin within this distance of each other are at one place, m.
ONE_PLACE = 2000.0

_EARTH_RADIUS = 6.371e6


def day_of(flight: FlightEntry) -> str:
    """Day on which a flight took off, by the sun where it did; empty where the log does not tell."""
    start = took_off(flight)
    if start is None:
        return ""
    place = _place(flight)
    # An hour for 15 degrees of longitude; the political zone is not known, and need not be.
    local = start + timedelta(hours=0.0 if place is None else math.degrees(place[1]) / 15.0)
    return local.date().isoformat()


def places_of(flights: Sequence[FlightEntry]) -> dict[str, int]:
    """Assign numbers to the places of take-off, by flight's name; -1 where the log does not tell."""
    centres: list[tuple[float, float]] = []
    numbers: dict[str, int] = {}
    for flight in sorted(flights, key=lambda each: (_place(each) or (math.inf, math.inf), each.name)):
        place = _place(flight)
        if place is None:
            numbers[flight.name] = -1
            continue
        near = [k for k, centre in enumerate(centres) if _distance(place, centre) < ONE_PLACE]
        if not near:
            centres.append(place)
        numbers[flight.name] = near[0] if near else len(centres) - 1
    return numbers


def _place(flight: FlightEntry) -> tuple[float, float] | None:
    """Latitude and longitude of the take-off, rad."""
    if flight.origin is None:
        return None
    lat, lon, _ = flight.origin
    north, east = flight.track[0][1:3] if flight.track else (0.0, 0.0)
    return lat + north / _EARTH_RADIUS, lon + east / (_EARTH_RADIUS * max(math.cos(lat), 1e-6))


def _distance(a: tuple[float, float], b: tuple[float, float]) -> float:
    """Distance of two places on a sphere, m."""
    half = math.sin((a[0] - b[0]) / 2.0) ** 2 + math.cos(a[0]) * math.cos(b[0]) * math.sin((a[1] - b[1]) / 2.0) ** 2
    return 2.0 * _EARTH_RADIUS * math.asin(min(1.0, math.sqrt(half)))
