"""The numbers of a report one by one, with unit, error and provenance: what programs and assistants are answered."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from core.findings import Happening
from core.parameter import Parameter
from pipeline.results.drift import CraftReview
from pipeline.results.report import FlightReport
from pipeline.results.rotation import AxisRotation
from sysid.loops.known_margins import MARGINS, Margins

_UNKNOWN = "not determined"


@dataclass(frozen=True, slots=True, kw_only=True)
class Provenance:
    """Where a number comes from."""

    log: str  #: The file; empty for a number over several flights.
    flights: tuple[str, ...]
    #: Stretch of time on the log's boot clock, s; None where several flights or no flight were looked at.
    start_s: float | None
    stop_s: float | None
    method: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A number; `value` is None where `reason` says why it is not determined."""

    name: str
    value: float | None
    sigma: float | None  #: One standard deviation; None where none is known.
    unit: str
    provenance: Provenance
    reason: str = ""  #: "not determined: ..." where there is no value.


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthEvent:
    """What happened in a flight, when, and what to do about it."""

    id: str
    severity: str
    t_s: float | None  #: On the log's boot clock.
    end_s: float | None
    reason: str
    advice: str
    provenance: Provenance


def parameters_of(report: FlightReport) -> list[Quantity]:
    """List the physical parameters of a flight by every method, and how its loops turn it."""
    rows = [
        _quantity(report, row.parameter, row.value, row.sigma, row.unit, row.method, row.note)
        for row in report.parameters or ()
    ]
    if not rows:
        reason = report.missing.get("parameters", "the flight gives no physical parameters")
        rows.append(_quantity(report, "physical parameters", None, None, "", "all", reason))
    turning = report.rotation
    vertical = () if turning is None or turning.vertical is None else (turning.vertical,)
    for axis in () if turning is None else (*turning.axes, *vertical):
        if axis.rate is None:
            rows.append(_quantity(report, f"{axis.axis} rate response", None, None, "", "frequency", axis.reason))
            continue
        rows += [
            _estimate(report, f"{axis.axis} {name}", parameter, f"{axis.rate.method} fit of {axis.rate.structure}")
            for name, parameter in axis.rate.parameters.items()
        ]
    rows += [
        _estimate(report, f"{coupling.axis} to {coupling.other} coupling", coupling.ratio, "frequency")
        for coupling in (() if turning is None else turning.couplings)
    ]
    return rows


def margins_of(report: FlightReport) -> list[Quantity]:
    """List margins and bandwidths of each axis, computed from response and controller and measured by chirps."""
    axes = () if report.rotation is None else report.rotation.axes
    if not axes:
        reason = report.missing.get("rotation", "the log does not tell how the craft turns")
        return [
            _quantity(report, f"{axis} margins", None, None, "", "loops", reason) for axis in ("roll", "pitch", "yaw")
        ]
    return [row for axis in axes for row in _axis(report, axis)]


def _axis(report: FlightReport, axis: AxisRotation) -> Iterator[Quantity]:
    if axis.loop is None:
        reason = axis.loop_reason or axis.reason
        yield _quantity(report, f"{axis.axis} margins", None, None, "", "loops", reason)
    else:
        yield from _margins(report, axis.axis, "computed", axis.loop.computed)
        if axis.loop.measured is not None:
            yield from _margins(report, axis.axis, "measured", axis.loop.measured)
    if axis.attitude is None:
        reason = axis.attitude_reason or axis.reason
        yield _quantity(report, f"{axis.axis} attitude bandwidth", None, None, "", "attitude following", reason)
    else:
        following = axis.attitude
        yield _estimate(report, f"{axis.axis} attitude bandwidth", following.bandwidth, "attitude following")
        yield _estimate(report, f"{axis.axis} phase delay", following.phase_delay, "attitude following")


def _margins(report: FlightReport, axis: str, how: str, margins: Margins) -> Iterator[Quantity]:
    for name in MARGINS:
        yield _estimate(report, f"{axis} {name}", getattr(margins, name), f"margins {how}")


def predictions_of(report: FlightReport) -> list[Quantity]:
    """List how far ahead each model predicts, and how well there, judged on time that it was not fitted to."""
    quantities = []
    for model in report.models:
        use = model.uses.prediction
        reason = model.missing or use.sentence
        quantities.append(_quantity(report, f"{model.title}: horizon", use.horizon_s, None, "s", "held-out", reason))
        quantities += [
            _quantity(report, f"{model.title}: error in {output} there", error, None, "m", "held-out RMS", reason)
            for output, error in use.rmse_m.items()
        ]
    return quantities or [_quantity(report, "horizon", None, None, "s", "held-out", "no model was fitted")]


def answers_of(report: FlightReport) -> list[Quantity]:
    """List the answers of the first screen; the word is in the name, the explanation in the method."""
    lines = () if report.answer is None else report.answer.lines
    return [
        _quantity(report, f"{line.purpose}: {line.word}", line.value, line.sigma, line.unit, line.text, line.text)
        for line in lines
    ]


def health_of(report: FlightReport) -> list[HealthEvent]:
    """List what happened in a flight, and what the log and the fits had to say of it."""
    happenings = () if report.account is None else report.account.happenings
    return [
        HealthEvent(
            id=finding.id,
            severity=str(finding.severity),
            t_s=finding.t if isinstance(finding, Happening) else None,
            end_s=finding.end if isinstance(finding, Happening) else None,
            reason=finding.reason,
            advice=finding.advice,
            provenance=_provenance(report, where),
        )
        for findings, where in ((happenings, "account of the flight"), (report.findings, "findings"))
        for finding in findings
    ]


def craft_parameters(review: CraftReview) -> list[Quantity]:
    """List the parameters of a craft over its pooled flights: random-effects means of what each flight says."""
    drift = review.drift
    if drift is None:
        nothing = Provenance(log="", flights=review.pooled, start_s=None, stop_s=None, method="mean over flights")
        reason = f"{_UNKNOWN}: two flights with parameters are needed"
        return [Quantity(name="parameters", value=None, sigma=None, unit="", provenance=nothing, reason=reason)]
    rows = []
    for parameter in drift.parameters:
        place = Provenance(
            log="",
            flights=tuple(point.flight for point in parameter.flights),
            start_s=None,
            stop_s=None,
            method=f"{parameter.method}, random-effects mean over flights; {parameter.sentence}",
        )
        rows.append(
            Quantity(
                name=parameter.parameter,
                value=parameter.mean,
                sigma=parameter.mean_sigma,
                unit=parameter.unit,
                provenance=place,
            )
        )
    return rows


def _estimate(report: FlightReport, name: str, estimate: Parameter, method: str) -> Quantity:
    return _quantity(report, name, estimate.value, estimate.sigma, estimate.unit, method, estimate.reason)


def _quantity(
    report: FlightReport, name: str, value: float | None, sigma: float | None, unit: str, method: str, reason: str
) -> Quantity:
    why = "" if value is not None else f"{_UNKNOWN}: {reason}" if reason else _UNKNOWN
    place = _provenance(report, method)
    return Quantity(name=name, value=value, sigma=sigma, unit=unit, provenance=place, reason=why)


def _provenance(report: FlightReport, method: str) -> Provenance:
    flown = report.flight
    return Provenance(
        log=report.log.file,
        flights=(report.name,),
        start_s=None if flown is None else flown.start_s,
        stop_s=None if flown is None else flown.stop_s,
        method=method,
    )
