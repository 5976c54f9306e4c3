"""A flight in short: what the coordinator of a folder keeps of it, and what advice is computed from."""

from __future__ import annotations

import hashlib
import math
import re

from core.findings import apart
from logparse import Finding
from pipeline.flight.craft import build_of, craft_name
from pipeline.flight.flight_parameters import flight_parameters, response_curves
from pipeline.results.entry import FlightEntry
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult

#: Most rows of a track: they tell whether two logs recorded the same flight, and draw a small map.
TRACK_ROWS = 200


def flight_entry(
    result: FlightResult, *, folder: str = "", source: str = "", key: str = "", pages: str = ""
) -> FlightEntry:
    """Return a flight in short, with where its products are."""
    log = result.log
    models = {each.key: each.missing for each in result.models if each.missing}
    return FlightEntry(
        name=result.name,
        number=result.number,
        of=result.of,
        sha256=log.sha256,
        size=log.size,
        format=log.format,
        start_utc=log.start_utc,
        duration=float(log.duration),
        craft=log.craft,
        craft_name=craft_name(log.vehicle),
        frame_class=log.vehicle.frame_class,
        vehicle=partition(log.craft, log.vehicle.frame_class),
        flight=present(result.flight),
        origin=_origin(result),
        track=_track(result),
        position_known=result.position_known,
        experiments=tuple(result.experiments),
        missing={**models, **result.missing},
        coverage=present(result.coverage),
        board=log.board,
        build=build_of(log.vehicle),
        tune=dict(log.tune),
        parameters=tuple(flight_parameters(result)),
        responses=tuple(response_curves(result)),
        trims=result.trims,
        account=present(result.account),
        autopilot=result.autopilot,
        findings=_findings(result),
        folder=folder,
        source=source,
        key=key,
        pages=pages,
    )


def _findings(result: FlightResult) -> tuple[Finding, ...]:
    """List what the log and the fits had to say, each once."""
    fits = (finding for model in result.models for finding in model.findings)
    return tuple({(finding.id, finding.reason): finding for finding in (*apart(result.findings), *fits)}.values())


def partition(craft: str, frame_class: str | None) -> str:
    """Name a craft so that folders and query engines take it: its frame and a short digest of its fingerprint."""
    frame = re.sub(r"[^a-z0-9-]+", "-", (frame_class or "craft").lower())
    return f"{frame}-{hashlib.sha256(craft.encode()).hexdigest()[:10]}"


def _origin(result: FlightResult) -> tuple[float, float, float] | None:
    if isinstance(result.trajectory, Failure):
        return None
    origin = result.trajectory.origin
    place = (float(origin.lat), float(origin.lon), float(origin.alt))
    return place if all(map(math.isfinite, place)) else None


def _track(result: FlightResult) -> tuple[tuple[float, float, float, float], ...]:
    """Thin the trajectory of the flight."""
    if isinstance(result.trajectory, Failure) or isinstance(result.flight, Failure):
        return ()
    states = result.trajectory.states.loc[result.flight.start : result.flight.stop, ["p_n", "p_e", "p_d"]]
    step = max(1, -(-len(states) // TRACK_ROWS))
    chosen = states.iloc[::step].reset_index().to_numpy(float)
    return tuple((t, *ned) for t, *ned in chosen.tolist() if all(map(math.isfinite, (t, *ned))))
