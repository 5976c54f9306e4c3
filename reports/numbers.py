"""Results as one plain structure of numbers and text: what report.json holds and every page and table is drawn from."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from pipeline.flight.excitation import BAND, in_band
from pipeline.flight.purposes import PredictionUse, Trust, uses_of
from pipeline.flight.verdict import Verdict, assess, summarise
from pipeline.names import printable
from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult, ModelResult, Span
from reports.rows import Numbers, average, held_out

if TYPE_CHECKING:
    from logparse import Finding, Vehicle
    from pipeline.results.health import FlightHealth
    from sysid import Model, PhysicalParameters, Validation
    from sysid.records.excitation import Coherence


def flight_numbers(result: FlightResult) -> Numbers:
    """Gather what is known of one log; whatever is not finite becomes None."""
    models = [
        model_numbers(each, "own", "the held-out last part of the flight", flight=result.name) for each in result.models
    ]
    return plain(
        {
            "kind": "flight",
            "rotorid": version("rotorid"),
            "name": result.name,
            "log": _log(result),
            "vehicle": _vehicle(result.log.vehicle),
            "flight": _flight(result),
            "config": _config(result),
            "verdict": overall(models),
            "rmse": [row for model in models for row in model["rmse"]],
            "models": models,
            "thrust": None if result.thrust is None else result.thrust.to_dict(),
            "parameters": _parameters(result.parameters),
            "trajectory": _trajectory(result),
            "coverage": None if result.coverage is None else result.coverage.to_dict(),
            "health": _health(result.health),
            "rotation": None if result.rotation is None else result.rotation.to_dict(),
            "loops": None if result.loops is None else result.loops.to_dict(),
            "answer": None if result.answer is None else result.answer.to_dict(),
            "advice": [each.to_dict() for each in result.advice],
            "findings": _findings(result.findings),
            "missing": dict(result.missing),
            "timings_s": dict(result.timings),
        }
    )


def group_numbers(group: GroupResult) -> Numbers:
    """Gather what is known of one craft from several flights; whatever is not finite becomes None."""
    outside = {each.flight for each in group.coverage.outside} if group.coverage is not None else set()
    models = [
        model_numbers(each, "joint", "flights that it was not fitted to", craft=group.name, outside=outside)
        for each in group.models
    ]
    return plain(
        {
            "kind": "craft",
            "rotorid": version("rotorid"),
            "name": group.name,
            "vehicle": _vehicle(group.vehicle),
            "training": list(group.training),
            "held_out": list(group.held_out),
            "split": group.split,
            "verdict": overall(models),
            "rmse": [row for model in models for row in model["rmse"]],
            "models": models,
            "thrust": None if group.thrust is None else group.thrust.to_dict(),
            "parameters": _parameters(group.parameters),
            "coverage": None if group.coverage is None else group.coverage.to_dict(),
            "drift": None if group.drift is None else group.drift.to_dict(),
            "advice": [each.to_dict() for each in group.advice],
            "findings": _findings(group.findings),
            "missing": dict(group.missing),
            "timings_s": dict(group.timings),
        }
    )


def models(result: FlightResult | GroupResult) -> Numbers:
    """Gather the fitted models with every coefficient and its covariance: what models.json holds."""
    own = isinstance(result, FlightResult)
    owner = _models(result.name, result)
    return plain({"rotorid": version("rotorid"), "joint": [] if own else [owner], "flights": [owner] if own else []})


def _models(name: str, result: FlightResult | GroupResult) -> Numbers:
    return {
        "name": name,
        "models": {each.key: each.model.to_dict() for each in result.models if each.model is not None},
        "thrust": None if result.thrust is None else result.thrust.to_dict(),
        "parameters": _parameters(result.parameters),
        "missing": {each.key: each.missing for each in result.models if each.model is None}
        | {
            stage: reason for stage, reason in result.missing.items() if stage in ("experiment", "thrust", "parameters")
        },
    }


def model_numbers(
    result: ModelResult,
    scope: str,
    unseen: str,
    flight: str | None = None,
    craft: str | None = None,
    outside: Collection[str] = (),
) -> Numbers:
    """Gather one of several models with what it is worth.

    Parameters
    ----------
    result : ModelResult
    scope : str
    unseen : str
        What judged it, in words.
    flight, craft : str, optional
    outside : collection of str
        Held-out flights that leave the envelope of those fitted.
    """
    rows = _rmse_rows(result, scope, flight, craft)
    verdict = assess(result.validation, unseen, outside)
    return {
        "key": result.key,
        "title": result.title,
        "note": result.note,
        "verdict": {"trust": str(verdict.trust), "sentence": verdict.sentence},
        "uses": uses_of(result.validation, result.model, outside).to_dict(),
        "rmse": rows,
        "rmse_average_m": average(held_out({"rmse": rows})),
        "horizons": _horizons(result.validation),
        "validation": None if result.validation is None else result.validation.to_dict(),
        "orders": None if result.orders is None else result.orders.to_dict(),
        "coherence": _coherence(result.coherence),
        "model": None if result.model is None else _model_facts(result.model),
        "findings": _findings(result.findings),
        "missing": result.missing,
    }


def _parameters(found: PhysicalParameters | None) -> list[Numbers] | None:
    """List physical parameters, a row for each parameter and method."""
    if found is None:
        return None
    return [{str(name): value for name, value in row.items()} for row in found.table.reset_index().to_dict("records")]


def _coherence(found: Coherence | str | None) -> Numbers | None:
    """Sum a coherence up over the frequencies at which a multirotor answers; or say why there is none."""
    if found is None or isinstance(found, str):
        return None if found is None else {"missing": found}
    unknown = {"multiple_median": None, "above_chance": None}
    return {
        "band_rad_s": list(BAND),
        "inputs": list(found.input_names),
        "averages": found.averages,
        "chance": found.threshold,
        "outputs": in_band(found) or dict.fromkeys(found.output_names, unknown),
    }


def overall(models: Sequence[Numbers]) -> Numbers:
    """Sum the verdicts up over all models that there are."""
    verdicts = {
        model["title"]: Verdict(Trust(model["verdict"]["trust"]), model["verdict"]["sentence"])
        for model in models
        if model["model"] is not None
    }
    predictions = {
        model["title"]: PredictionUse(
            horizons=tuple(model["uses"]["prediction"]["horizons_s"]), errors=model["uses"]["prediction"]["rmse_m"]
        )
        for model in models
        if model["model"] is not None
    }
    verdict = summarise(verdicts, predictions)
    return {"trust": str(verdict.trust), "sentence": verdict.sentence}


def _horizons(validation: Validation | None) -> list[Numbers]:
    """Average the horizon curve over the records that the model has not seen; empty when it has seen all."""
    if validation is None or not validation.unseen or validation.horizons.empty:
        return []
    table = validation.horizons[~validation.horizons["trained"].astype(bool)]
    errors = ["rmse", "rmse_constant_position", "rmse_constant_velocity"]
    means = table.groupby(["output", "horizon"], sort=False)[errors].mean().reset_index()
    return [
        {
            "output": str(row["output"]),
            "horizon_s": float(row["horizon"]),
            "rmse_m": float(row["rmse"]),
            "constant_position_m": float(row["rmse_constant_position"]),
            "constant_velocity_m": float(row["rmse_constant_velocity"]),
        }
        for row in means.to_dict(orient="records")
    ]


def _log(result: FlightResult) -> Numbers:
    log = result.log
    return {
        "file": log.path.name,
        "bytes": log.size,
        "sha256": log.sha256,
        "format": log.format,
        "duration_s": log.duration,
        "start_utc": None if log.start_utc is None else log.start_utc.isoformat(),
        "boots": log.boots,
        "flights": [_span(flight) for flight in log.flights],
        "flight_number": result.number,
        "flight_count": result.of,
    }


def _vehicle(vehicle: Vehicle) -> Numbers:
    names = [name for name in vehicle.__slots__ if name != "motors"]
    motors = [{name: getattr(motor, name) for name in motor.__slots__} for motor in vehicle.motors]
    return {name: getattr(vehicle, name) for name in names} | {"motors": motors}


def _config(result: FlightResult) -> Numbers:
    return {name: getattr(result.config, name) for name in result.config.__slots__}


def _span(span: Span) -> Numbers:
    return {"start_s": span.start, "stop_s": span.stop, "duration_s": span.duration}


def _flight(result: FlightResult) -> Numbers | None:
    if result.flight is None:
        return None
    facts: Numbers = _span(result.flight)
    facts["modes"] = mode_spans(result)
    if result.trajectory is not None:
        states = result.trajectory.states.loc[result.flight.start : result.flight.stop]
        if len(states):
            north, east = (states[name] - states[name].iloc[0] for name in ("p_n", "p_e"))
            speed = np.linalg.norm(states[["v_n", "v_e", "v_d"]].to_numpy(), axis=1)
            facts["height_m"] = float(states["p_d"].iloc[0] - states["p_d"].min())
            if result.position_known:
                facts["distance_m"] = float(np.hypot(north, east).max())
                facts["speed_max_m_s"] = float(speed.max())
    return facts


def mode_spans(result: FlightResult) -> list[Numbers]:
    """List the flight modes with the time that each was in force, within the analysed flight."""
    if result.modes is None or result.flight is None or result.modes.empty:
        return []
    start, stop = result.flight.start, result.flight.stop
    times = result.modes.index.to_numpy(dtype=float)
    names = [str(name) for name in result.modes["mode"]]
    spans: list[Numbers] = []
    for name, begin, end in zip(names, times, [*times[1:], math.inf], strict=True):
        begin, end = max(float(begin), start), min(float(end), stop)
        if end <= begin:
            continue
        if spans and spans[-1]["mode"] == name:
            spans[-1]["stop_s"] = end
        else:
            spans.append({"mode": name, "start_s": begin, "stop_s": end})
    return spans


def _rmse_rows(result: ModelResult, scope: str, flight: str | None, craft: str | None) -> list[Numbers]:
    """Turn a validation's table (a row for each record and output) into a row for each record, held-out ones first."""
    if result.validation is None:
        return []
    spans = {prediction.experiment.name: prediction.span for prediction in result.predictions}
    rows = []
    for record, table in result.validation.table.groupby("flight", sort=False):
        by_output = table.set_index("output")
        span = spans.get(str(record))
        rows.append(
            {
                "flight": flight or str(record),
                "scope": scope,
                "model": result.key,
                "craft": craft,
                "part": "training" if bool(by_output["trained"].iloc[0]) else "held-out",
                "start_s": None if span is None else span.start,
                "duration_s": None if span is None else span.duration,
                "rmse_m": by_output["rmse"].to_dict(),
                "fit_percent": by_output["fit_percent"].to_dict(),
                "rmse_mean_m": by_output["rmse_mean"].to_dict(),
                "rmse_constant_position_m": by_output["rmse_constant_position"].to_dict(),
                "scored_from_s": float(by_output["scored_from"].iloc[0]),
            }
        )
    return sorted(rows, key=lambda row: row["part"] == "training")


def _model_facts(model: Model) -> Numbers:
    """Return a model without its findings, which stand beside it, and without covariances, which models.json has."""
    return {key: value for key, value in _without_covariance(model.to_dict()).items() if key != "findings"}


def _without_covariance(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_covariance(item) for key, item in value.items() if key != "covariance"}
    return value


def _trajectory(result: FlightResult) -> Numbers | None:
    trajectory = result.trajectory
    if trajectory is None:
        return None
    span = result.flight or Span(-math.inf, math.inf)
    sigma = trajectory.sigma.loc[span.start : span.stop].median()
    return {
        "method": trajectory.method,
        "origin": {
            "latitude_deg": math.degrees(trajectory.origin.lat),
            "longitude_deg": math.degrees(trajectory.origin.lon),
            "altitude_m": trajectory.origin.alt,
        },
        "sigma_median": {str(name): float(value) for name, value in sigma.items()},
        "diagnostics": dict(trajectory.diagnostics),
    }


def _health(health: FlightHealth | None) -> Numbers | None:
    """List the events of a flight in the order of time, and which part of it serves models."""
    if health is None:
        return None
    return {
        "events": [
            {
                "id": event.id,
                "t_s": event.t,
                "end_s": event.end,
                "severity": str(event.severity),
                "reason": event.reason,
                "advice": event.advice,
                "evidence": dict(event.evidence),
                "source": event.source,
            }
            for event in health.events
        ],
        "sound": None if health.sound is None else _span(health.sound),
        "motors_missing": health.motors_missing,
    }


def _findings(findings: Iterable[Finding]) -> list[Numbers]:
    """List findings, worst first, each once."""
    worst = ("error", "warning", "info")
    once = {(finding.id, finding.reason): finding for finding in findings}.values()
    return [finding.to_dict() for finding in sorted(once, key=lambda finding: worst.index(finding.severity))]


def plain(numbers: Numbers) -> Numbers:
    """Reduce a structure to what JSON and UTF-8 can say: no NumPy types, no tuples, None for NaN and infinities."""
    return {str(key): _plain(item) for key, item in numbers.items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, (list, tuple, set, frozenset)):
        return [_plain(item) for item in value]
    if isinstance(value, (bool, np.bool_)) or value is None:
        return None if value is None else bool(value)
    if isinstance(value, (int, np.integer)):
        return int(value)
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, complex):
        return [_plain(value.real), _plain(value.imag)]
    return printable(str(value))
