"""A folder of logs to one result: every log for itself, then every craft jointly, judged on its other flights."""

import logging
import os
from collections.abc import Iterable, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from fnmatch import fnmatch
from pathlib import Path

import sysid
from logparse import LogError, RotoridError
from pipeline.comparison import compare_parameters
from pipeline.config import AnalysisConfig
from pipeline.coverage import summarise
from pipeline.craft import by_craft, craft_name
from pipeline.entry import flight_entry
from pipeline.errors import ConfigError
from pipeline.flight import analyze
from pipeline.identification import identify
from pipeline.kinds import KINDS, RIGID_BODY_KEY, THRUST_KEY, Kind
from pipeline.names import printable
from pipeline.results import Failure, FleetResult, FlightResult, GroupResult, ModelResult
from pipeline.stages import Progress, Stages, overall, silent

_LOG = logging.getLogger("rotorid.pipeline")

#: Endings that promise a flight log: a file found in a folder is reported as failed only if it has one of them.
LOG_SUFFIXES = frozenset({".bin", ".log", ".tlog", ".ulg", ".raw"})

#: Endings of packed files, which may stand behind those.
PACKED_SUFFIXES = frozenset({".gz", ".zip"})

#: Names of logs that one message lists.
MOST_NAMED = 20


def analyze_fleet(
    paths: Iterable[str | Path],
    config: AnalysisConfig | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> FleetResult:
    """Analyse logs one by one, then all flights of each craft together.

    Parameters
    ----------
    paths : iterable of str or Path
        Logs, and folders to search for logs.
    config : AnalysisConfig, optional
    executor : concurrent.futures.Executor, optional
        Where the logs are analysed, each in one call; in this thread when not given.
    progress : callable, optional
        Called with "log: stage" and the fraction of the whole that is done.

    Raises
    ------
    ConfigError
        A pattern of `AnalysisConfig.training` fits no log's name.
    """
    config = config or AnalysisConfig()
    progress = progress or silent
    passed_over: list[Failure] = []
    files = find_logs(paths, passed_over)
    names = flight_names([file for file, _ in files])
    check_training(names.values(), config)
    # The joint fits come last and take about as long as a few logs.
    share = 1.0 / (len(files) + max(1, len(files) // 4))

    outcomes: dict[Path, FlightResult | Failure | None] = {}
    if executor is None:
        for number, (file, named) in enumerate(files):

            def report(stage: str, fraction: float, number: int = number, file: Path = file) -> None:
                progress(f"{printable(file.name)}: {stage}", share * (number + fraction))

            outcomes[file] = analyze_one(file, config, names[file], named, overall(report))
    else:
        jobs: dict[Future[FlightResult | Failure | None], Path] = {
            executor.submit(analyze_one, file, config, names[file], named): file for file, named in files
        }
        progress(f"{len(jobs)} files", 0.0)
        for number, job in enumerate(as_completed(jobs), start=1):
            file = jobs[job]
            try:
                outcomes[file] = job.result()
            except Exception as error:  # the worker died, or its result could not come back
                _LOG.exception("analysing %s failed", file)
                outcomes[file] = Failure(file, f"the worker process failed: {type(error).__name__}: {error}")
            if outcomes[file] is not None:
                progress(f"{printable(file.name)}: done ({number} of {len(jobs)} files)", share * number)

    ordered = [outcomes[file] for file, _ in files]
    flights = tuple(outcome for outcome in ordered if isinstance(outcome, FlightResult))
    failures = tuple(outcome for outcome in ordered if isinstance(outcome, Failure))
    groups = []
    passed_over += [Failure(file, "no flight log") for file, _ in files if outcomes[file] is None]
    by_name = {flight.name: flight for flight in flights}
    entries = [
        flight_entry(
            flight, folder=flight.name, source=str(flight.log.path), key=flight.log.sha256, coverage=summarise(flight)
        )
        for flight in flights
    ]
    kept = [tuple(by_name[entry.name] for entry in craft) for craft in by_craft(entries)]
    passed_over += [
        Failure(flight.log.path, "another recording of a flight that is here too, left out of the joint fit")
        for flight in flights
        if flight.experiment is not None and flight.position_known and not any(flight in craft for craft in kept)
    ]
    crafts = sorted((craft for craft in kept if len(craft) > 1), key=len, reverse=True)
    start, whole = share * len(files), 0.99 - share * len(files)
    for number, craft in enumerate(crafts):
        name = craft_name(craft[0].log.vehicle)

        def report_group(stage: str, fraction: float, number: int = number, name: str = name) -> None:
            progress(f"{name}, jointly: {stage}", start + whole * (number + fraction) / len(crafts))

        groups.append(analyze_group(craft, config, overall(report_group), executor))
    return FleetResult(
        flights=flights,
        failures=failures,
        groups=tuple(groups),
        config=config,
        passed_over=tuple(passed_over),
    )


def find_logs(paths: Iterable[str | Path], passed_over: list[Failure] | None = None) -> list[tuple[Path, bool]]:
    """List the files to analyse: (file, named by the user), each file once, folders searched in order of name.

    Folders that cannot be opened, and given ones that hold no file, are added to `passed_over`.
    """
    found: dict[Path, bool] = {}
    unused: list[Failure] = []

    def closed(error: OSError) -> None:
        unused.append(Failure(Path(error.filename), f"cannot be opened: {error.strerror}"))

    for path in map(Path, paths):
        if path.is_dir():
            before = len(found), len(unused)
            for folder, folders, files in os.walk(path, onerror=closed):
                folders[:] = sorted(name for name in folders if not name.startswith("."))
                for name in sorted(files):
                    file = Path(folder) / name
                    if not name.startswith(".") and file.is_file() and file not in found:
                        found[file] = False
            if before == (len(found), len(unused)):
                unused.append(Failure(path, "holds no further files"))
        else:
            found[path] = True
    if passed_over is not None:
        passed_over += unused
    return list(found.items())


def flight_names(files: Sequence[Path]) -> dict[Path, str]:
    """Name each flight after its file; where that is not unique, with the ending and a number."""
    names: dict[Path, str] = {}
    taken: set[str] = set()
    stems = [file.stem.casefold() for file in files if file.suffix.lower() in LOG_SUFFIXES]
    for file in files:
        base = printable(file.stem if stems.count(file.stem.casefold()) <= 1 else file.name)
        name, number = base, 1
        while name.casefold() in taken:
            number += 1
            name = f"{base} ({number})"
        taken.add(name.casefold())
        names[file] = name
    return names


def analyze_one(
    file: Path, config: AnalysisConfig, name: str, named: bool, progress: Progress | None = None
) -> FlightResult | Failure | None:
    """Analyse one log of several; whatever goes wrong stays with this log.

    Returns
    -------
    FlightResult, Failure or None
        None for a file that was merely found in a folder and neither looks nor is called like a log.
    """
    try:
        return analyze(file, config, progress, name=name)
    except LogError as error:
        return Failure(file, str(error)) if named or _called_a_log(file) else None
    except RotoridError as error:
        return Failure(file, str(error))
    except OSError as error:
        return Failure(file, f"cannot be read: {error.strerror or error}")
    except Exception as error:
        _LOG.exception("unexpected error analysing %s", file)
        return Failure(file, f"unexpected {type(error).__name__}: {error} (a bug in rotorid; please report it)")


def _called_a_log(file: Path) -> bool:
    """Tell whether the ending promises a log, packed (``flight.bin.gz``) or not."""
    name = Path(file.stem) if file.suffix.lower() in PACKED_SUFFIXES else file
    return name.suffix.lower() in LOG_SUFFIXES


def analyze_group(
    flights: Sequence[FlightResult],
    config: AnalysisConfig,
    progress: Progress | None = None,
    executor: Executor | None = None,
) -> GroupResult:
    """Identify one craft from some of its flights jointly and judge the model on the others.

    Parameters
    ----------
    flights : sequence of FlightResult
        Of one craft, each with an experiment.
    config : AnalysisConfig
    progress : callable, optional
    executor : concurrent.futures.Executor, optional
        Where each kind of model is fitted, in one call; in this thread when not given.
    """
    training, held_out, split = choose_training(flights, config)
    stages = Stages(progress or silent, config.time_limit * len(flights))
    models = _identify_all(training, held_out, config, stages, executor)
    ordered = [models[kind.key] for kind in KINDS]
    flown = _cut(training, THRUST_KEY)
    thrust = _thrust(flown, config, stages) if flown else None
    if thrust is None:
        stages.missing.setdefault("thrust", models[THRUST_KEY].missing)
    findings = thrust.findings if thrust is not None else ()
    parameters = compare_parameters(_cut(training, RIGID_BODY_KEY), ordered, config, stages)
    return GroupResult(
        name=craft_name(flights[0].log.vehicle),
        vehicle=flights[0].log.vehicle,
        training=tuple(flight.name for flight in training),
        held_out=tuple(flight.name for flight in held_out),
        split=split,
        models=tuple(ordered),
        thrust=thrust,
        parameters=parameters,
        findings=(*findings, *stages.findings),
        missing=stages.missing,
        timings=stages.timings,
    )


def _identify_all(
    training: Sequence[FlightResult],
    held_out: Sequence[FlightResult],
    config: AnalysisConfig,
    stages: Stages,
    executor: Executor | None,
) -> dict[str, ModelResult]:
    """Identify every kind of model, side by side where there is an executor; by the kind's key."""
    models: dict[str, ModelResult] = {}
    jobs: dict[Future[tuple[ModelResult, Stages]], Kind] = {}
    for kind in KINDS:
        records, judges = _cut(training, kind.key), _cut(held_out, kind.key)
        if not records:
            models[kind.key] = _without(kind, _no_records(kind, training))
            continue
        if executor is not None:
            try:
                jobs[executor.submit(_identify_alone, kind, records, judges, config, stages.time_limit)] = kind
            except BrokenExecutor:  # a log has killed a worker: the joint fit need not go with it
                executor = None
        if executor is None:
            models[kind.key] = identify(kind, records, judges, config, stages)
    for job in as_completed(jobs):
        kind = jobs[job]
        try:
            models[kind.key], own = job.result()
        except Exception as error:  # the worker died, or its result could not come back
            _LOG.exception("fitting %s jointly failed", kind.key)
            models[kind.key] = _without(kind, f"the worker process failed: {type(error).__name__}: {error}")
        else:
            stages.take(own)
        stages.progress(kind.key, 1.0)
    return models


def _without(kind: Kind, reason: str) -> ModelResult:
    return ModelResult(key=kind.key, title=kind.title, note=kind.note, missing=reason)


def _cut(flights: Sequence[FlightResult], key: str) -> list[sysid.Experiment]:
    """Gather the records of flights as a kind of model needs them, of those flights that have one."""
    return [flight.experiments[key] for flight in flights if key in flight.experiments]


def _identify_alone(
    kind: Kind,
    records: Sequence[sysid.Experiment],
    judges: Sequence[sysid.Experiment],
    config: AnalysisConfig,
    time_limit: float,
) -> tuple[ModelResult, Stages]:
    """Identify in a process of its own; progress is not heard there."""
    stages = Stages(silent, time_limit)
    return identify(kind, records, judges, config, stages), stages


def _thrust(records: Sequence[sysid.Experiment], config: AnalysisConfig, stages: Stages) -> sysid.ThrustModel | None:
    return stages.run("thrust", lambda _: sysid.fit_thrust(records, mass=config.mass))


def _no_records(kind: Kind, training: Sequence[FlightResult]) -> str:
    """Say why there is nothing to fit a kind of model to."""
    if not training:
        return "none of its flights was chosen for training"
    alone = (result.missing for flight in training for result in flight.models if result.key == kind.key)
    return next((reason for reason in alone if reason), "no training flight has its inputs")


def choose_training(
    flights: Sequence[FlightResult], config: AnalysisConfig
) -> tuple[list[FlightResult], list[FlightResult], str]:
    """Divide a craft's flights into those to fit and those to judge, and say how it was done."""
    if config.training:
        training = [flight for flight in flights if _chosen(flight.name, config.training)]
        split = "training flights were named by the user; all others judge"
    else:
        training = list(flights[::2])
        split = "every second flight in order of name trains, the others judge"
    return training, [flight for flight in flights if flight not in training], split


def check_training(names: Iterable[str], config: AnalysisConfig) -> None:
    """Refuse names of training flights that no log has: before the work, not after it.

    Raises
    ------
    ConfigError
    """
    names = list(names)
    for pattern in config.training:
        if not any(_chosen(name, [pattern]) for name in names):
            some = ", ".join(names[:MOST_NAMED]) + (", …" if len(names) > MOST_NAMED else "")
            raise ConfigError(f"no log is called {pattern!r}, as --training has it; the logs are {some or 'none'}")


def _chosen(name: str, patterns: Iterable[str]) -> bool:
    return any(fnmatch(name.casefold(), pattern.casefold()) for pattern in patterns)
