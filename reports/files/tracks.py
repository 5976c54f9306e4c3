"""The track of a flight in the forms that maps read: GeoJSON (RFC 7946), KML 2.2 and GPX 1.1."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pymap3d

from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from reports.pages.html import render_text

#: Names of the files.
FILES = ("track.geojson", "track.kml", "track.gpx")


@dataclass(frozen=True, slots=True)
class _Point:
    """One place: degrees, m above mean sea level, s on the log's clock, UTC where known."""

    lat: float
    lon: float
    alt: float
    t: float
    utc: datetime | None

    @property
    def stamp(self) -> str:
        return "" if self.utc is None else self.utc.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def write_track(result: FlightResult, folder: Path) -> tuple[Path, ...]:
    """Write the estimated track of the analysed flight, with the notable events as points."""
    points = _points(result)
    if len(points) < 2:
        for name in FILES:
            (folder / name).unlink(missing_ok=True)
        return ()
    events = _events(result, points)
    shown = {"name": result.name, "points": points, "events": events}
    texts = (_geojson(result.name, points, events), *(render_text(name, **shown) for name in FILES[1:]))
    files = tuple(folder / name for name in FILES)
    for file, text in zip(files, texts, strict=True):
        file.write_text(text, encoding="utf-8")
    return files


def _points(result: FlightResult) -> list[_Point]:
    trajectory, flight = result.trajectory, result.flight
    if isinstance(trajectory, Failure) or isinstance(flight, Failure) or not result.position_known:
        return []
    origin = trajectory.origin
    if not np.isfinite([origin.lat, origin.lon, origin.alt]).all():
        return []
    states = trajectory.states.loc[flight.start : flight.stop, ["p_n", "p_e", "p_d"]].dropna()
    if len(states) < 2:
        return []
    t = states.index.to_numpy(np.float64)
    usual = max(float(np.median(np.diff(t))), 1e-6)
    # At most 20,000 points, 0.2 s or more apart.
    step = max(1, round(0.2 / usual), math.ceil(len(t) / 20_000))
    rows = np.unique(np.append(np.arange(0, len(t), step), len(t) - 1))
    north, east, down = states.to_numpy(np.float64)[rows].T
    lat, lon, alt = pymap3d.ned2geodetic(north, east, down, origin.lat, origin.lon, origin.alt, deg=False)
    start = result.log.started
    return [
        _Point(math.degrees(a), math.degrees(b), float(c), float(s), _utc(start, float(s)))
        for a, b, c, s in zip(lat, lon, alt, t[rows], strict=True)
    ]


def _utc(start: datetime | None, t: float) -> datetime | None:
    return None if start is None else (start + timedelta(seconds=t)).astimezone(UTC)


def _events(result: FlightResult, points: list[_Point]) -> list[tuple[str, str, _Point]]:
    """Name, sentence and place of each notable event."""
    account = present(result.account)
    if account is None:
        return []
    times = np.array([point.t for point in points])
    events = []
    for event in account.notable:
        if times[0] - 1.0 <= event.t <= times[-1] + 5.0:
            nearest = points[int(np.argmin(np.abs(times - event.t)))]
            events.append((event.id.replace("-", " "), f"{event.t:.1f} s: {event.reason}", nearest))
    return events


def _geojson(name: str, points: list[_Point], events: list[tuple[str, str, _Point]]) -> str:
    line = {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": [_position(point) for point in points]},
        "properties": {
            "name": name,
            "t_s": [round(point.t, 3) for point in points],
            "coordTimes": [point.stamp for point in points] if points[0].utc is not None else None,
        },
    }
    marks = [
        {
            "type": "Feature",
            "geometry": {"type": "Point", "coordinates": _position(point)},
            "properties": {"name": title, "description": text, "t_s": round(point.t, 3)},
        }
        for title, text, point in events
    ]
    return json.dumps({"type": "FeatureCollection", "features": [line, *marks]}, ensure_ascii=False) + "\n"


def _position(point: _Point) -> list[float]:
    return [round(point.lon, 8), round(point.lat, 8), round(point.alt, 2)]
