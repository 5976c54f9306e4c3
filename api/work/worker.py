"""What happens in the process of one analysis, apart from the server so that a crash takes nothing else down."""

import errno
import logging
import os
import resource
import signal
import tempfile
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby, islice
from multiprocessing.connection import Connection
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import logparse
import pipeline
import reports
from api import log_lines
from api.problems import Problem
from api.settings import LogFormat
from api.work import confinement
from api.work.outcome import Reached, write_flights
from core.lazy import lazy
from core.quantity import size
from core.serialization import restored
from logparse import LogError, RotoridError
from logparse.containers import limit_unpacked
from pipeline.execution.stages import Overall
from pipeline.fleet.result import FleetResult, Run
from pipeline.flight.craft import took_off
from pipeline.results.craft import GroupResult
from pipeline.results.failure import present
from pipeline.results.fleet import FlightEntry
from pipeline.storage.manifest import FLIGHTS, MANIFEST
from pipeline.storage.store import ENTRY, LOCK

if TYPE_CHECKING:
    import sysid
    from logparse import FlightLog
    from pipeline.fleet import crafts as fleet_crafts
    from pipeline.flight import kinds
    from pipeline.flight import summary as flight_summary
    from pipeline.results.flight import FlightResult
    from pipeline.storage import dataset
    from pipeline.storage import store as store_of
    from reports.files import folder as reports_folder
    from sysid import loops as sysid_loops
    from sysid.loops import Tuning
else:
    sysid, store_of = lazy("sysid"), lazy("pipeline.storage.store")
    dataset, reports_folder = lazy("pipeline.storage.dataset"), lazy("reports.files.folder")
    fleet_crafts, flight_summary = lazy("pipeline.fleet.crafts"), lazy("pipeline.flight.summary")
    kinds = lazy("pipeline.flight.kinds")
    sysid_loops = lazy("sysid.loops")

_log = logging.getLogger("rotorid.api")

#: Folder of the only flight of an analysis below the parts of its experiments.
_FLIGHT = "flight"

#: Flights with chirps that gains of a craft are proposed from, the newest first: each is held in memory.
_MOST = 4

#: Settings of joint fits that are the service's own.
_OURS = ("flights",)


class TaskProgress(Protocol):
    """Hears how far an analysis is and, once it is known, what happened in the flight."""

    def __call__(self, stage: str, fraction: float, happened: str = "") -> None:
        """Report it."""


@dataclass(frozen=True, slots=True)
class Member:
    """A flight of a craft, analysed before."""

    name: str
    entry: Mapping[str, Any]  #: `pipeline.results.fleet.FlightEntry`.
    experiments: Mapping[str, Path]  #: File of each kind.


@dataclass(frozen=True, slots=True)
class Task:
    """What to analyse."""

    logs: Sequence[tuple[Path, str]]  #: Every log's file, and what its user calls it.
    configuration: Mapping[str, Any]  #: Fields of `pipeline.AnalysisConfig` that differ from their defaults.
    folder: Path  #: Where the results go.
    members: Sequence[Member] = ()  #: Flights of a craft to fit jointly; then there are no logs.
    reference: str = ""  #: Id of the analysis, under which a bug is logged.


#: Does a task and reports progress.
Analyze: TypeAlias = Callable[[Task, TaskProgress], None]


@dataclass(frozen=True, slots=True)
class Ended:
    """The results are written, or there is a problem; of a bug with what Python said of it."""

    problem: Problem | None = None
    traceback: str = ""


def too_large(memory: int) -> Problem:
    """Report that an analysis needed more memory than it may have."""
    detail = (
        f"The analysis needed more than the {size(memory)} that this service allows. Analyse a shorter log, or run "
        "`rotorid analyze` yourself, which has no limit."
    )
    return Problem.of("analysis-too-large", detail)


def crashed(reference: str) -> Problem:
    """Report that an analysis met a bug of ours."""
    detail = (
        "rotorid met something in this log that it does not handle. That is a mistake of rotorid, not yours; please "
        f"report it with the log and the reference {reference}, under which the service's log has the details."
    )
    return Problem.of("analysis-crashed", detail)


def unkept(error: OSError) -> Problem:
    """Report that there was no place for the results."""
    detail = (
        f"The service could not write the results: {error.strerror or error}. Its operator has to make room; then try "
        "again."
    )
    return Problem.of("results-not-kept", detail)


def analyze_logs(task: Task, progress: TaskProgress) -> None:
    """Run the pipeline on the logs of a task, or on the flights of a craft, and write the report and tables."""
    if task.members:
        _join(task, progress)
        return
    # Packages that are imported when they are used: the server itself never needs the 200 MB of numpy, numba, pandas.
    if len(task.logs) == 1 and len(flights := logparse.read_flights(task.logs[0][0])) == 1:
        _analyze_one(task, flights[0], progress)
    else:
        _analyze_several(task, progress)


def _analyze_one(task: Task, log: "FlightLog", progress: TaskProgress) -> None:
    ((_, name),) = task.logs
    advance = Overall(progress)
    config = pipeline.AnalysisConfig(**task.configuration)
    announce = partial(_tell_account, progress)
    (result,) = pipeline.analyze_flights([log], config, advance, name=Path(name).stem, announce=announce)
    advance("report", 0.0)
    # The report names the file as its user does, not as it is kept here.
    reports.write(replace(result, log=replace(result.log, file=Path(name).name)), task.folder)
    try:
        dataset.write_tables(result, task.folder / "tables")
        _hand_over(result, name, task.folder)
        _propose(log, task.folder)
    except Exception:  # must not cost the report
        _log.exception("the tables of %s cannot be written", name)


def _tell_account(progress: TaskProgress, result: "FlightResult") -> None:
    """Report what happened, before anything is identified."""
    answer = present(result.answer)
    if answer is not None:
        progress("what happened", 0.0, answer.lines[0].text)


def _hand_over(result: "FlightResult", name: str, folder: Path) -> None:
    """Write what the craft of a flight keeps of it: its entry, and the experiments that joint models are fitted to."""
    entry = flight_summary.flight_entry(result, folder=_FLIGHT, source=name, key=result.log.sha256)
    for kind, file in dataset.write_experiments(result, folder / "experiments").items():
        place = folder / dataset.part(dataset.EXPERIMENTS, kind, entry.vehicle, entry.folder)
        place.parent.mkdir(parents=True)
        file.rename(place)
    write_flights([entry], folder)


def _publish(result: "FlightResult | GroupResult | None", folder: Path) -> None:
    """Write pages that carry their scripts: in the sandbox that reports are shown in, none may be fetched."""
    assert result is not None  # every folder is new
    reports.write(result, folder)


def _analyze_several(task: Task, progress: TaskProgress) -> None:
    config = pipeline.AnalysisConfig(**task.configuration)
    logs = [log for log, _ in task.logs]
    fleet = pipeline.analyze_fleet(logs, config, None, progress, store=task.folder, publish=_publish)
    progress("report", 0.99)
    reports.write_fleet(fleet)
    (task.folder / reports.SHARED_SCRIPT).unlink(missing_ok=True)
    write_flights((replace(entry, source=PurePath(entry.source).name) for entry in fleet.flights), task.folder)
    try:
        _propose_of_crafts(fleet.flights, task.folder)
    except Exception:  # must not cost the report
        _log.exception("what gains to propose cannot be found out")
    # What serves a second run names the places of the logs on this server, and there is none.
    for file in (*task.folder.rglob(ENTRY), task.folder / MANIFEST, task.folder / LOCK):
        file.unlink(missing_ok=True)


def _propose(log: "FlightLog", folder: Path) -> None:
    """Write what one log supports."""
    try:
        _write_gains(sysid_loops.tune(log), folder)
    except RotoridError as error:
        _log.debug("no gains are proposed: %s", error)


def _propose_of_crafts(flights: Sequence[FlightEntry], folder: Path) -> None:
    """Write what the flights of each craft support beside the newest of those that it was computed from.

    It comes from all flights with chirps together; where they contradict each other, as by other settings, from the
    newest that supports some alone.
    """
    for _, own in groupby(sorted(flights, key=lambda entry: entry.craft), key=lambda entry: entry.craft):
        known = list(islice(_with_chirps(sorted(own, key=_started, reverse=True)), _MOST))
        tunings = [(entry, alone) for entry, _, alone in known]
        if len(known) > 1:
            tunings.insert(0, (known[0][0], sysid_loops.tune([log for _, log, _ in known])))
        for entry, tuning in tunings:
            if tuning.refused is None:
                _write_gains(tuning, folder / FLIGHTS / entry.folder)
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


def _write_gains(tuning: "Tuning", folder: Path) -> None:
    (folder / "proposed.param").write_text(tuning.proposed_file(), encoding="utf-8")
    (folder / "rollback.param").write_text(tuning.rollback_file(), encoding="utf-8")


def _join(task: Task, progress: TaskProgress) -> None:
    """Fit the flights of one craft jointly, from their experiments."""
    config = pipeline.AnalysisConfig(**{name: v for name, v in task.configuration.items() if name not in _OURS})
    joint = task.folder.parent / "joint"
    scratch = store_of.Store(joint)
    flights = []
    for number, member in enumerate(task.members, start=1):
        folder = f"flight{number}"
        entry = replace(
            restored(member.entry, FlightEntry), name=member.name, folder=folder, craft="c", vehicle="craft"
        )
        flights.append(replace(entry, key=f"{entry.sha256}#{entry.number}"))
        for kind, file in member.experiments.items():
            record = replace(dataset.read_experiment(file.read_bytes()), name=member.name)
            place = joint / dataset.part(dataset.EXPERIMENTS, kind, "craft", folder)
            place.parent.mkdir(parents=True)
            dataset.write_experiment(record, place)
    asked = Run(config=config, store=scratch, publish=_publish, redo=True)
    crafts = fleet_crafts.identify_crafts(flights, asked, progress)
    if not crafts.entries:
        raise LogError(
            "; ".join(failure.reason for failure in crafts.failures) or "no flights that can be fitted jointly"
        )
    progress("report", 0.99)
    craft = crafts.entries[0].folder
    reports.write_fleet(FleetResult(flights=(), groups=crafts.entries[:1], failures=(), config=config, store=scratch))
    for file in [path for path in joint.iterdir() if path.is_file() and not path.name.startswith(".")]:
        file.rename(task.folder / file.name)
    body = next((model.model for model in crafts.fitted[craft].models if model.key == kinds.RIGID_BODY_KEY), None)
    if isinstance(body, sysid.RigidBodyModel):
        sysid.write_craft(body, task.folder)


@dataclass(frozen=True, slots=True)
class TaskLimits:
    """What one analysis may take."""

    time: float  #: s.
    memory: int  #: Bytes.
    unpacked: int  #: Bytes to which a packed log may unpack.
    closed: tuple[Path, ...] = ()  #: Where the server keeps what is no analysis' business.


def run(reports_to: Connection, analyze: Analyze, task: Task, limits: TaskLimits, log_format: LogFormat) -> None:
    """Do a task within its limits and report how it goes, at the end with `Ended`."""
    log_lines.configure(log_format)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which ends its workers itself.
    confinement.die_with_parent()  # should the server be killed, nobody else would end us before the alarm
    os.nice(5)  # Requests come first.
    signal.setitimer(signal.ITIMER_REAL, limits.time + 10.0)
    # Not RLIMIT_AS: mapped files and numba's reservations are address space but not memory.
    resource.setrlimit(resource.RLIMIT_DATA, (limits.memory, limits.memory))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))

    last = Reached(progress=-1.0)

    def progress(stage: str, fraction: float, happened: str = "") -> None:
        nonlocal last
        if stage != last.stage or fraction >= last.progress + 0.01 or happened:
            last = Reached(stage, min(max(fraction, last.progress, 0.0), 1.0), happened[:300] or last.happened)
            _tell(reports_to, last)

    limit_unpacked(limits.unpacked)
    # What a packed log holds goes where uploads have room, and is gone with the analysis even when killed.
    tempfile.tempdir = str(task.folder.parent)
    given = [log for log, _ in task.logs] + [file for member in task.members for file in member.experiments.values()]
    confinement.confine(limits.closed, task.folder.parent, given)
    ended = Ended()
    try:
        analyze(task, progress)
    except RotoridError as error:
        ended = Ended(Problem.of("unusable-log", _in_users_words(str(error), task)))
    except MemoryError:
        ended = Ended(too_large(limits.memory))
    except Exception as error:
        if isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            ended = Ended(unkept(error))
        else:
            ended = Ended(crashed(task.reference), traceback.format_exc())
    _tell(reports_to, ended)


def _tell(watcher: Connection, report: Reached | Ended) -> None:
    """Send the watcher a report; when it is dead, somebody else does this analysis, and we are in the way."""
    try:
        watcher.send(report)
    except BrokenPipeError:
        os._exit(1)


def _in_users_words(reason: str, task: Task) -> str:
    """Call files as their user does: errors begin with the name under which the file is kept here."""
    for log, name in task.logs:
        if reason.startswith(log.name):
            return name + reason.removeprefix(log.name)
    return reason
