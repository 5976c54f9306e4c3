"""Stored models with new inputs: read models.json back, run a model on a log or a table, compare where possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import pandas as pd

import estimation
import logparse
import sysid
from core.serialization import from_json
from logparse import MissingDataError, RotoridError, Vehicle
from pipeline.config import ConfigError
from pipeline.execution.stages import Progress, silent
from pipeline.flight.identification import free_runs, model_result
from pipeline.flight.kinds import KINDS
from pipeline.names import printable
from pipeline.results.failure import Failure
from pipeline.results.flight import ModelResult, Prediction
from pipeline.results.model import ModelsFile
from sysid.transfer_functions.model_record import ClosedLoopRecord, FunctionsRecord, TransferFunctionsRecord
from sysid.validation.report import ModelRecord


@dataclass(frozen=True, slots=True)
class StoredModel:
    """A model in a file, not yet read."""

    owner: str  #: Craft (joint models) or flight that it was fitted to.
    key: str  #: Its kind, as `pipeline.flight.kinds.KINDS` has it.
    record: ModelRecord


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Replay:
    """Stored models, run with new inputs."""

    name: str  #: Of the log or table.
    #: Files.
    inputs: Path
    models: Path
    owner: str  #: Whose models they are.
    results: tuple[ModelResult, ...]  #: With one prediction each, and a validation where the motion was measured.
    measured: bool  #: Whether the motion is known, so that there is something to compare with.
    notes: tuple[str, ...] = ()  #: What a reader must know of how the models were run.


def load_models(path: str | Path) -> list[StoredModel]:
    """List the models of a models.json, those of crafts before those of single flights; ConfigError without any."""
    path = Path(path)
    try:
        file = from_json(path.read_bytes(), ModelsFile)
    except (ValueError, RecursionError) as error:  # the latter: nested too deep
        raise ConfigError(
            f"{path} is not a models.json of this version of rotorid ({error}); analyze the logs again"
        ) from error
    stored = [
        StoredModel(owner.name, key, record)
        for owner in (*file.joint, *file.flights)
        for key, record in owner.models.items()
    ]
    if not stored:
        raise ConfigError(f"{path} holds no models")
    return stored


def choose(stored: Sequence[StoredModel], wanted: str | None = None) -> list[StoredModel]:
    """Choose models of one owner by ``KIND``, ``OWNER`` or ``OWNER/KIND``; ConfigError lists what there is."""
    fitting = [model for model in stored if wanted in (None, model.key, model.owner, f"{model.owner}/{model.key}")]
    listed = ", ".join(dict.fromkeys(f"{model.owner}/{model.key}" for model in stored))
    if not fitting:
        raise ConfigError(f"there is no model {wanted!r}; there are {listed}")
    return [model for model in fitting if model.owner == fitting[0].owner]


def read_model(record: ModelRecord, vehicle: Vehicle | None = None) -> sysid.Model:
    """Make a model again from its record; ConfigError without a vehicle that it needs."""
    if isinstance(record, TransferFunctionsRecord):
        return sysid.TransferFunctionModel.from_record(record)
    if isinstance(record, ClosedLoopRecord):
        return sysid.ClosedLoopModel.from_record(record)
    if vehicle is None:
        raise ConfigError("a rigid body needs the attitude of a log; give a log as --inputs")
    return sysid.RigidBodyModel.from_record(record, vehicle)


#: Inputs about which a linear model of the craft works: the mean of those given, as in its validation (a flight that
#: hovers, in air of its own), or of those that it was fitted to (new inputs, such as hover and a step on top).
Trim = Literal["own", "training"]


def replay(
    models: str | Path,
    inputs: str | Path,
    wanted: str | None = None,
    progress: Progress | None = None,
    trim: Trim | None = None,
) -> Replay:
    """Run stored models with the inputs of a log or of a CSV table.

    Those that cannot be run say why in their result; RotoridError where none can.
    """
    models, inputs = Path(models), Path(inputs)
    chosen = choose(load_models(models), wanted)
    report = progress or silent
    table = inputs.suffix.lower() == ".csv"
    cut = _of_table(inputs, report) if table else _of_log(inputs, report)
    results, measured, notes = _run(chosen, cut, report, trim)
    if table and not measured:
        notes.append("The table has no measured motion: models start at rest at 0, and there is nothing to compare.")
    if not any(result.predictions for result in results):
        raise MissingDataError(f"{printable(inputs.name)}: no model can be run: {results[0].report.missing}")
    return Replay(
        name=printable(inputs.stem),
        inputs=inputs,
        models=models,
        owner=chosen[0].owner,
        results=tuple(results),
        measured=measured,
        notes=tuple(notes),
    )


#: What numbers end in that somebody has changed in a file, so that they do not fit together.
_UNFIT = (ValueError, IndexError, KeyError, AssertionError)


def _failed(stored: StoredModel, error: Exception) -> ModelResult:
    """Return what cannot be run, and why."""
    reason = str(error)
    if not isinstance(error, RotoridError):
        reason = f"the numbers of its file do not fit together ({_what(error)}); analyze the logs again"
    return model_result(stored.key, _title(stored), Failure(stored.key, reason))


#: A model with the record to run it on, and whether its outputs were measured.
Cut = Callable[[StoredModel], tuple[sysid.Model, sysid.Experiment, bool]]


def _run(
    chosen: Sequence[StoredModel], cut: Cut, progress: Progress, trim: Trim | None
) -> tuple[list[ModelResult], bool, list[str]]:
    """Run each model on what `cut` makes for it; say whether anything was measured, and what a reader must know."""
    results, notes, measured = [], [], False
    for number, stored in enumerate(chosen):
        title = _title(stored)
        progress(f"running {title}", 0.5 + 0.5 * number / len(chosen))
        try:
            model, record, known = cut(stored)
            record, about = _about(record, model, trim or ("own" if known else "training"), title)
            notes += about
            if any(name == record.name or name.startswith(f"{record.name} [") for name in model.training):
                notes.append(f"{title} was fitted to this flight or to a part of it: the comparison flatters it.")
            results.append(_judged(stored, model, record) if known else _from_rest(stored, model, record))
            measured = measured or known
        except (RotoridError, *_UNFIT) as error:
            results.append(_failed(stored, error))
    return results, measured, notes


def _of_log(path: Path, progress: Progress) -> Cut:
    progress("reading the log", 0.0)
    log = logparse.read_log(path)
    progress("reconstructing the trajectory", 0.1)
    trajectory = estimation.estimate(log.tables, date=log.start_utc)

    def cut(stored: StoredModel) -> tuple[sysid.Model, sysid.Experiment, bool]:
        kind = next((kind for kind in KINDS if kind.key == stored.key), None)
        if kind is None:
            raise MissingDataError(f"what a model {stored.key!r} reads of a log is not known")
        record = sysid.Experiment.from_flight(
            log,
            trajectory,
            rate=stored.record.rate if isinstance(stored.record, FunctionsRecord) else kind.rate or 10.0,
            inputs=kind.inputs,
            outputs="position",
            frame=kind.frame,
            name=printable(path.stem),
        )
        return read_model(stored.record, log.vehicle), record, True

    return cut


def _of_table(path: Path, progress: Progress) -> Cut:
    progress("reading the inputs", 0.0)
    try:
        table = pd.read_csv(path, skipinitialspace=True)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as error:
        raise ConfigError(f"{printable(path.name)} is not a CSV table ({_what(error)})") from error
    if "t" not in table:
        raise ConfigError(f"{printable(path.name)} has no column t with the time in seconds")

    def cut(stored: StoredModel) -> tuple[sysid.Model, sysid.Experiment, bool]:
        model = read_model(stored.record)
        return model, *_record(table, model, path)

    return cut


def _from_rest(stored: StoredModel, model: sysid.Model, record: sysid.Experiment) -> ModelResult:
    if isinstance(model, sysid.TransferFunctionModel):
        model = model.from_rest(record.name)
    part = Prediction(experiment=record, y_hat=model.simulate(record), training=False)
    return model_result(stored.key, _title(stored), model, predictions=(part,))


def _about(record: sysid.Experiment, model: sysid.Model, trim: Trim, title: str) -> tuple[sysid.Experiment, list[str]]:
    """Return a record the trim that a linear model of the craft works about, and say which; others need none."""
    if not isinstance(model, sysid.TransferFunctionModel):
        return record, []
    if trim == "own":
        return record, [f"{title}: the model works about the mean of the inputs given, as in its validation."]
    if not model.input_trim:
        return record, [
            f"{title}: the file does not tell the inputs about which the model was fitted (analyse the logs anew "
            "to have them); it works about the mean of the inputs given."
        ]
    known = np.array([model.input_trim[name] for name in model.input_names])
    apart = record.input_trim - known
    most = int(np.argmax(np.abs(apart)))
    name = model.input_names[most]
    unit = {"us": " µs", "": ""}.get(model.units.get(name, ""), f" {model.units.get(name, '')}")
    note = f"{title}: the model works about the mean inputs of the flights that it was fitted to"
    note += (
        f" ({name}: {known[most]:.4g}{unit}); the inputs given are on average up to {abs(apart[most]):.3g}{unit} away."
    )
    return replace(record, input_trim=known), [note]


def _record(table: pd.DataFrame, model: sysid.Model, path: Path) -> tuple[sysid.Experiment, bool]:
    """Make a record of a table; without measured outputs these are zero, or the references of a closed loop."""
    assert isinstance(model, sysid.TransferFunctionModel | sysid.ClosedLoopModel)
    lacking = [name for name in model.input_names if name not in table]
    if lacking:
        raise MissingDataError(f"{printable(path.name)} has no column {', '.join(lacking)}")
    closed = isinstance(model, sysid.ClosedLoopModel)
    measured_names = [f"{name}_measured" if closed else name for name in model.output_names]
    known = all(name in table for name in measured_names)
    u = _numbers(table, list(model.input_names), path)
    if known:
        y = _numbers(table, measured_names, path)
    elif closed:
        y = u
    else:
        y = pd.DataFrame(0.0, index=table.index, columns=list(model.output_names))
    record = sysid.Experiment.from_arrays(
        _numbers(table, ["t"], path)["t"],
        u,
        y,
        name=printable(path.stem),
        input_names=model.input_names,
        output_names=model.output_names,
        units=model.units,
    )
    return record, known


def _numbers(table: pd.DataFrame, names: list[str], path: Path) -> pd.DataFrame:
    try:
        return table[names].astype(float)
    except ValueError as error:
        raise ConfigError(f"{printable(path.name)}: {_what(error)}; columns must hold numbers only") from error


def _judged(stored: StoredModel, model: sysid.Model, record: sysid.Experiment) -> ModelResult:
    try:
        validation = sysid.validate(model, [record])
    except sysid.ExperimentError as error:
        part = Prediction(experiment=record, y_hat=model.simulate(record), training=False)
        unjudged = Failure("validation", f"not judged: {error}")
        return model_result(stored.key, _title(stored), model, unjudged, (part,))
    parts = free_runs(model, validation, [record])
    return model_result(stored.key, _title(stored), model, validation, parts, flight=record.name)


def _title(stored: StoredModel) -> str:
    return next((kind.title for kind in KINDS if kind.key == stored.key), stored.key)


def _what(error: Exception) -> str:
    text = str(error).strip().splitlines()
    return f"{type(error).__name__}: {text[0]}" if text else type(error).__name__
