"""One craft from several of its flights, jointly: fitted to some and judged on the others.

Experiments stay in the store and are read where a kind of model is fitted; only models, and free runs thinned for
plots, come back to whoever asked.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial

import sysid
from logparse import Finding, Vehicle
from pipeline.config import AnalysisConfig
from pipeline.execution.executors import as_done
from pipeline.execution.stages import Progress, Stages, silent
from pipeline.fleet.drift import follow
from pipeline.fleet.envelope import envelope
from pipeline.flight.advice.next_flights import for_craft
from pipeline.flight.craft import in_order
from pipeline.flight.identification import compare_parameters, identify, without_model
from pipeline.flight.kinds import KINDS, RIGID_BODY_KEY, THRUST_KEY, ModelKind
from pipeline.results.entry import FlightEntry
from pipeline.results.failure import Failure, findings_of, present
from pipeline.results.fleet import GroupResult, Split
from pipeline.results.flight import ModelResult, Prediction
from pipeline.storage.dataset import EXPERIMENTS, part, read_experiment
from pipeline.storage.store import open_store
from sysid.autopilot.values import over_flights

_LOG = logging.getLogger("rotorid.pipeline")

#: Rows of free runs that come back of each kind of model: enough for plots, however many flights there are.
MOST_ROWS = 200_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Records:
    """Where the experiments of one kind are, of the flights that have it."""

    store: str  #: URL.
    #: Paths in the store.
    training: tuple[str, ...]
    judging: tuple[str, ...]

    def fitted(self) -> list[sysid.Experiment]:
        """Read what the models are fitted to."""
        return self._read(self.training)

    def judges(self) -> list[sysid.Experiment]:
        """Read what the models are judged on."""
        return self._read(self.judging)

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
    training = [by_name[each] for each in split.training]
    judging = [by_name[each] for each in split.judging]
    records = {kind.key: _records(store, kind.key, training, judging) for kind in KINDS}
    stages = Stages(progress or silent, config.time_limit * len(flights))
    models = _identify_all(records, training, config, stages, executor)
    ordered = [models[kind.key] for kind in KINDS]
    thrust, parameters = _physical(records, models[RIGID_BODY_KEY], config, stages, executor)
    if not records[THRUST_KEY].training:
        thrust = Failure("thrust", models[THRUST_KEY].missing)
    covered = stages.run("coverage", lambda _: envelope(flights, split.training, split.held_out))
    drift = stages.run("drift", lambda _: follow(flights))
    advice = present(
        stages.run("advice", lambda _: for_craft(flights, present(covered), present(drift), present(parameters)))
    )
    return GroupResult(
        name=name,
        vehicle=_vehicle(flights, store),
        training=split.training,
        held_out=split.held_out,
        split=split.sentence,
        models=tuple(ordered),
        thrust=thrust,
        parameters=parameters,
        coverage=covered,
        drift=drift,
        autopilot=over_flights([(flight.name, flight.autopilot) for flight in in_order(flights)]),
        advice=advice or (),
        findings=(*findings, *findings_of(thrust, parameters, covered, drift), *stages.findings),
        timings=stages.timings,
    )


def _records(store: str, key: str, training: Sequence[FlightEntry], judging: Sequence[FlightEntry]) -> Records:
    def paths(flights: Sequence[FlightEntry]) -> tuple[str, ...]:
        return tuple(part(EXPERIMENTS, key, each.vehicle, each.folder) for each in flights if key in each.experiments)

    return Records(store=store, training=paths(training), judging=paths(judging))


def _identify_all(
    records: Mapping[str, Records],
    training: Sequence[FlightEntry],
    config: AnalysisConfig,
    stages: Stages,
    executor: Executor | None,
) -> dict[str, ModelResult]:
    """Identify every kind of model, side by side where there is an executor; by the kind's key."""
    models: dict[str, ModelResult] = {}
    fitted = [kind for kind in KINDS if records[kind.key].training]
    for kind in KINDS:
        if kind not in fitted:
            models[kind.key] = without_model(kind, Failure("experiment", _no_records(kind, training)))
    if executor is None:
        return models | {kind.key: _identify(kind, records[kind.key], config, stages) for kind in fitted}
    alone = partial(_identify_alone, records=records, config=config, time_limit=stages.time_limit)
    for kind, job in as_done(executor, alone, fitted):
        try:
            models[kind.key], own = job.result()
        except Exception as error:  # the worker died, or its result could not come back
            _LOG.exception("fitting %s jointly failed", kind.key)
            models[kind.key] = without_model(kind, _dead(kind.key, error))
        else:
            stages.take(own)
        stages.progress(kind.key, 1.0)
    return models


def _dead(stage: str, error: Exception) -> Failure:
    return Failure(stage, f"the worker process failed: {type(error).__name__}: {error}")


def _no_records(kind: ModelKind, training: Sequence[FlightEntry]) -> str:
    """Explain why there is nothing to fit a kind of model to."""
    if not training:
        return "none of its flights was chosen for training"
    alone = (flight.missing.get(kind.key, "") for flight in training)
    return next((reason for reason in alone if reason), "no training flight has its inputs")


def _identify_alone(
    kind: ModelKind, records: Mapping[str, Records], config: AnalysisConfig, time_limit: float
) -> tuple[ModelResult, Stages]:
    """Identify in a process of its own; progress is not heard there."""
    stages = Stages(silent, time_limit)
    return _identify(kind, records[kind.key], config, stages), stages


def _identify(kind: ModelKind, records: Records, config: AnalysisConfig, stages: Stages) -> ModelResult:
    result = identify(kind, records.fitted(), records.judges(), config, stages)
    most = max(500, MOST_ROWS // max(1, len(result.predictions)))
    return replace(result, predictions=tuple(_thinned(each, most) for each in result.predictions))


def _thinned(prediction: Prediction, most: int) -> Prediction:
    """Keep every so many-th row of a free run, and of its experiment what plots show."""
    step = -(-len(prediction.experiment.t) // most)
    rows = slice(None, None, step)
    whole = prediction.experiment
    experiment = replace(whole, t=whole.t[rows], u=whole.u[rows], y=whole.y[rows], context=None)
    drift = None if prediction.drift is None else prediction.drift[rows]
    return replace(prediction, experiment=experiment, y_hat=prediction.y_hat[rows], drift=drift)


def _physical(
    records: Mapping[str, Records],
    body: ModelResult,
    config: AnalysisConfig,
    stages: Stages,
    executor: Executor | None,
) -> tuple[sysid.ThrustModel | Failure, sysid.PhysicalParameters | Failure]:
    """Find thrust and physical parameters by every method, beside the models where there is an executor."""
    # Free runs are many megabytes that this does not need.
    light = replace(body, predictions=())
    work = partial(_physical_alone, records=records, config=config, time_limit=stages.time_limit)
    if executor is None:
        thrust, parameters, own = work(light)
    else:
        ((_, job),) = as_done(executor, work, [light])
        try:
            thrust, parameters, own = job.result()
        except Exception as error:  # the worker died, or its result could not come back
            _LOG.exception("finding physical parameters jointly failed")
            return _dead("thrust", error), _dead("parameters", error)
    stages.take(own)
    return thrust, parameters


def _physical_alone(
    body: ModelResult, records: Mapping[str, Records], config: AnalysisConfig, time_limit: float
) -> tuple[sysid.ThrustModel | Failure, sysid.PhysicalParameters | Failure, Stages]:
    """Do so in a process of its own; progress is not heard there."""
    stages = Stages(silent, time_limit)
    fitted = records[THRUST_KEY].fitted()
    thrust = stages.run("thrust", lambda _: sysid.fit_thrust(fitted, mass=config.mass))
    return thrust, compare_parameters(records[RIGID_BODY_KEY].fitted(), [body], config, stages), stages


def _vehicle(flights: Sequence[FlightEntry], store: str) -> Vehicle:
    """Read what a log says about the craft from an experiment, of which each of the flights has one."""
    first = flights[0]
    content = open_store(store).read(part(EXPERIMENTS, first.experiments[0], first.vehicle, first.folder))
    return read_experiment(content).vehicle or Vehicle()
