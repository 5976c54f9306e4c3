"""Flights and crafts of a folder as they stand in the store: nothing here waits for numerical packages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from pipeline.names import flight_folder
from pipeline.results.entry import FlightEntry, GroupEntry
from pipeline.results.fleet import GroupResult, LogFailure
from pipeline.storage.manifest import CRAFTS, FLIGHTS
from pipeline.storage.store import ENTRY, Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Crafts:
    """Crafts of several flights, and what has no part in them."""

    entries: tuple[GroupEntry, ...] = ()  #: Those with most flights first.
    #: Sources of flights that are in no joint model though they could be, with the reason.
    left_out: tuple[tuple[str, str], ...] = ()
    failures: tuple[LogFailure, ...] = ()  #: Crafts whose products could not be stored.
    unstored: tuple[GroupEntry, ...] = ()  #: Their entries.
    #: Those of this run by folder, as `pipeline.FleetResult` has them.
    fitted: Mapping[str, GroupResult] = field(default_factory=dict)


def is_current(store: Store, entry: GroupEntry) -> bool:
    """Return whether the store has the products of a craft, with the pages that are wanted."""
    facts = store.read_json(f"{CRAFTS}/{entry.folder}/{ENTRY}") or {}
    return facts.get("key") == entry.key and (not entry.pages or facts.get("pages") == entry.pages)


def stored_flights(store: Store, folder: str, key: str, source: str, pages: str = "") -> tuple[FlightEntry, ...] | None:
    """Return the entries of all flights of a log; None unless the store has all of them, as they are wanted."""
    entries: list[FlightEntry] = []
    while not entries or len(entries) < entries[0].of:
        entry = store.read_as(f"{FLIGHTS}/{flight_folder(folder, len(entries) + 1)}/{ENTRY}", FlightEntry)
        if entry is None or entry.key != key or (pages and entry.pages != pages):
            return None
        entries.append(replace(entry, source=source))
    return tuple(entries)
