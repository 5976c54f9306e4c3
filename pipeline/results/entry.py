"""What the coordinator of a folder keeps of each flight and craft while their trajectories and models lie in the store.

Entries are light (some kilobytes), travel between processes, and stand as ``entry.json`` in the folder of their
products, where they also say that the folder is whole: an entry is written last.
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime
from typing import Any

from pipeline.results.flight import FlightResult, GroupResult, Span

#: Most rows of a track: they tell whether two logs recorded the same flight, and draw a small map.
TRACK_ROWS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightEntry:
    """One analysed log, in short.

    Attributes
    ----------
    name : str
        Of the flight, unique among the logs analysed together.
    folder : str
        Where its products lie, below ``flights/`` of the store and as partition ``flight=`` of the datasets.
    source : str
        Path or URL of the log.
    key : str
        Equal for equal content of the log, name, configuration and software: then the products are the same too.
    sha256, size, format, boots, start_utc, duration
        Of the log, as in `pipeline.LogFacts`.
    craft : str
        Equal for logs of the same craft, see `pipeline.flight.craft.fingerprint`.
    craft_name : str
        The craft for people, such as ``"ArduCopter octa plus"``.
    frame_class : str or None
        As in `logparse.Vehicle`.
    vehicle : str
        The craft as partition ``vehicle=`` of the datasets, see `partition`.
    flight : Span or None
        The airborne time that was analysed, s on the log's boot clock.
    origin : tuple of float or None
        Latitude and longitude, rad, and altitude, m, of the origin of `track`; None where the log does not tell.
    track : tuple of (t, north, east, down)
        At most `TRACK_ROWS` rows over the flight, s on the boot clock and m from `origin`.
    position_known : bool
        Whether there is a horizontal position, and not only what inertial navigation without GPS drifted to.
    experiments : tuple of str
        Kinds of models (`pipeline.flight.kinds`) that the store has an experiment for.
    modelled : bool
        Whether anything could be identified from this flight alone.
    missing : mapping of str to str
        Why a stage or a kind of model gave nothing, by its key.
    coverage : mapping
        What the flight excited and covered, as `pipeline.flight.coverage` sums it up.
    board : str or None
        The autopilot's own id, as in `pipeline.LogFacts`.
    build, tune : mapping
        How the craft is built, and its gains and filters, as `pipeline.flight.craft.build_of` and `tune_of` list them.
    mixer : mapping of str to list of float
        Roll, pitch and yaw factor of each motor by its name, as in `logparse.Motor`.
    parameters : tuple of mapping
        What the flight alone says about its craft, as `pipeline.flight.flight_parameters` lists it.
    findings : tuple of mapping
        ``id severity evidence`` of what the log, the trajectory and the fits had to say; the words are in the report.
    timings : mapping of str to float
        Seconds that each stage took.
    """

    name: str
    folder: str
    source: str
    key: str
    sha256: str
    size: int
    format: str
    boots: int
    start_utc: datetime | None
    duration: float
    craft: str
    craft_name: str
    frame_class: str | None
    vehicle: str
    flight: Span | None = None
    origin: tuple[float, float, float] | None = None
    track: tuple[tuple[float, float, float, float], ...] = ()
    position_known: bool = False
    experiments: tuple[str, ...] = ()
    modelled: bool = False
    missing: Mapping[str, str] = field(default_factory=dict)
    coverage: Mapping[str, Any] = field(default_factory=dict)
    board: str | None = None
    build: Mapping[str, str | float | None] = field(default_factory=dict)
    tune: Mapping[str, str | float] = field(default_factory=dict)
    mixer: Mapping[str, list[float]] = field(default_factory=dict)
    parameters: tuple[Mapping[str, Any], ...] = ()
    findings: tuple[Mapping[str, Any], ...] = ()
    timings: Mapping[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Give what JSON can say."""
        entry = {each.name: getattr(self, each.name) for each in fields(self)}
        entry["start_utc"] = None if self.start_utc is None else self.start_utc.isoformat()
        entry["flight"] = None if self.flight is None else [self.flight.start, self.flight.stop]
        return {name: _plain(value) for name, value in entry.items()}

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> FlightEntry:
        """Read what `to_dict` gave, through JSON or not."""
        known = dict(entry)
        known["start_utc"] = None if entry["start_utc"] is None else datetime.fromisoformat(entry["start_utc"])
        known["flight"] = None if entry["flight"] is None else Span(*entry["flight"])
        known["origin"] = None if entry["origin"] is None else tuple(entry["origin"])
        known["track"] = tuple(tuple(row) for row in entry["track"])
        for name in ("experiments", "parameters", "findings"):
            known[name] = tuple(entry[name])
        return cls(**known)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroupEntry:
    """Several flights of one craft, identified jointly, in short.

    Attributes
    ----------
    name : str
        The craft for people.
    folder : str
        Where its products lie, below ``crafts/`` of the store.
    key : str
        Equal for equal flights (by their keys), split, configuration and software.
    craft, vehicle : str
        As of its flights.
    training, held_out : tuple of str
        Names of the flights fitted and of those kept to judge.
    split : str
        How the two were chosen, in a sentence.
    result : GroupResult or None
        The models, where they were fitted in this run; else they are read from the store.
    """

    name: str
    folder: str
    key: str
    craft: str
    vehicle: str
    training: tuple[str, ...]
    held_out: tuple[str, ...]
    split: str
    result: GroupResult | None = field(default=None, compare=False, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Give what JSON can say; the result is not among it."""
        return {each.name: _plain(getattr(self, each.name)) for each in fields(self) if each.name != "result"}

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> GroupEntry:
        """Read what `to_dict` gave, through JSON or not."""
        return cls(**{**entry, "training": tuple(entry["training"]), "held_out": tuple(entry["held_out"])})


def flight_entry(
    result: FlightResult, *, folder: str, source: str, key: str, coverage: Mapping[str, Any] | None = None
) -> FlightEntry:
    """Sum a flight up.

    Parameters
    ----------
    result : FlightResult
    folder, source, key : str
        As the attributes of `FlightEntry`.
    coverage : mapping, optional
    """
    from pipeline.flight.craft import build_of, craft_name
    from pipeline.flight.flight_parameters import flight_parameters

    log = result.log
    models = {each.key: each.missing for each in result.models if each.missing}
    return FlightEntry(
        name=result.name,
        folder=folder,
        source=source,
        key=key,
        sha256=log.sha256,
        size=log.size,
        format=log.format,
        boots=log.boots,
        start_utc=log.start_utc,
        duration=float(log.duration),
        craft=log.craft,
        craft_name=craft_name(log.vehicle),
        frame_class=log.vehicle.frame_class,
        vehicle=partition(log.craft, log.vehicle.frame_class),
        flight=result.flight and Span(float(result.flight.start), float(result.flight.stop)),
        origin=_origin(result),
        track=_track(result),
        position_known=result.position_known,
        experiments=tuple(result.experiments),
        modelled=result.thrust is not None or any(each.model is not None for each in result.models),
        missing={**models, **result.missing},
        coverage=coverage or {},
        board=log.board,
        build=build_of(log.vehicle),
        tune=dict(log.tune),
        mixer={f"m{motor.number}": [motor.roll, motor.pitch, motor.yaw] for motor in log.vehicle.motors},
        parameters=tuple(flight_parameters(result)),
        findings=tuple(_findings(result)),
        timings=dict(result.timings),
    )


def _plain(value: Any) -> Any:
    """Reduce to what strict JSON can say: None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


def _findings(result: FlightResult) -> Iterator[dict[str, Any]]:
    """List what the log and the fits had to say, each once."""
    fits = (finding for model in result.models for finding in model.findings)
    once = {(finding.id, finding.reason): finding for finding in (*result.findings, *fits)}
    for finding in once.values():
        told = finding.to_dict()
        yield {name: told[name] for name in ("id", "severity", "evidence")}


def partition(craft: str, frame_class: str | None) -> str:
    """Name a craft so that folders and query engines take it: its frame and a short digest of its fingerprint."""
    frame = re.sub(r"[^a-z0-9-]+", "-", (frame_class or "craft").lower())
    return f"{frame}-{hashlib.sha256(craft.encode()).hexdigest()[:10]}"


def _origin(result: FlightResult) -> tuple[float, float, float] | None:
    if result.trajectory is None:
        return None
    origin = result.trajectory.origin
    place = (float(origin.lat), float(origin.lon), float(origin.alt))
    return place if all(map(math.isfinite, place)) else None


def _track(result: FlightResult) -> tuple[tuple[float, float, float, float], ...]:
    """Thin the trajectory of the flight."""
    if result.trajectory is None or result.flight is None:
        return ()
    states = result.trajectory.states.loc[result.flight.start : result.flight.stop, ["p_n", "p_e", "p_d"]]
    step = max(1, -(-len(states) // TRACK_ROWS))
    chosen = states.iloc[::step].reset_index().to_numpy(float)
    return tuple((t, *ned) for t, *ned in chosen.tolist() if all(map(math.isfinite, (t, *ned))))
