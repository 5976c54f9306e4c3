"""A folder of logs to one result: every log for itself, then every craft jointly, judged on its other flights.

All products go to a store, and what a former run left there is not made again: a log is analysed when its content, its
name, the settings or the software are new, a craft is identified when its flights are. Packages that are slow to import
are imported when there is something to do.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path, PurePath
from time import perf_counter
from typing import TYPE_CHECKING

from core.lazy import lazy
from core.summary import listed
from pipeline.config import AnalysisConfig, ConfigError
from pipeline.execution.executors import Processes, WorkerDiedError, outcomes
from pipeline.execution.progress import Watch, part_of
from pipeline.execution.stages import Progress, silent
from pipeline.fleet.result import ANOTHER_RECORDING, FleetResult, IdentifiedCrafts, Run
from pipeline.results.craft import Publish
from pipeline.results.fleet import FlightEntry, LogFailure
from pipeline.software import software
from pipeline.storage.inventory import READERS, bring_back, index_sources, set_aside
from pipeline.storage.manifest import (
    FLIGHTS,
    FileRecord,
    Manifest,
    is_current,
    read_manifest,
    stored_flights,
)
from pipeline.storage.sources import FoundFiles, find
from pipeline.storage.store import Store, TemporaryStore, open_store

if TYPE_CHECKING:
    from pipeline.fleet import crafts as fleet_crafts
    from pipeline.fleet import job as fleet_job
    from pipeline.fleet.job import Job
else:
    # They bring the numerical packages, which an unchanged folder must not wait for.
    fleet_crafts, fleet_job = lazy("pipeline.fleet.crafts"), lazy("pipeline.fleet.job")

#: What became of a log: its flights; None for a file that is none.
Outcome = tuple[FlightEntry, ...] | LogFailure | None


def analyze_fleet(
    paths: Iterable[str | Path] | FoundFiles,
    config: AnalysisConfig | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
    *,
    store: Store | str | Path | None = None,
    publish: Publish | None = None,
    redo: bool = False,
    announce: Callable[[FlightEntry], None] | None = None,
) -> FleetResult:
    """Analyse logs one by one, then all flights of each craft together.

    Parameters
    ----------
    paths : iterable of str or Path, or Found
        Logs, folders to search for logs, and URLs of either; or what `pipeline.storage.sources.find` found there.
    config : AnalysisConfig, optional
    executor : concurrent.futures.Executor, optional
        Where the logs are analysed, each in one call; in this thread when not given.
    progress : callable, optional
        Called with what is at work, and the fraction of the whole that is done.
    store : Store, str or Path, optional
        Where products go, and what is there from former runs; a temporary one, which goes with the result, when not
        given.
    publish : callable, optional
        ``publish(result, folder)`` writes what people and programs read of a `FlightResult` or `GroupResult`.
    redo : bool
        Make everything anew.
    announce : callable, optional
        Called with each flight that is analysed as soon as its products are there.

    Raises
    ------
    ConfigError
        A pattern of `AnalysisConfig.training` or `validation` fits no log's name, or another run writes to the store.
    OSError
        Nothing can be written to the store.
    """
    config, progress = config or AnalysisConfig(), progress or silent
    store = TemporaryStore() if store is None else store if isinstance(store, Store) else open_store(store)
    run = Run(config=config, store=store, publish=publish, redo=redo)
    files = paths if isinstance(paths, FoundFiles) else find(paths, exclude=store.folder)
    check_choices(files, config)
    store.prepare()
    with store.locked():
        progress(f"looking into {len(files.sources)} files", 0.0)
        former = Manifest() if redo else read_manifest(store)
        if former.software not in (None, software()):
            progress("results here are of another version of rotorid or its libraries, and are made anew", 0.0)
        records = index_sources(files.sources, former, config, executor)
        known = {} if redo else _known(records, former, run)
        began = perf_counter()
        # Flights of one file are seldom so many that fitting them together takes long.
        analysing = part_of(progress, 0.0, own := 0.9 if len(files.sources) == 1 else 0.8)
        new = _analyzed(records, known, files, run, executor, analysing, announce)
        analyzed = perf_counter()
        records = _settled(records, {**known, **new})
        removed = tuple(_removed(former, records))
        gone, folders = {record.folder for record in former.removed}, {record.folder for record in records}
        set_aside(store, [record for record in removed if record.folder not in gone])
        bring_back(store, [record for record in former.removed if record.folder in folders])
        ordered = (known.get(record.url) or new.get(record.url) for record in records)
        flights = tuple(entry for outcome in ordered if isinstance(outcome, tuple) for entry in outcome)
        together = part_of(progress, own, 0.99)
        crafts = _crafts(flights, former, run, together, executor)
        manifest = Manifest(
            software=software(),
            configuration=config,
            pages=run.pages,
            logs=tuple(records),
            # Those that could not be stored are wanted still: the next run finds them missing.
            crafts=(*crafts.entries, *crafts.unstored),
            passed_over=tuple((failure.source, failure.reason) for failure in files.passed_over),
            left_out=crafts.left_out,
            removed=removed,
            reported=former.reported,
        )
        unwritten = _write(manifest, store)
    return FleetResult(
        flights=flights,
        groups=crafts.entries,
        fitted=crafts.fitted,
        failures=(*files.failures, *_in_state(records, "failed", "interrupted"), *crafts.failures, *unwritten),
        config=config,
        store=store,
        passed_over=(
            *files.passed_over,
            *_in_state(records, "no log"),
            *(LogFailure(source, reason) for source, reason in crafts.left_out),
        ),
        duplicates=_in_state(records, "duplicate"),
        removed=tuple(record.as_failure() for record in manifest.removed),
        again=tuple(flight.name for flight in flights if (flight.source, ANOTHER_RECORDING) in crafts.left_out),
        reused=len(known),
        manifest=manifest,
        timings={"logs": analyzed - began, "crafts": perf_counter() - analyzed},
    )


def check_choices(files: FoundFiles, config: AnalysisConfig) -> None:
    """Raise ConfigError for names of flights that no log has: before the work, not after it."""
    names = [PurePath(source.file).stem for source in files.sources]
    for option, patterns in (("--training", config.training), ("--validation", config.validation)):
        for pattern in patterns:
            fits = (fnmatch(name.casefold(), pattern.casefold()) for name in (*names, *(s.file for s in files.sources)))
            if not any(fits):
                there = listed(names, 20) or "none"
                raise ConfigError(f"no log is called {pattern!r}, as {option} has it; the logs are {there}")


def _known(records: Sequence[FileRecord], former: Manifest, run: Run) -> dict[str, Outcome]:
    """Return what is in the store already, by URL: entries of flights, and why other logs have none.

    A flight whose result is there but not the pages that are wanted is not among them.
    """
    last = {record.url: record for record in former.logs if record.state in ("failed", "no log") and record.key}
    known: dict[str, Outcome] = {}
    others = []
    for record in records:
        before = last.get(record.url)
        if before is not None and before.key == record.key:
            known[record.url] = before.as_failure() if before.state == "failed" else None
        elif record.key:
            others.append(record)

    def stored(record: FileRecord) -> tuple[FlightEntry, ...] | None:
        return stored_flights(run.store, record.folder, record.key, record.url, run.pages)

    with ThreadPoolExecutor(READERS) as readers:
        read = zip(others, readers.map(stored, others), strict=True)
        return known | {record.url: outcome for record, outcome in read if outcome is not None}


def _analyzed(
    records: Sequence[FileRecord],
    known: Mapping[str, Outcome],
    files: FoundFiles,
    run: Run,
    executor: Executor | None,
    progress: Progress,
    announce: Callable[[FlightEntry], None] | None,
) -> dict[str, Outcome]:
    """Analyse what is not known, side by side where there is an executor; by URL."""
    new = [record for record in records if record.key and record.url not in known]
    if not new:
        return {}
    sources = {source.url: source for source in files.sources}
    jobs = [fleet_job.Job(run, sources[record.url], record) for record in new]
    done: dict[str, Outcome] = {}
    full = ""

    def wanted() -> Iterator[Job]:
        """Yield jobs as long as their results can be stored."""
        for job in jobs:
            if full:
                return
            if job.source.named or job.source.called_a_log:
                watch.begin(job.source.url)
            yield job

    watch = Watch(progress, {job.source.url: job.source.size for job in jobs}, len(known), executor)
    for job, outcome in _done(wanted(), executor, watch):
        done[job.source.url] = outcome
        watch.end(job.source.url)
        if announce is not None and isinstance(outcome, tuple):
            for entry in outcome:
                announce(entry)
        if isinstance(outcome, LogFailure) and outcome.full:
            full = f"was not begun: of {job.source.file} {outcome.reason}"
    for job in jobs:
        done.setdefault(job.source.url, LogFailure(job.source.url, full))
    return done


def _done(jobs: Iterator[Job], executor: Executor | None, watch: Watch) -> Iterator[tuple[Job, Outcome]]:
    """Yield each job with its outcome as it ends."""
    if isinstance(executor, Processes):
        executor.submit(fleet_job.prepare).exception()
    here = (lambda job: fleet_job.run(job, watch.within(job.source.url))) if executor is None else fleet_job.run
    for job, outcome in outcomes(executor, here, jobs):
        yield job, LogFailure(job.source.url, str(outcome)) if isinstance(outcome, WorkerDiedError) else outcome


def _settled(records: Sequence[FileRecord], outcomes: Mapping[str, Outcome]) -> list[FileRecord]:
    """Note what became of every file."""
    settled = [_with(record, outcomes[record.url]) if record.url in outcomes else record for record in records]
    junk = {record.url: record for record in settled if record.state == "no log"}
    # A copy of what is no log is none either.
    return [
        replace(record, state="no log", reason=junk[record.original].reason) if record.original in junk else record
        for record in settled
    ]


def _with(record: FileRecord, outcome: Outcome) -> FileRecord:
    if isinstance(outcome, tuple):
        return replace(record, state="analysed")
    if outcome is None:
        return replace(record, state="no log", reason="no flight log", folder="")
    return replace(record, state="failed" if outcome.lasting else "interrupted", reason=outcome.reason, folder="")


def _crafts(
    flights: Sequence[FlightEntry], former: Manifest, run: Run, progress: Progress, executor: Executor | None
) -> IdentifiedCrafts:
    """Identify every craft of several flights jointly, unless that was done with these flights."""
    before = tuple(replace(craft, pages=run.pages) for craft in former.crafts)
    unchanged = (
        {record.key for record in former.logs if record.state == "analysed"} == {flight.key for flight in flights}
        and former.configuration == run.config
        and former.software == software()
    )
    if unchanged and not run.redo and all(is_current(run.store, craft) for craft in before):
        return IdentifiedCrafts(entries=before, left_out=former.left_out)
    return fleet_crafts.identify_crafts(flights, run, progress, executor)


def _in_state(records: Sequence[FileRecord], *states: str) -> tuple[LogFailure, ...]:
    return tuple(record.as_failure() for record in records if record.state in states)


def _removed(former: Manifest, records: Sequence[FileRecord]) -> Iterator[FileRecord]:
    """List logs of former runs that are not among the inputs any more but whose products are still there."""
    urls, folders = {record.url for record in records}, {record.folder for record in records}
    for record in (*former.logs, *former.removed):
        if record.state in ("analysed", "removed") and record.url not in urls and record.folder not in folders:
            yield replace(record, state="removed", reason=f"its products are kept in {FLIGHTS}/{record.folder}")


def _write(manifest: Manifest, store: Store) -> tuple[LogFailure, ...]:
    """Write the manifest; where that fails all else stands nevertheless."""
    try:
        manifest.write(store)
    except OSError as error:
        return (LogFailure(store.url, f"the manifest could not be written: {error.strerror or error}"),)
    return ()
