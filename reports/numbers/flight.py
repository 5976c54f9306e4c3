"""Results as reports: what report.json holds and every page and table is drawn from."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from importlib.metadata import version
from typing import TYPE_CHECKING

import msgspec

from core.findings import gathered
from core.serialization import cleaned
from pipeline.flight.excitation import BAND, in_band
from pipeline.flight.purposes import summarise, uses_of
from pipeline.names import printable
from pipeline.results.coverage import Linearity
from pipeline.results.failure import Failure, present
from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult, ModelResult
from pipeline.results.model_report import (
    CoherenceReport,
    HorizonRow,
    ModelReport,
    ModelsFile,
    OwnedModels,
    ParameterRow,
    RmseRow,
    average,
)
from pipeline.results.report import (
    CraftReport,
    FlightReport,
    FlownReport,
    LogReport,
    ModeSpan,
    OriginReport,
    TrajectoryReport,
)
from pipeline.results.span import Span
from sysid.rigid_body.model_record import RigidBodyRecord
from sysid.validation.report import ModelRecord

if TYPE_CHECKING:
    from pipeline.results.verdict import Verdict
    from sysid import PhysicalParameters, Validation
    from sysid.records.excitation import Coherence


def flight_report(result: FlightResult) -> FlightReport:
    """Gather what is known of one log; whatever is not finite becomes None."""
    models = [model_report(each, "own", flight=result.name) for each in result.models]
    return cleaned(
        FlightReport(
            rotorid=version("rotorid"),
            name=result.name,
            log=_log(result),
            vehicle=result.log.vehicle,
            flight=_flown(result),
            config=result.config,
            verdict=overall(models),
            rmse=tuple(row for model in models for row in model.rmse),
            models=tuple(models),
            thrust=present(result.thrust),
            parameters=None if isinstance(result.parameters, Failure) else parameter_rows(result.parameters),
            trajectory=_trajectory(result),
            coverage=present(result.coverage),
            account=present(result.account),
            rotation=present(result.rotation),
            answer=present(result.answer),
            advice=result.advice,
            findings=gathered(result.findings),
            missing=result.missing,
            timings_s=result.timings,
        ),
        FlightReport,
        printable,
    )


def craft_report(group: GroupResult) -> CraftReport:
    """Gather what is known of one craft from several flights; whatever is not finite becomes None."""
    coverage = present(group.coverage)
    outside = set() if coverage is None else {each.flight for each in coverage.outside}
    models = [model_report(each, "joint", craft=group.name, outside=outside) for each in group.models]
    return cleaned(
        CraftReport(
            rotorid=version("rotorid"),
            name=group.name,
            vehicle=group.vehicle,
            training=group.training,
            held_out=group.held_out,
            split=group.split,
            verdict=overall(models),
            rmse=tuple(row for model in models for row in model.rmse),
            models=tuple(models),
            thrust=present(group.thrust),
            parameters=None if isinstance(group.parameters, Failure) else parameter_rows(group.parameters),
            coverage=coverage,
            drift=present(group.drift),
            autopilot=group.autopilot,
            advice=group.advice,
            findings=gathered(group.findings),
            missing=group.missing,
            timings_s=group.timings,
        ),
        CraftReport,
        printable,
    )


def models_file(result: FlightResult | GroupResult) -> ModelsFile:
    """Gather the fitted models with every coefficient and its covariance: what models.json holds."""
    owned = OwnedModels(
        name=result.name,
        models={each.key: each.model.record() for each in result.models if not isinstance(each.model, Failure)},
        thrust=present(result.thrust),
        parameters=None if isinstance(result.parameters, Failure) else parameter_rows(result.parameters),
        missing={each.key: each.missing for each in result.models if isinstance(each.model, Failure)}
        | {key: result.missing[key] for key in ("experiment", "thrust", "parameters") if key in result.missing},
    )
    own = isinstance(result, FlightResult)
    file = ModelsFile(rotorid=version("rotorid"), joint=() if own else (owned,), flights=(owned,) if own else ())
    return cleaned(file, ModelsFile, printable)


def model_report(
    result: ModelResult,
    scope: str,
    flight: str | None = None,
    craft: str | None = None,
    outside: Collection[str] = (),
) -> ModelReport:
    """Gather one of several models with what it is worth."""
    rows = _rmse_rows(result, scope, flight, craft)
    record = None if isinstance(result.model, Failure) else result.model.record()
    validation, orders = present(result.validation), present(result.orders)
    uses = uses_of(validation, present(result.model), outside)
    return ModelReport(
        key=result.key,
        title=result.title,
        note=result.note,
        verdict=uses.free_run.verdict,
        uses=uses,
        rmse=tuple(rows),
        rmse_average_m=average([row.rmse_m for row in rows if row.part == "held-out"]),
        horizons=tuple(_horizons(validation)),
        validation=None if validation is None else validation.report(),
        orders=None if orders is None else replace(orders, findings=()),
        coherence=_coherence(result.coherence),
        kind="" if record is None else str(record.__struct_config__.tag),
        model=None if record is None else _without_covariance(record),
        findings=gathered(result.findings),
        missing=result.missing,
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


def parameter_rows(found: PhysicalParameters) -> tuple[ParameterRow, ...]:
    """List physical parameters, a row for each parameter and method."""
    return cleaned(found.table.reset_index().to_dict("records"), tuple[ParameterRow, ...])


def _coherence(found: Coherence | Failure | None) -> CoherenceReport | None:
    """Sum a coherence up over the frequencies at which a multirotor answers; or say why there is none."""
    if found is None:
        return None
    if isinstance(found, Failure):
        return CoherenceReport(missing=found.reason)
    return CoherenceReport(
        band_rad_s=BAND,
        inputs=found.input_names,
        averages=found.averages,
        chance=found.threshold,
        outputs=in_band(found) or dict.fromkeys(found.output_names, Linearity()),
    )


def overall(models: Sequence[ModelReport]) -> Verdict:
    """Sum the verdicts up over all models that there are."""
    there = [model for model in models if model.model is not None]
    return summarise(
        {model.title: model.verdict for model in there}, {model.title: model.uses.prediction for model in there}
    )


def _horizons(validation: Validation | None) -> list[HorizonRow]:
    """Average the horizon curve over the records that the model has not seen; empty when it has seen all."""
    if validation is None or not validation.unseen or validation.horizons.empty:
        return []
    table = validation.horizons[~validation.horizons["trained"].astype(bool)]
    errors = ["rmse", "rmse_constant_position", "rmse_constant_velocity"]
    means = table.groupby(["output", "horizon"], sort=False)[errors].mean().reset_index()
    return [
        HorizonRow(
            output=str(row["output"]),
            horizon_s=float(row["horizon"]),
            rmse_m=float(row["rmse"]),
            constant_position_m=float(row["rmse_constant_position"]),
            constant_velocity_m=float(row["rmse_constant_velocity"]),
        )
        for row in means.to_dict(orient="records")
    ]


def _log(result: FlightResult) -> LogReport:
    log = result.log
    return LogReport(
        file=log.path.name,
        bytes=log.size,
        sha256=log.sha256,
        format=log.format,
        duration_s=log.duration,
        start_utc=None if log.start_utc is None else log.start_utc.isoformat(),
        boots=log.boots,
        flights=log.flights,
        flight_number=result.number,
        flight_count=result.of,
    )


def _flown(result: FlightResult) -> FlownReport | None:
    span, account = result.flight, present(result.account)
    if isinstance(span, Failure):
        return None
    read = [None] * 3 if account is None else [account.height, account.distance, account.ground_speed]
    height, distance, speed = (None if each is None else each.value for each in read)
    return FlownReport(
        start_s=span.start,
        stop_s=span.stop,
        duration_s=span.duration,
        modes=tuple(mode_spans(result)),
        height_m=height,
        distance_m=distance,
        speed_max_m_s=speed,
    )


def mode_spans(result: FlightResult) -> list[ModeSpan]:
    """List the flight modes with the time that each was in force, within the analysed flight."""
    if result.modes is None or isinstance(result.flight, Failure) or result.modes.empty:
        return []
    start, stop = result.flight.start, result.flight.stop
    times = result.modes.index.to_numpy(dtype=float)
    names = [str(name) for name in result.modes["mode"]]
    spans: list[ModeSpan] = []
    for name, begin, end in zip(names, times, [*times[1:], math.inf], strict=True):
        begin, end = max(float(begin), start), min(float(end), stop)
        if end <= begin:
            continue
        if spans and spans[-1].mode == name:
            spans[-1] = replace(spans[-1], stop_s=end)
        else:
            spans.append(ModeSpan(mode=name, start_s=begin, stop_s=end))
    return spans


def _rmse_rows(result: ModelResult, scope: str, flight: str | None, craft: str | None) -> list[RmseRow]:
    """Turn a validation's table (a row for each record and output) into a row for each record, held-out ones first."""
    validation = present(result.validation)
    if validation is None:
        return []
    spans = {prediction.experiment.name: prediction.span for prediction in result.predictions}
    rows = []
    for record, table in validation.table.groupby("flight", sort=False):
        by_output = table.set_index("output")
        errors = {
            name: {str(output): float(error) for output, error in by_output[name].items()}
            for name in ("rmse", "fit_percent", "rmse_mean", "rmse_constant_position")
        }
        span = spans.get(str(record))
        rows.append(
            RmseRow(
                flight=flight or str(record),
                scope=scope,
                model=result.key,
                craft=craft,
                part="training" if bool(by_output["trained"].iloc[0]) else "held-out",
                start_s=None if span is None else span.start,
                duration_s=None if span is None else span.duration,
                rmse_m=errors["rmse"],
                fit_percent=errors["fit_percent"],
                rmse_mean_m=errors["rmse_mean"],
                rmse_constant_position_m=errors["rmse_constant_position"],
                scored_from_s=float(by_output["scored_from"].iloc[0]),
            )
        )
    return sorted(rows, key=lambda row: row.part == "training")


def _trajectory(result: FlightResult) -> TrajectoryReport | None:
    trajectory = result.trajectory
    if isinstance(trajectory, Failure):
        return None
    span = present(result.flight) or Span(-math.inf, math.inf)
    sigma = trajectory.sigma.loc[span.start : span.stop].median()
    return TrajectoryReport(
        method=trajectory.method,
        origin=OriginReport(
            latitude_deg=math.degrees(trajectory.origin.lat),
            longitude_deg=math.degrees(trajectory.origin.lon),
            altitude_m=trajectory.origin.alt,
        ),
        sigma_median={str(name): float(value) for name, value in sigma.items()},
        diagnostics=dict(trajectory.diagnostics),
    )
