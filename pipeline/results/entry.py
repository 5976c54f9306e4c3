"""What the coordinator of a folder keeps of each flight and craft while their trajectories and models lie in the store.

Entries are light (some kilobytes), travel between processes, and stand as ``entry.json`` in the folder of their
products, where they also say that the folder is whole: an entry is written last.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import datetime
from typing import Any

from pipeline.results.fleet import GroupResult
from pipeline.results.flight import Span


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightSummary:
    """One analysed flight, in short: what advice and the split into training and held-out flights are computed from.

    Attributes
    ----------
    name : str
        Of the flight, unique among the logs analysed together.
    number, of : int
        Which flight of its log it is, 1 for the first, and how many the log has.
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
    number: int = 1
    of: int = 1
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

    @property
    def log_name(self) -> str:
        """What its log is called: of several flights that without the flight's number."""
        return self.name if self.of == 1 else self.name.rpartition("#")[0]


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightEntry(FlightSummary):
    """A flight's summary, and where its products are.

    Attributes
    ----------
    folder : str
        Where its products lie, below ``flights/`` of the store and as partition ``flight=`` of the datasets.
    source : str
        Path or URL of the log.
    key : str
        Equal for equal content of the log, name, configuration and software: then the result is the same too.
    pages : str
        Equal for equal pages of equal results, see `pipeline.storage.manifest.page_key`; empty where none were written.
    """

    folder: str
    source: str
    key: str
    pages: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold."""
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
    pages : str
        As of a flight.
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
    pages: str = ""
    result: GroupResult | None = field(default=None, compare=False, repr=False)

    def to_dict(self) -> dict[str, Any]:
        """Return what JSON can hold; the result is not among it."""
        return {each.name: _plain(getattr(self, each.name)) for each in fields(self) if each.name != "result"}

    @classmethod
    def from_dict(cls, entry: Mapping[str, Any]) -> GroupEntry:
        """Read what `to_dict` gave, through JSON or not."""
        return cls(**{**entry, "training": tuple(entry["training"]), "held_out": tuple(entry["held_out"])})


def _plain(value: Any) -> Any:
    """Reduce to what strict JSON can say: None for what is not finite."""
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
