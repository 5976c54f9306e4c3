"""Flights and crafts of a folder as they stand in the store: nothing here waits for numerical packages."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.names import flight_folder
from pipeline.results.entry import FlightEntry, GroupEntry
from pipeline.results.fleet import Failure
from pipeline.storage.manifest import CRAFTS, FLIGHTS
from pipeline.storage.store import ENTRY, Store


@dataclass(frozen=True, slots=True, kw_only=True)
class Crafts:
    """Crafts of several flights, and what has no part in them.

    Attributes
    ----------
    entries : tuple of GroupEntry
        Those with most flights first.
    left_out : tuple of (str, str)
        Sources of flights that are in no joint model though they could be, with the reason.
    failures : tuple of Failure
        Crafts whose products could not be stored.
    unstored : tuple of GroupEntry
        Their entries.
    """

    entries: tuple[GroupEntry, ...] = ()
    left_out: tuple[tuple[str, str], ...] = ()
    failures: tuple[Failure, ...] = ()
    unstored: tuple[GroupEntry, ...] = ()


def is_current(store: Store, entry: GroupEntry) -> bool:
    """Return whether the store has the products of a craft, with the pages that are wanted."""
    facts = store.read_json(f"{CRAFTS}/{entry.folder}/{ENTRY}") or {}
    return facts.get("key") == entry.key and (not entry.pages or facts.get("pages") == entry.pages)


def stored_flights(store: Store, folder: str, key: str, source: str, pages: str = "") -> tuple[FlightEntry, ...] | None:
    """Return the entries of all flights of a log; None unless the store has all of them, as they are wanted.

    Parameters
    ----------
    store : Store
    folder, key : str
        Of the log, see `pipeline.storage.manifest.LogRecord`.
    source : str
        Where the log is now.
    pages : str
        What writes the pages, where there must be some.
    """
    entries: list[FlightEntry] = []
    while not entries or len(entries) < entries[0].of:
        facts = store.read_json(f"{FLIGHTS}/{flight_folder(folder, len(entries) + 1)}/{ENTRY}")
        if facts is None or facts.get("key") != key or (pages and facts.get("pages") != pages):
            return None
        entries.append(FlightEntry.from_dict({**facts, "source": source}))
    return tuple(entries)
