"""Fit one kind of model to some records and judge it on others: the same for one flight and for several."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Sequence, Set
from dataclasses import replace
from typing import TYPE_CHECKING

import msgspec

import sysid
from core.findings import gathered
from core.serialization import cleaned
from logparse import MissingDataError, RotoridError
from pipeline.config import AnalysisConfig
from pipeline.execution.stages import Stages
from pipeline.flight.coverage import BAND, in_band
from pipeline.flight.kinds import RIGID_BODY_KEY, ModelKind
from pipeline.results.coverage import Linearity
from pipeline.results.failure import Failure, findings_of, present
from pipeline.results.flight import ModelResult, Prediction
from pipeline.results.model import CoherenceReport, HorizonRow, ModelReport, ParameterRow, RmseRow, average
from pipeline.results.span import Span
from sysid.records.excitation import Coherence, coherence
from sysid.rigid_body.model_record import RigidBodyRecord
from sysid.validation.purposes import uses_of
from sysid.validation.report import ModelRecord

if TYPE_CHECKING:
    import pandas as pd

#: Part of the time limit of a stage after which a scan of orders ends with what it has.
SCAN_PART = 0.8


def identify(
    kind: ModelKind,
    fitted: Sequence[sysid.Experiment],
    held_out: Sequence[sysid.Experiment],
    config: AnalysisConfig,
    stages: Stages,
    *,
    flight: str = "",
    craft: str | None = None,
    outside: Set[str] = frozenset(),
) -> ModelResult:
    """Fit, judge, and scan orders where that was asked for; what could not be done leaves its reason in the result.

    `flight` and `craft` are as of `model_result`; records `outside` of the envelope of those fitted are judged apart.
    """
    model = stages.run(kind.key, lambda report: kind.fit(fitted, config, report))
    if isinstance(model, Failure):
        return without_model(kind, model)
    validation = stages.run("validation", lambda _: sysid.validate(model, [*fitted, *held_out], outside=outside))
    orders = None
    if config.scan_orders and kind.structure:
        orders = stages.run(
            "orders",
            lambda report: sysid.scan_orders(
                fitted, structure=kind.structure, time_limit=SCAN_PART * config.time_limit, progress=report
            ),
        )
    return model_result(
        kind.key,
        kind.title,
        model,
        validation,
        () if isinstance(validation, Failure) else free_runs(model, validation, [*fitted, *held_out]),
        note=kind.note,
        orders=orders,
        spectra=_coherence(fitted) if kind.linear else None,
        flight=flight,
        craft=craft,
    )


def free_runs(
    model: sysid.Model, validation: sysid.Validation, records: Sequence[sysid.Experiment]
) -> tuple[Prediction, ...]:
    """Return the free runs of a validation beside the records that they should reproduce."""
    return tuple(
        Prediction(
            experiment=record,
            y_hat=validation.predictions[record.name],
            training=record.name in model.training,
            drift=validation.drift.get(record.name),
        )
        for record in records
    )


def without_model(kind: ModelKind, failure: Failure) -> ModelResult:
    """Report that a kind of model could not be fitted."""
    return model_result(kind.key, kind.title, failure, note=kind.note)


def _coherence(fitted: Sequence[sysid.Experiment]) -> Coherence | Failure:
    """Return how much of the outputs answers to the inputs in what a model was fitted to, or why it is not known."""
    try:
        return coherence(fitted)
    except RotoridError as error:
        return Failure("coherence", str(error))


def model_result(
    key: str,
    title: str,
    model: sysid.Model | Failure,
    validation: sysid.Validation | Failure | None = None,
    predictions: tuple[Prediction, ...] = (),
    *,
    note: str = "",
    orders: sysid.OrderScan | Failure | None = None,
    spectra: Coherence | Failure | None = None,
    flight: str = "",
    craft: str | None = None,
) -> ModelResult:
    """Assemble the result of a model of one `flight`, or of a `craft` of which every record is a flight."""
    judged, scanned = present(validation), present(orders)
    record = None if isinstance(model, Failure) else model.record()
    uses = uses_of(present(model)) if judged is None else judged.uses
    spans = {prediction.experiment.name: prediction.span for prediction in predictions}
    rows = (
        []
        if judged is None
        else [_rmse(key, *group, spans, flight, craft) for group in judged.table.groupby("flight", sort=False)]
    )
    missing = [failure.reason for failure in (model, validation) if isinstance(failure, Failure)][:1]
    if isinstance(orders, Failure):
        missing.append(f"orders were not scanned: {orders.reason}")
    report = ModelReport(
        key=key,
        title=title,
        note=note,
        verdict=uses.free_run.verdict,
        uses=uses,
        rmse=tuple(sorted(rows, key=lambda row: row.part == "training")),
        rmse_average_m=average([row.rmse_m for row in rows if row.part == "held-out"]),
        horizons=tuple(_horizons(judged)),
        validation=None if judged is None else judged.report(),
        orders=None if scanned is None else replace(scanned, findings=()),
        coherence=None if spectra is None else coherence_report(spectra),
        kind="" if record is None else str(record.__struct_config__.tag),
        model=None if record is None else _without_covariance(record),
        findings=gathered(findings_of(model, validation, spectra, orders)),
        missing="; ".join(missing),
    )
    # A joint fit thins its free runs before they come back: here they would come back whole.
    light = validation if judged is None else replace(judged, predictions={}, drift={})
    return ModelResult(report=report, model=model, validation=light, predictions=predictions)


def _rmse(
    key: str, record: Hashable, table: pd.DataFrame, spans: Mapping[str, Span], flight: str, craft: str | None
) -> RmseRow:
    """Return the errors of a free run on one record of a validation's table, which has a row for each output."""
    by_output, span = table.set_index("output"), spans.get(str(record))

    def errors(name: str) -> dict[str, float]:
        return {str(output): float(error) for output, error in by_output[name].items()}

    return RmseRow(
        flight=flight or str(record),
        scope="own" if craft is None else "joint",
        model=key,
        craft=craft,
        part="training" if bool(by_output["trained"].iloc[0]) else "held-out",
        start_s=None if span is None else span.start,
        duration_s=None if span is None else span.duration,
        rmse_m=errors("rmse"),
        fit_percent=errors("fit_percent"),
        rmse_mean_m=errors("rmse_mean"),
        rmse_constant_position_m=errors("rmse_constant_position"),
    )


def _horizons(validation: sysid.Validation | None) -> Iterator[HorizonRow]:
    """Average the horizon curve over the records that the model has not seen; empty when it has seen all."""
    if validation is None or not validation.unseen or validation.horizons.empty:
        return
    table = validation.horizons[~validation.horizons["trained"].astype(bool)]
    errors = ["rmse", "rmse_constant_position", "rmse_constant_velocity"]
    means = table.groupby(["output", "horizon"], sort=False)[errors].mean()
    for (output, horizon), rmse, position, velocity in means.itertuples():
        yield HorizonRow(
            output=str(output),
            horizon_s=float(horizon),
            rmse_m=rmse,
            constant_position_m=position,
            constant_velocity_m=velocity,
        )


def coherence_report(measured: Coherence | Failure) -> CoherenceReport:
    """Sum a coherence up over the frequencies at which a multirotor answers; or say why there is none."""
    if isinstance(measured, Failure):
        return CoherenceReport(missing=measured.reason)
    return CoherenceReport(
        band_rad_s=BAND,
        inputs=measured.input_names,
        averages=measured.averages,
        chance=measured.threshold,
        outputs=in_band(measured) or dict.fromkeys(measured.output_names, Linearity()),
    )


def _without_covariance(record: ModelRecord) -> ModelRecord:
    """Leave out findings, which stand beside the model, and covariances, which models.json has."""
    if isinstance(record, RigidBodyRecord):
        return msgspec.structs.replace(record, findings=(), covariance=None)
    functions = {
        output: {source: replace(function, covariance=None) for source, function in row.items()}
        for output, row in record.transfer_functions.items()
    }
    return msgspec.structs.replace(record, findings=(), transfer_functions=functions)


def compare_parameters(
    records: Sequence[sysid.Experiment], models: Sequence[ModelResult], config: AnalysisConfig, stages: Stages
) -> sysid.PhysicalParameters | Failure:
    """Apply every method to the records that the rigid body was fitted to."""
    result = next((model for model in models if model.key == RIGID_BODY_KEY), None)
    body = None if result is None else result.model

    def compare(_: object) -> sysid.PhysicalParameters:
        if not records:
            raise MissingDataError(
                (result.report.missing if result else "") or "no record has motor outputs and attitude"
            )
        return sysid.physical_parameters(
            records, config.mass, rigid_body=body if isinstance(body, sysid.RigidBodyModel) else None
        )

    return stages.run("parameters", compare)


def parameter_rows(parameters: sysid.PhysicalParameters | Failure) -> tuple[ParameterRow, ...] | None:
    """List physical parameters, a row for each parameter and method; None where there are none."""
    if isinstance(parameters, Failure):
        return None
    return cleaned(parameters.table.reset_index().to_dict("records"), tuple[ParameterRow, ...])
