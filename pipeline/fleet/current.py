"""Crafts of a folder as they stand in the store: nothing here waits for numerical packages."""

from __future__ import annotations

from dataclasses import dataclass

from pipeline.results.entry import GroupEntry
from pipeline.results.fleet import Failure
from pipeline.storage.manifest import CRAFTS
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
