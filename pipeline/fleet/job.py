"""One log from its URL to products in the store: the call that processes and clusters do side by side."""

from __future__ import annotations

import errno
import logging
import os
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from core.lazy import lazy
from logparse import LogError, RotoridError
from pipeline.execution.stages import Progress
from pipeline.fleet.result import Run
from pipeline.flight.analysis import analyze_flights
from pipeline.flight.summary import flight_entry
from pipeline.names import flight_folder
from pipeline.results.fleet import FlightEntry, LogFailure
from pipeline.results.flight import FlightResult
from pipeline.storage.dataset import EXPERIMENTS, TABLES, part, partitions, write_experiments, write_tables
from pipeline.storage.manifest import (
    FLIGHTS,
    FileRecord,
    drawn_anew,
    entries_of,
    of_one_flight,
    stored_flights,
    write_entry,
)
from pipeline.storage.sources import Source, fetched
from pipeline.storage.store import ENTRY, Store

if TYPE_CHECKING:
    from pipeline.execution import compiling
else:
    compiling = lazy("pipeline.execution.compiling")  # it brings the compiler

_LOG = logging.getLogger("rotorid.pipeline")

#: Errors after which nothing more can be stored.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS)


@dataclass(frozen=True, slots=True)
class Job:
    """A log to analyse, with the names of its products."""

    run: Run
    source: Source
    record: FileRecord


def prepare() -> None:
    """Compile what this computer has not compiled yet: else each process that runs a job would, for itself."""
    compiling.compile_missing()


def run(job: Job, progress: Progress | None = None) -> tuple[FlightEntry, ...] | LogFailure | None:
    """Analyse every flight of a log and store the products; whatever goes wrong stays with this log.

    None for a file that was merely found in a folder and neither looks nor is called like a log.
    """
    source, asked, record = job.source, job.run, job.record
    try:
        shown = None if asked.redo else _shown_anew(job)
        if shown is not None:
            return shown
        with fetched(source.url) as file:
            entries = []
            for result in analyze_flights(file, of_one_flight(asked.config), progress, name=record.name):
                try:
                    entries.append(_keep(result, job))
                except OSError as error:
                    # Libraries word it in their own ways.
                    why = os.strerror(error.errno) if error.errno in FULL else error.strerror or error
                    return LogFailure(source.url, f"its results could not be stored: {why}", full=error.errno in FULL)
        _remove_former(asked.store, record.folder, len(entries))
        return tuple(entries)
    except LogError as error:
        return LogFailure(source.url, str(error), lasting=True) if source.named or source.called_a_log else None
    except RotoridError as error:
        return LogFailure(source.url, str(error), lasting=True)
    except OSError as error:
        return LogFailure(source.url, f"cannot be read: {error.strerror or error}")
    except MemoryError:
        return LogFailure(source.url, "needs more memory than there is")
    except Exception as error:
        _LOG.exception("unexpected error analysing %s", source.url)
        reason = f"unexpected {type(error).__name__}: {error} (a bug in rotorid; please report it)"
        return LogFailure(source.url, reason, lasting=True)


def _keep(result: FlightResult, job: Job) -> FlightEntry:
    """Store all products of a flight, its entry last.

    The entry of an earlier run is made void first: parts of the datasets are replaced one by one, and what is mixed of
    two runs must not pass for the products of either.
    """
    store, publish, record = job.run.store, job.run.publish, job.record
    # The report calls the log as its user does, not as it was fetched.
    result = replace(result, log=replace(result.log, file=job.source.file))
    folder = flight_folder(record.folder, result.log.flight_number)
    entry = flight_entry(result, folder=folder, source=record.url, key=record.key, pages=job.run.pages)
    place = f"{FLIGHTS}/{folder}"
    with store.scratch() as scratch:
        product = scratch / "product"
        product.mkdir()
        if publish is not None:
            publish(result, product)
        write_entry(entry, product)
        tables = write_tables(result, scratch / TABLES)
        experiments = write_experiments(result, scratch / EXPERIMENTS)

        former = store.read_json(f"{place}/{ENTRY}")
        if former is not None:
            store.write_json(f"{place}/{ENTRY}", {**former, "key": ""})
            _remove_parts(store, former["vehicle"], folder)
        store.write_json(f"{place}/{ENTRY}", replace(entry, key=""))
        for dataset, files in ((TABLES, tables), (EXPERIMENTS, experiments)):
            for name, file in files.items():
                store.put(file, part(dataset, name, entry.vehicle, folder))
        store.commit(product, place)
    return entry


def _shown_anew(job: Job) -> tuple[FlightEntry, ...] | None:
    """Draw the pages of flights anew whose results the store has; None where they must be analysed."""
    store, publish, record = job.run.store, job.run.publish, job.record
    entries = stored_flights(store, record.folder, record.key, record.url)
    if entries is None or publish is None:
        return None
    shown = tuple(replace(entry, pages=job.run.pages) for entry in entries)
    drawn = all(drawn_anew(store, f"{FLIGHTS}/{entry.folder}", entry, publish) for entry in shown)
    return shown if drawn else None


def _remove_former(store: Store, folder: str, count: int) -> None:
    """Remove flights that a log had when it was analysed by earlier software, and has no more."""
    for flight, former in entries_of(store, folder, count + 1):
        _remove_parts(store, former["vehicle"], flight)
        store.remove(f"{FLIGHTS}/{flight}")


def _remove_parts(store: Store, vehicle: str, flight: str) -> None:
    for place in partitions(store, vehicle, flight):
        store.remove(place)
