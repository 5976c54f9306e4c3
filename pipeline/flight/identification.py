"""Fit one kind of model to some records and judge it on others: the same for one flight and for several."""

from __future__ import annotations

from collections.abc import Sequence

import sysid
from logparse import MissingDataError, RotoridError
from pipeline.config import AnalysisConfig
from pipeline.execution.stages import Stages
from pipeline.flight.kinds import RIGID_BODY_KEY, ModelKind
from pipeline.results.failure import Failure
from pipeline.results.flight import ModelResult, Prediction
from sysid.records.excitation import Coherence, coherence

#: Part of the time limit of a stage after which a scan of orders ends with what it has.
SCAN_PART = 0.8


def identify(
    kind: ModelKind,
    fitted: Sequence[sysid.Experiment],
    judges: Sequence[sysid.Experiment],
    config: AnalysisConfig,
    stages: Stages,
) -> ModelResult:
    """Fit, judge, and scan orders where that was asked for; what could not be done leaves its reason in the result."""
    model = stages.run(kind.key, lambda report: kind.fit(fitted, config, report))
    if isinstance(model, Failure):
        return without_model(kind, model)
    validation = stages.run("validation", lambda _: sysid.validate(model, [*fitted, *judges]))
    predictions: tuple[Prediction, ...] = ()
    if not isinstance(validation, Failure):
        predictions = tuple(
            Prediction(
                experiment=record,
                y_hat=validation.predictions[record.name],
                training=number < len(fitted),
                drift=validation.drift.get(record.name),
            )
            for number, record in enumerate((*fitted, *judges))
        )
    orders = None
    if config.scan_orders and kind.scans:
        orders = stages.run(
            "orders",
            lambda report: sysid.scan_orders(
                fitted, structure=kind.scans, time_limit=SCAN_PART * config.time_limit, progress=report
            ),
        )
    return ModelResult(
        key=kind.key,
        title=kind.title,
        note=kind.note,
        model=model,
        validation=validation,
        predictions=predictions,
        orders=orders,
        coherence=_coherence(fitted) if kind.linear else None,
    )


def without_model(kind: ModelKind, failure: Failure) -> ModelResult:
    """Return that a kind of model could not be fitted."""
    return ModelResult(key=kind.key, title=kind.title, note=kind.note, model=failure)


def _coherence(fitted: Sequence[sysid.Experiment]) -> Coherence | Failure:
    """Return how much of the outputs answers to the inputs in what a model was fitted to, or why it is not known."""
    try:
        return coherence(fitted)
    except RotoridError as error:
        return Failure("coherence", str(error))


def compare_parameters(
    records: Sequence[sysid.Experiment], models: Sequence[ModelResult], config: AnalysisConfig, stages: Stages
) -> sysid.PhysicalParameters | Failure:
    """Apply every method to the records that the rigid body was fitted to."""
    result = next((each for each in models if each.key == RIGID_BODY_KEY), None)
    body = None if result is None else result.model

    def compare(_: object) -> sysid.PhysicalParameters:
        if not records:
            raise MissingDataError((result.missing if result else "") or "no record has motor outputs and attitude")
        return sysid.physical_parameters(
            records, config.mass, rigid_body=body if isinstance(body, sysid.RigidBodyModel) else None
        )

    return stages.run("parameters", compare)
