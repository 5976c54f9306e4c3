"""What is kept of a flight: report.json and models.json, and the flight in short, from which a folder is coordinated.

Both are the typed results, of what JSON can hold alone. Parameters of a flight are light rows by which they are
followed over flights (`pipeline.fleet.drift`).
"""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.metadata import version

import numpy as np

from core.findings import apart
from core.serialization import cleaned
from logparse import Finding
from pipeline.flight.craft import build_of, craft_name
from pipeline.flight.identification import parameter_rows
from pipeline.flight.kinds import THRUST_KEY
from pipeline.flight.rotation import curve_of
from pipeline.names import printable
from pipeline.results.failure import Failure, present
from pipeline.results.fleet import FlightEntry, FlightParameter, ResponseCurve
from pipeline.results.flight import FlightResult, ModelResult
from pipeline.results.model import ModelsFile, OwnedModels, verdict_of
from pipeline.results.report import (
    CraftReport,
    FlightReport,
    FlownReport,
    ModeSpan,
    OriginReport,
    TrajectoryReport,
)
from pipeline.results.rotation import FittedResponse
from pipeline.results.span import Span
from sysid.records.thrust_curve import reference_voltage
from sysid.rigid_body.physical import HEADLINE, METHODS

#: Most rows of a track: they tell whether two logs recorded the same flight, and draw a small map.
TRACK_ROWS = 200


def flight_entry(
    result: FlightResult, *, folder: str = "", source: str = "", key: str = "", pages: str = ""
) -> FlightEntry:
    """Return a flight in short, with where its products are."""
    log, vehicle = result.log, result.vehicle
    models = {model.key: model.report.missing for model in result.models if model.report.missing}
    return FlightEntry(
        name=result.name,
        number=log.flight_number,
        of=log.flight_count,
        sha256=log.sha256,
        size=log.bytes,
        format=log.format,
        start_utc=log.started,
        duration=log.duration_s or 0.0,
        craft=result.craft,
        craft_name=craft_name(vehicle),
        frame_class=vehicle.frame_class,
        vehicle=partition(result.craft, vehicle.frame_class),
        flight=present(result.flight),
        origin=_origin(result),
        track=_track(result),
        position_known=result.position_known,
        experiments=tuple(result.experiments),
        missing={**models, **result.missing},
        coverage=present(result.coverage),
        board=result.board,
        build=build_of(vehicle),
        tune=dict(result.tune),
        parameters=tuple(flight_parameters(result)),
        responses=tuple(response_curves(result)),
        trims=result.trims,
        account=present(result.account),
        autopilot=result.autopilot,
        findings=_findings(result),
        folder=folder,
        source=source,
        key=key,
        pages=pages,
    )


def _findings(result: FlightResult) -> tuple[Finding, ...]:
    """List what the log and the fits had to say, each once."""
    findings = apart([*result.findings, *(finding for model in result.models for finding in model.report.findings)])
    return tuple({(finding.id, finding.reason): finding for finding in findings}.values())


def partition(craft: str, frame_class: str | None) -> str:
    """Name a craft so that folders and query engines take it: its frame and a short digest of its fingerprint."""
    frame = re.sub(r"[^a-z0-9-]+", "-", (frame_class or "craft").lower())
    return f"{frame}-{hashlib.sha256(craft.encode()).hexdigest()[:10]}"


def _origin(result: FlightResult) -> tuple[float, float, float] | None:
    if isinstance(result.trajectory, Failure):
        return None
    origin = result.trajectory.origin
    place = (float(origin.lat), float(origin.lon), float(origin.alt))
    return place if all(map(math.isfinite, place)) else None


def _track(result: FlightResult) -> tuple[tuple[float, float, float, float], ...]:
    """Thin the trajectory of the flight."""
    if isinstance(result.trajectory, Failure) or isinstance(result.flight, Failure):
        return ()
    states = result.trajectory.states.loc[result.flight.start : result.flight.stop, ["p_n", "p_e", "p_d"]]
    step = max(1, -(-len(states) // TRACK_ROWS))
    chosen = states.iloc[::step].reset_index().to_numpy(float)
    return tuple((t, *ned) for t, *ned in chosen.tolist() if all(map(math.isfinite, (t, *ned))))


#: The row with a flight's battery voltage carries this method.
BATTERY = "battery monitor"

#: A method whose column "sigma" is the spread over instants, not the standard error of the value.
_SPREAD = METHODS[2]

#: Refinement 2020 takes the air to be at rest: its drag is mostly the wind of the day.
WIND_AS_DRAG = ("whole drag in still air over mass", METHODS[3])


def flight_parameters(result: FlightResult) -> list[FlightParameter]:
    """List what a flight says about its craft, light rows by which parameters are followed over flights.

    Standard errors are those on this flight: scatter between flights holds what another day adds. That of mean thrust
    is without that of the thrust curve in the parameters, which is the same in all flights.
    """
    rows: list[FlightParameter] = []
    physical = result.parameters
    if not isinstance(physical, Failure):
        for key, row in zip(physical.table.index, physical.table.to_dict("records"), strict=True):
            parameter, method = (str(part) for part in key)
            value, sigma = float(row["value"]), float(row["sigma"])
            # The headline is one of the methods' own.
            if method in (_SPREAD, HEADLINE) or (parameter, method) == WIND_AS_DRAG:
                continue
            if not (np.isfinite([value, sigma]).all() and sigma > 0.0):
                continue
            thrust = None if physical.thrust is None else physical.thrust.common
            if method == METHODS[0] and thrust is not None and thrust.per_mass and thrust.sigma is not None:
                # All flights of a craft have the error of the curve in its parameters in common.
                sigma = thrust.sigma * value / thrust.per_mass
            rows.append(
                FlightParameter(parameter=parameter, method=method, value=value, sigma=sigma, unit=str(row["unit"]))
            )
    rows += _turning(result)
    record = result.experiments.get(THRUST_KEY)
    if record is not None and (volts := reference_voltage([record])) is not None:
        rows.append(FlightParameter(parameter="voltage", method=BATTERY, value=volts, sigma=0.01 * volts, unit="V"))
    return rows


def _turning(result: FlightResult) -> Iterator[FlightParameter]:
    """Yield how strongly and how late each axis answers; not what changes with the gains."""
    for axis, rate in _determined(result):
        source = rate.source or "rate controller"
        known = rate.parameters
        late = known["effective_delay"]
        for name, parameter in (("effectiveness", known["gain"]), ("delay", late)):
            if (
                parameter is not None
                and parameter.value is not None
                and parameter.sigma is not None
                and parameter.sigma > 0.0
            ):
                yield FlightParameter(
                    parameter=f"{axis} {name}",
                    method=f"frequency response, {source}",
                    value=parameter.value,
                    sigma=parameter.sigma,
                    unit=parameter.unit,
                )


def response_curves(result: FlightResult) -> Iterator[ResponseCurve]:
    """Yield the coherent part of the response of every axis whose gain is determined."""
    for _, rate in _determined(result):
        yield curve_of(rate, result.name)


def _determined(result: FlightResult) -> Iterator[tuple[str, FittedResponse]]:
    """Yield every axis whose gain is determined, with its response."""
    rotation = present(result.rotation)
    for axis in () if rotation is None else rotation.every:
        if axis.rate is not None and axis.rate_determined:
            yield axis.axis, axis.rate


def flight_report(result: FlightResult) -> FlightReport:
    """Gather what is known of one log; whatever is not finite becomes None."""
    models = tuple(model.report for model in result.models)
    return cleaned(
        FlightReport(
            rotorid=version("rotorid"),
            name=result.name,
            log=result.log,
            vehicle=result.vehicle,
            flight=_flown(result),
            config=result.config,
            verdict=verdict_of(models),
            rmse=tuple(row for model in models for row in model.rmse),
            models=models,
            thrust=present(result.thrust),
            parameters=parameter_rows(result.parameters),
            trajectory=_trajectory(result),
            coverage=present(result.coverage),
            account=present(result.account),
            rotation=present(result.rotation),
            answer=present(result.answer),
            advice=result.advice,
            findings=result.findings,
            missing=result.missing,
            timings_s=result.timings,
        ),
        FlightReport,
        printable,
    )


def models_file(report: FlightReport | CraftReport, models: Sequence[ModelResult]) -> ModelsFile:
    """Gather the fitted models with every coefficient and its covariance: what models.json holds."""
    owned = OwnedModels(
        name=report.name,
        models={model.key: model.model.record() for model in models if not isinstance(model.model, Failure)},
        thrust=report.thrust,
        parameters=report.parameters,
        missing={model.key: model.report.missing for model in models if isinstance(model.model, Failure)}
        | {key: report.missing[key] for key in ("experiment", "thrust", "parameters") if key in report.missing},
    )
    own = isinstance(report, FlightReport)
    file = ModelsFile(rotorid=version("rotorid"), joint=() if own else (owned,), flights=(owned,) if own else ())
    return cleaned(file, ModelsFile, printable)


def _flown(result: FlightResult) -> FlownReport | None:
    span, account = result.flight, present(result.account)
    if isinstance(span, Failure):
        return None
    read = [None] * 2 if account is None else [account.height, account.ground_speed]
    height, speed = (None if reading is None else reading.value for reading in read)
    return FlownReport(
        start_s=span.start,
        stop_s=span.stop,
        duration_s=span.duration,
        modes=tuple(mode_spans(result)),
        height_m=height,
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
