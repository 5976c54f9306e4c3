"""What a store holds and of which logs, software and settings it was made: ``manifest.json``.

Products say themselves by their entries what they are of; the manifest spares a second run from reading the logs again,
and tells people and programs which products are current.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from core.serialization import plain
from pipeline.config import AnalysisConfig
from pipeline.names import flight_folder
from pipeline.results.craft import Publish
from pipeline.results.fleet import FlightEntry, GroupEntry, LogFailure
from pipeline.software import Software, presentation, software
from pipeline.storage.store import ENTRY, Store

if TYPE_CHECKING:
    from logparse import Finding
    from pipeline.results.fleet import Split

MANIFEST = "manifest.json"

#: Where the products of flights and crafts are in the store.
FLIGHTS, CRAFTS = "flights", "crafts"


@dataclass(frozen=True, slots=True, kw_only=True)
class FileRecord:
    """What became of one file."""

    #: As in `pipeline.storage.sources.Source`.
    url: str
    size: int
    modified: int | str
    sha256: str = ""  #: Of its content; empty where it could not be read.
    name: str = ""  #: Of the flight.
    key: str = ""  #: See `flight_key`.
    folder: str = ""  #: Below ``flights/``, of a log that was analysed.
    reason: str = ""  #: Why it gave nothing.
    original: str = ""  #: Of a copy, the URL of the file that stands for both.
    #: ``"analysed"``; ``"failed"``, for good; ``"interrupted"``, to be tried again; ``"no log"``; ``"duplicate"``.
    state: str = "interrupted"

    def as_failure(self) -> LogFailure:
        """Return the file with its reason."""
        return LogFailure(self.url, self.reason, lasting=self.state == "failed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Manifest:
    """One run over a folder of logs."""

    #: None before anything was analysed.
    software: Software | None = None
    configuration: AnalysisConfig | None = None
    pages: str = ""  #: `page_key` of what shows the results.
    logs: tuple[FileRecord, ...] = ()  #: Every file that was found, in the order of the report.
    crafts: tuple[GroupEntry, ...] = ()
    passed_over: tuple[tuple[str, str], ...] = ()  #: Whatever else was found and not used, with its reason.
    #: Logs that were analysed but have no part in the joint models, with the reason.
    left_out: tuple[tuple[str, str], ...] = ()
    #: Logs of earlier runs that are no longer among the inputs; their products are kept.
    removed: tuple[FileRecord, ...] = ()
    reported: str = ""  #: `identity` of the run that the report in the store is of; empty before it is written.

    @property
    def identity(self) -> str:
        """Equal for runs that found the same and so have the same report."""
        logs = tuple(replace(record, modified=0) for record in self.logs)
        return _digest(replace(self, logs=logs, reported=""))

    def write(self, store: Store) -> None:
        """Write ``manifest.json``, unless it says the same already."""
        if read_manifest(store) != self:
            store.write_json(MANIFEST, self)


def read_manifest(store: Store) -> Manifest:
    """Read ``manifest.json``; an empty manifest where there is none, or one that this software cannot read."""
    return store.read_as(MANIFEST, Manifest) or Manifest()


def page_key(publish: Callable[..., object] | None) -> str:
    """Name what writes pages of results: equal keys promise equal pages of equal results; empty for none."""
    return "" if publish is None else _digest([*presentation(), _named(publish)])


def of_one_flight(config: AnalysisConfig) -> AnalysisConfig:
    """Return the settings without those that choose among flights and do not touch a single one."""
    return replace(config, training=(), validation=())


def flight_key(sha256: str, name: str, config: AnalysisConfig) -> str:
    """Name the result of a log: equal keys promise equal results."""
    return _digest([sha256, name, of_one_flight(config), software()])


def craft_key(
    flights: Iterable[FlightEntry],
    split: Split,
    findings: Iterable[Finding],
    config: AnalysisConfig,
) -> str:
    """Name the result of a craft, from the keys of its flights and what was found of them together."""
    keys = {flight.name: flight.key for flight in flights}
    # The choice counts, and not the pattern that made it.
    made_of = [keys, split.training, split.held_out, split.sentence, tuple(findings)]
    return _digest([made_of, of_one_flight(config), software()])


def _named(function: Callable[..., object] | None) -> object:
    """Describe what writes products, so that another one does not pass for it."""
    if function is None:
        return None
    if isinstance(function, partial):
        return [_named(function.func), repr(function.args), repr(sorted(function.keywords.items()))]
    return f"{function.__module__}.{getattr(function, '__qualname__', type(function).__qualname__)}"


def _digest(value: object) -> str:
    return hashlib.sha256(json.dumps(plain(value), sort_keys=True, ensure_ascii=True).encode()).hexdigest()


def is_current(store: Store, entry: GroupEntry) -> bool:
    """Return whether the store has the products of a craft, with the pages that are wanted."""
    facts = store.read_json(f"{CRAFTS}/{entry.folder}/{ENTRY}") or {}
    return facts.get("key") == entry.key and (not entry.pages or facts.get("pages") == entry.pages)


def write_entry(entry: FlightEntry | GroupEntry, folder: Path) -> None:
    """Write what a run keeps of a flight or a craft at hand into the folder of its products."""
    (folder / ENTRY).write_text(json.dumps(plain(entry)), encoding="utf-8")


def drawn_anew(store: Store, place: str, entry: FlightEntry | GroupEntry, publish: Publish) -> bool:
    """Draw the pages of products anew where the store has what that takes; return whether it has."""
    try:
        with store.scratch() as scratch:
            store.fetch(place, scratch / "product")
            publish(None, scratch / "product")
            write_entry(entry, scratch / "product")
            store.commit(scratch / "product", place)
    except (FileNotFoundError, ValueError):
        return False
    return True


def entries_of(store: Store, folder: str, first: int = 1) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the folders of a log's flights with what their entries say, up to the first that is not there."""
    for number in count(first):
        flight = flight_folder(folder, number)
        entry = store.read_json(f"{FLIGHTS}/{flight}/{ENTRY}")
        if entry is None:
            return
        yield flight, entry


def stored_flights(store: Store, folder: str, key: str, source: str, pages: str = "") -> tuple[FlightEntry, ...] | None:
    """Return the entries of all flights of a log; None unless the store has all of them, as they are wanted."""
    entries: list[FlightEntry] = []
    while not entries or len(entries) < entries[0].of:
        entry = store.read_as(f"{FLIGHTS}/{flight_folder(folder, len(entries) + 1)}/{ENTRY}", FlightEntry)
        if entry is None or entry.key != key or (pages and entry.pages != pages):
            return None
        entries.append(replace(entry, source=source))
    return tuple(entries)
