"""Proposed gains beside the results of an analysis, with the way back, where its logs support some."""

import logging
from collections.abc import Iterator, Sequence
from itertools import groupby, islice
from pathlib import Path
from typing import TYPE_CHECKING

import logparse
from core.lazy import lazy
from logparse import RotoridError
from pipeline.flight.craft import took_off
from pipeline.results.entry import FlightEntry
from pipeline.storage.manifest import FLIGHTS

if TYPE_CHECKING:
    import sysid.loops as sysid_loops
    from logparse import FlightLog
    from sysid.loops import Tuning
else:
    sysid_loops = lazy("sysid.loops")

_log = logging.getLogger("rotorid.api")

#: Flights with chirps that gains of a craft are proposed from, the newest first: each is held in memory.
_MOST = 4


def propose(log: "FlightLog", folder: Path) -> None:
    """Write what one log supports."""
    try:
        _write(sysid_loops.tune(log), folder)
    except RotoridError as error:
        _log.debug("no gains are proposed: %s", error)


def propose_of_crafts(flights: Sequence[FlightEntry], folder: Path) -> None:
    """Write what the flights of each craft support beside the newest of those that it was computed from.

    It comes from all flights with chirps together; where they contradict each other, as by other settings, from the
    newest that supports some alone.
    """
    for _, own in groupby(sorted(flights, key=lambda entry: entry.craft), key=lambda entry: entry.craft):
        known = list(islice(_with_chirps(sorted(own, key=_started, reverse=True)), _MOST))
        found = [(entry, alone) for entry, _, alone in known]
        if len(known) > 1:
            found.insert(0, (known[0][0], sysid_loops.tune([log for _, log, _ in known])))
        for entry, tuning in found:
            if tuning.refused is None:
                _write(tuning, folder / FLIGHTS / entry.folder)
                break


def _started(flight: FlightEntry) -> float:
    """Return when a flight began, s since 1970; of a clock that was not set long ago."""
    start = took_off(flight)
    return float("-inf") if start is None else start.timestamp()


def _with_chirps(flights: Sequence[FlightEntry]) -> "Iterator[tuple[FlightEntry, FlightLog, Tuning]]":
    """Yield the flights in which a loop was identified, with what each supports alone."""
    for entry in flights:
        try:
            log = logparse.read_flights(entry.source)[entry.number - 1]
            alone = sysid_loops.tune(log)
        except RotoridError as error:
            _log.debug("no gains from %s: %s", entry.name, error)
            continue
        if any(axis.loop is not None for axis in alone.axes):
            yield entry, log, alone


def _write(tuning: "Tuning", folder: Path) -> None:
    (folder / "proposed.param").write_text(tuning.proposed_file(), encoding="utf-8")
    (folder / "rollback.param").write_text(tuning.rollback_file(), encoding="utf-8")
