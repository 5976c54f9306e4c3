"""Flights to crafts: grouped, divided into those to fit and those to judge, identified jointly where that is new.

Experiments stay in the store and are read where a kind of model is fitted; only models, and free runs thinned for
plots, come back to whoever asked.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from typing import TypeVar

import sysid
from core.findings import gathered
from core.serialization import cleaned
from logparse import Finding, Vehicle
from pipeline.config import AnalysisConfig
from pipeline.execution.executors import WorkerDiedError, outcomes
from pipeline.execution.stages import Overall, Progress, Stages, silent
from pipeline.fleet.drift import follow
from pipeline.fleet.envelope import envelope
from pipeline.fleet.homogeneity import alike_flights, unlike_findings
from pipeline.fleet.result import ANOTHER_RECORDING, IdentifiedCrafts, Run
from pipeline.fleet.split import choose_split
from pipeline.flight.craft import by_craft, changes, in_order, kept_apart
from pipeline.flight.identification import compare_parameters, identify, parameter_rows, without_model
from pipeline.flight.kinds import KINDS, RIGID_BODY_KEY, THRUST_KEY, ModelKind
from pipeline.flight.next_flights import for_craft
from pipeline.names import printable
from pipeline.results.craft import GroupResult
from pipeline.results.failure import Failure, findings_of, present, reasons
from pipeline.results.fleet import FlightEntry, GroupEntry, LogFailure, Split
from pipeline.results.flight import ModelResult, Prediction
from pipeline.results.model import verdict_of
from pipeline.results.report import CraftReport
from pipeline.storage.dataset import EXPERIMENTS, part, read_experiment
from pipeline.storage.manifest import CRAFTS, craft_key, drawn_anew, is_current, write_entry
from pipeline.storage.store import open_store
from sysid.autopilot.values import over_flights

R = TypeVar("R")


def identify_crafts(
    flights: Sequence[FlightEntry], run: Run, progress: Progress, executor: Executor | None = None
) -> IdentifiedCrafts:
    """Identify every craft that has several flights from some of them, and judge its models on the others."""
    config, store = run.config, run.store
    crafts = by_craft(flights)
    apart = kept_apart(crafts)
    used = {flight.name for craft in crafts for flight in craft}
    left_out = [
        (flight.source, ANOTHER_RECORDING)
        for flight in flights
        if flight.experiments and flight.position_known and flight.name not in used
    ]
    builds = sorted(_builds(crafts, config), key=lambda build: (-len(build[1]), build[1][0].craft, build[0]))
    pooled = {flight.name for build, craft in builds if build > 1 for flight in craft}
    entries, failures, unstored = [], [], []
    fitted: dict[str, GroupResult] = {}
    for number, (build, craft) in enumerate(builds):
        first = craft[0]
        split = choose_split(craft, config)
        unused = {name: reason for name, reason in split.unused.items() if name not in pooled}
        left_out += [(flight.source, unused[flight.name]) for flight in craft if flight.name in unused]
        findings = (*changes(craft), *apart.get(first.craft, ()), *unlike_findings(craft))
        entry = GroupEntry(
            name=first.craft_name if build == 1 else f"{first.craft_name}, build {build}",
            folder=first.vehicle if build == 1 else f"{first.vehicle}-build-{build}",
            key=craft_key(craft, split, findings, config),
            craft=first.craft,
            vehicle=first.vehicle,
            training=split.training,
            held_out=split.held_out,
            split=split.sentence,
            pages=run.pages,
        )
        if not run.redo and _is_there(entry, run):
            entries.append(entry)
            continue

        what = f"{entry.name}, {len(craft)} flights jointly"

        def report(stage: str, fraction: float, number: int = number, what: str = what) -> None:
            progress(f"{what}: {stage}", (number + fraction) / len(builds))

        progressing = Overall(report)
        result = identify_craft(entry.name, craft, split, store.url, config, progressing, executor, findings)
        try:
            with store.scratch() as scratch:
                product = scratch / "product"
                product.mkdir()
                if run.publish is not None:
                    run.publish(result, product)
                write_entry(entry, product)
                store.commit(product, f"{CRAFTS}/{entry.folder}")
        except OSError as error:
            reason = f"its joint models could not be stored: {error.strerror or error}"
            failures.append(LogFailure(entry.name, reason))
            unstored.append(entry)
        else:
            entries.append(entry)
            fitted[entry.folder] = result if run.publish is None else _light(result)
    return IdentifiedCrafts(
        entries=tuple(entries),
        left_out=tuple(left_out),
        failures=tuple(failures),
        unstored=tuple(unstored),
        fitted=fitted,
    )


def _builds(
    crafts: Sequence[tuple[FlightEntry, ...]], config: AnalysisConfig
) -> Iterator[tuple[int, tuple[FlightEntry, ...]]]:
    """Yield what is fitted jointly: each craft, which leaves out flights unlike the rest, and these among themselves.

    Flights that the user names are fitted as asked.
    """
    for craft in crafts:
        if len(craft) > 1:
            yield 1, craft
        if not (config.training or config.validation):
            further = (alike for alike in alike_flights(craft)[1:] if len(alike) > 1)
            yield from enumerate(further, start=2)


def _light(result: GroupResult) -> GroupResult:
    """Leave out the free runs, which have been published: those of many crafts would not fit into memory."""
    return replace(result, models=tuple(replace(model, predictions=()) for model in result.models))


def _is_there(entry: GroupEntry, run: Run) -> bool:
    """Return whether the store has the products of a craft, with its pages drawn anew where others are wanted."""
    if is_current(run.store, entry):
        return True
    same, publish = is_current(run.store, replace(entry, pages="")), run.publish
    return same and publish is not None and drawn_anew(run.store, f"{CRAFTS}/{entry.folder}", entry, publish)


#: Rows of free runs that come back of each kind of model: enough for plots, however many flights there are.
MOST_ROWS = 200_000


@dataclass(frozen=True, slots=True, kw_only=True)
class _Joint:
    """What is fitted to which flights of a craft, and judged on which: everything that another process must know."""

    craft: str
    store: str  #: URL.
    #: Paths in the store of the experiments of each kind, of the flights that have it.
    training: Mapping[str, tuple[str, ...]]
    judging: Mapping[str, tuple[str, ...]]
    outside: frozenset[str]  #: Flights that leave the envelope of those that train.
    config: AnalysisConfig
    time_limit: float  #: Of a stage, s.

    def identify(self, kind: ModelKind, progress: Progress = silent) -> tuple[ModelResult, Stages]:
        """Identify one kind of model; its free runs come back thinned."""
        stages = Stages(progress, self.time_limit)
        fitted, held_out = (self._read(paths[kind.key]) for paths in (self.training, self.judging))
        result = identify(kind, fitted, held_out, self.config, stages, craft=self.craft, outside=self.outside)
        most = max(500, MOST_ROWS // max(1, len(result.predictions)))
        return replace(
            result, predictions=tuple(_thinned(prediction, most) for prediction in result.predictions)
        ), stages

    def physical(
        self, body: ModelResult, progress: Progress = silent
    ) -> tuple[sysid.ThrustModel | Failure, sysid.PhysicalParameters | Failure, Stages]:
        """Find thrust and physical parameters by every method."""
        stages = Stages(progress, self.time_limit)
        fitted = self._read(self.training[THRUST_KEY])
        thrust = stages.run("thrust", lambda _: sysid.fit_thrust(fitted, mass=self.config.mass))
        records = self._read(self.training[RIGID_BODY_KEY])
        return thrust, compare_parameters(records, [body], self.config, stages), stages

    def _read(self, paths: Sequence[str]) -> list[sysid.Experiment]:
        store = open_store(self.store)
        return [read_experiment(store.read(path)) for path in paths]


def identify_craft(
    name: str,
    flights: Sequence[FlightEntry],
    split: Split,
    store: str,
    config: AnalysisConfig,
    progress: Progress | None = None,
    executor: Executor | None = None,
    findings: Sequence[Finding] = (),
) -> GroupResult:
    """Identify one craft from some of its flights and judge the models on others."""
    by_name = {flight.name: flight for flight in flights}
    training = [by_name[flight] for flight in split.training]
    held_out = [by_name[flight] for flight in split.judging]
    stages = Stages(progress or silent, config.time_limit * len(flights))
    covered = stages.run("coverage", lambda _: envelope(flights, split.training, split.held_out))
    flown = present(covered)
    joint = _Joint(
        craft=name,
        store=store,
        training={kind.key: _paths(kind, training) for kind in KINDS},
        judging={kind.key: _paths(kind, held_out) for kind in KINDS},
        outside=frozenset(() if flown is None else (excursion.flight for excursion in flown.outside)),
        config=config,
        time_limit=stages.time_limit,
    )
    models = _identify_all(joint, training, stages, executor)
    reports = tuple(models[kind.key].report for kind in KINDS)
    thrust, parameters = _physical(joint, models[RIGID_BODY_KEY], stages, executor)
    if not joint.training[THRUST_KEY]:
        thrust = Failure("thrust", models[THRUST_KEY].report.missing)
    drift = stages.run("drift", lambda _: follow(flights))
    advice = present(
        stages.run("advice", lambda _: for_craft(flights, present(covered), present(drift), present(parameters)))
    )
    report = CraftReport(
        rotorid=version("rotorid"),
        name=name,
        vehicle=_vehicle(flights, store),
        training=split.training,
        held_out=split.held_out,
        split=split.sentence,
        verdict=verdict_of(reports),
        rmse=tuple(row for model in reports for row in model.rmse),
        models=reports,
        thrust=present(thrust),
        parameters=parameter_rows(parameters),
        coverage=present(covered),
        drift=present(drift),
        autopilot=over_flights([(flight.name, flight.autopilot) for flight in in_order(flights)]),
        advice=advice or (),
        findings=gathered((*findings, *findings_of(thrust, parameters, covered, drift), *stages.findings)),
        missing=reasons(thrust, parameters, covered, drift),
        timings_s=stages.timings,
    )
    return GroupResult(report=cleaned(report, CraftReport, printable), models=tuple(models[kind.key] for kind in KINDS))


def _paths(kind: ModelKind, flights: Sequence[FlightEntry]) -> tuple[str, ...]:
    having = (flight for flight in flights if kind.key in flight.experiments)
    return tuple(part(EXPERIMENTS, kind.key, flight.vehicle, flight.folder) for flight in having)


def _identify_all(
    joint: _Joint, training: Sequence[FlightEntry], stages: Stages, executor: Executor | None
) -> dict[str, ModelResult]:
    """Identify every kind of model, side by side where there is an executor; by the kind's key."""
    fitted = [kind for kind in KINDS if joint.training[kind.key]]
    models = {
        kind.key: without_model(kind, Failure("experiment", _no_records(kind, training)))
        for kind in KINDS
        if kind not in fitted
    }
    for kind, outcome in outcomes(executor, _here(joint.identify, executor, stages), fitted):
        if isinstance(outcome, WorkerDiedError):
            models[kind.key] = without_model(kind, Failure(kind.key, str(outcome)))
        else:
            models[kind.key], own = outcome
            stages.take(own)
        stages.progress(kind.key, 1.0)
    return models


def _here(work: Callable[..., R], executor: Executor | None, stages: Stages) -> Callable[..., R]:
    """Return work that tells of its progress where it is done in this process."""
    return work if executor is not None else partial(work, progress=stages.progress)


def _no_records(kind: ModelKind, training: Sequence[FlightEntry]) -> str:
    """Explain why there is nothing to fit a kind of model to."""
    if not training:
        return "none of its flights was chosen for training"
    alone = (flight.missing.get(kind.key, "") for flight in training)
    return next((reason for reason in alone if reason), "no training flight has its inputs")


def _thinned(prediction: Prediction, most: int) -> Prediction:
    """Keep every so many-th row of a free run, and of its experiment what plots show."""
    step = -(-len(prediction.experiment.t) // most)
    rows = slice(None, None, step)
    whole = prediction.experiment
    experiment = replace(whole, t=whole.t[rows], u=whole.u[rows], y=whole.y[rows], context=None)
    drift = None if prediction.drift is None else prediction.drift[rows]
    return replace(prediction, experiment=experiment, y_hat=prediction.y_hat[rows], drift=drift)


def _physical(
    joint: _Joint, body: ModelResult, stages: Stages, executor: Executor | None
) -> tuple[sysid.ThrustModel | Failure, sysid.PhysicalParameters | Failure]:
    """Find thrust and physical parameters, beside this process where there is an executor."""
    # Free runs are many megabytes that this does not need.
    light = replace(body, predictions=())
    ((_, outcome),) = outcomes(executor, _here(joint.physical, executor, stages), [light])
    if isinstance(outcome, WorkerDiedError):
        return Failure("thrust", str(outcome)), Failure("parameters", str(outcome))
    thrust, parameters, own = outcome
    stages.take(own)
    return thrust, parameters


def _vehicle(flights: Sequence[FlightEntry], store: str) -> Vehicle:
    """Read what a log says about the craft from an experiment, of which each of the flights has one."""
    first = flights[0]
    content = open_store(store).read(part(EXPERIMENTS, first.experiments[0], first.vehicle, first.folder))
    return read_experiment(content).vehicle or Vehicle()
