"""From a log to how its craft turns: frequency responses, attitude following, and margins of the loops."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core.findings import warning
from logparse import Finding, FlightLog, RotoridError, Severity
from pipeline.results.fleet import ResponseCurve
from pipeline.results.rotation import (
    LEAST_GAIN_DB,
    LEAST_PHASE_DEG,
    AttitudeFollowing,
    AxisCoupling,
    AxisMargins,
    AxisRotation,
    Check,
    FittedResponse,
    LoopState,
    Numbers,
    RotationResult,
    state_of,
)
from pipeline.results.span import Span
from sysid.frequency.axes import axis_of
from sysid.frequency.excitation import find_chirps
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.response import COHERENT, FrequencyResponse
from sysid.frequency.survey import AxisSurvey, Coupling, survey
from sysid.frequency.time_domain import Verification
from sysid.loops.as_flown import contradiction_of
from sysid.loops.controller import LoopError
from sysid.loops.evidence import (
    no_one_loop,
    oscillation,
    saturation,
    two_ways_apart,
    unfit_log,
    weak_band,
)
from sysid.loops.loop import RateLoop, ordinary_loop, rate_loop
from sysid.loops.settings import check_firmware, read_settings

#: The axes about which a craft turns.
AXES = ("roll", "pitch", "yaw")


def find_rotation(log: FlightLog, sound: Span) -> tuple[RotationResult, dict[str, RateLoop]]:
    """Estimate what a flight tells of each axis, and the loops that its chirps show.

    Whatever cannot be had is a reason in the result, not an error.
    """
    within = (sound.start, sound.stop)
    unfit = _unfit(log)
    contradicted = {} if unfit else {axis: reason for axis in AXES if (reason := _contradiction(log, axis))}
    surveyed = survey(log, (*AXES, "vertical"), within)
    *turning, vertical = surveyed.axes
    chirped = {chirp.axis for chirp in find_chirps(log, within) if chirp.at_mixer}
    loops = {} if unfit else {axis: _chirped_loop(log, axis, within) for axis in AXES if axis in chirped}
    axes = tuple(_axis(log, axis, loops.get(axis.axis), unfit or contradicted.get(axis.axis, "")) for axis in turning)
    limits = [finding for axis in turning if axis.response is not None for finding in axis.response.findings]
    rotation = RotationResult(
        axes=axes,
        vertical=turning_of(vertical),
        couplings=tuple(map(coupling_of, surveyed.couplings)),
        findings=(
            *(_not_flown(axis, reason) for axis, reason in contradicted.items()),
            *{(limit.id, limit.reason): limit for limit in limits}.values(),
            *_findings(axes),
        ),
    )
    return rotation, {axis: loop for axis, loop in loops.items() if isinstance(loop, RateLoop)}


def _chirped_loop(log: FlightLog, axis: str, within: tuple[float, float]) -> RateLoop | str:
    """Identify a loop from the chirps on its axis; or why it cannot be."""
    try:
        return rate_loop(log, axis, within)
    except RotoridError as error:
        return str(error)


def _unfit(log: FlightLog) -> str:
    """Return why a log cannot tell the margins of any loop; empty where it may."""
    try:
        # First, because firmware whose controller is not known is no firmware to fly a chirp with either.
        check_firmware(log)
    except LoopError as error:
        return str(error)
    return no_one_loop(log) or ""


def _contradiction(log: FlightLog, axis: str) -> str | None:
    """Return which parameters of an axis are not those that flew; None also where they are missing."""
    try:
        return contradiction_of(log, axis)
    except RotoridError:
        return None


def _not_flown(axis: str, reason: str) -> Finding:
    return warning(
        "parameters-not-flown",
        f"The margins of the {axis} loop are not computed: {reason}.",
        "Look at the parameters on the craft; another fault of the log (edited, or of two flights) looks the same.",
        axis=axis,
    )


def _axis(log: FlightLog, axis_survey: AxisSurvey, chirped: RateLoop | str | None, unfit: str) -> AxisRotation:
    turning = turning_of(axis_survey)
    if unfit:
        return replace(turning, loop_reason=unfit)
    try:
        return replace(turning, loop=_loop(log, axis_survey, chirped))
    except RotoridError as error:
        return replace(turning, loop_reason=str(error))


def turning_of(axis_survey: AxisSurvey) -> AxisRotation:
    """Return what a survey tells of an axis as part of a result, without its loop."""
    following = axis_survey.attitude
    return AxisRotation(
        axis=axis_survey.axis,
        rate=None
        if axis_survey.response is None
        else replace(
            fitted_response(axis_survey.response, axis_survey.fit),
            check=None if axis_survey.check is None else _check(axis_survey.check),
            check_reason=axis_survey.check_reason,
        ),
        reason=axis_survey.reason,
        attitude=None
        if following is None
        else AttitudeFollowing(
            bandwidth=following.bandwidth,
            phase_delay=following.phase_delay,
            peak=following.peak,
            response=fitted_response(following.frf, following.fit),
        ),
        attitude_reason=axis_survey.attitude_reason,
    )


def coupling_of(coupling: Coupling) -> AxisCoupling:
    """Return a coupling without the response that it was read from."""
    return AxisCoupling(
        axis=coupling.axis, other=coupling.other, ratio=coupling.ratio, significant=coupling.significant
    )


def curve_of(response: FittedResponse, flight: str) -> ResponseCurve:
    """Return the coherent part of a response, to be laid over those of other flights."""
    rows = zip(response.hz, response.gain_db, response.phase_deg, response.coherence, strict=True)
    known = [row[:3] for row in rows if None not in row and (row[3] or 0.0) >= COHERENT]
    hz, gain, phase = (tuple(float(row[k] or 0.0) for row in known) for k in range(3))
    return ResponseCurve(
        flight=flight,
        axis=response.axis,
        unit=response.unit,
        source=response.source,
        hz=hz,
        gain_db=gain,
        phase_deg=phase,
    )


def fitted_response(frf: FrequencyResponse, fit: FrequencyFit | None) -> FittedResponse:
    """Return a measured response, and the model fitted to it, as numbers over frequency."""
    good = frf.hz[frf.usable]
    known = np.isfinite(frf.sigma)
    response = FittedResponse(
        axis=frf.axis,
        input=frf.input,
        output=frf.output,
        unit=frf.unit,
        method=frf.method,
        instrument=frf.instrument,
        source=frf.source,
        seconds=frf.duration,
        band_hz=(float(good[0]), float(good[-1])) if len(good) else None,
        hz=_numbers(frf.hz),
        gain_db=_numbers(frf.gain_db),
        phase_deg=_numbers(np.degrees(frf.phase)),
        coherence=_numbers(frf.coherence),
        sigma=_numbers(frf.sigma),
        sigma_phase=_numbers(frf.sigma_phase),
        direct=_gain_and_phase(frf.direct, known) if frf.method == "instrument" else (),
    )
    if fit is None:
        return response
    return replace(
        response,
        model=_gain_and_phase(fit.response(frf.hz)),
        structure=fit.structure[0].name,
        parameters=dict(fit.parameters),
        insensitivity={name: float(value) for name, value in zip(fit.names, fit.insensitivity, strict=True)},
        cost=fit.cost,
        verdict=fit.verdict,
    )


def _gain_and_phase(response: NDArray[np.complex128], known: NDArray[np.bool_] | None = None) -> tuple[Numbers, ...]:
    """Return dB and degrees, None where a response is not known."""
    inside = np.ones(len(response), bool) if known is None else known
    gain, phase = np.full((2, len(response)), np.nan)
    gain[inside] = 20.0 * np.log10(np.maximum(np.abs(response[inside]), 1e-300))
    phase[inside] = np.degrees(np.unwrap(np.angle(response[inside])))
    return _numbers(gain), _numbers(phase)


def _numbers(values: NDArray[np.float64]) -> Numbers:
    return tuple(number if np.isfinite(number) else None for number in values.tolist())


def _check(verification: Verification) -> Check:
    residuals = "" if verification.residuals is None else verification.residuals.sentence
    return Check(
        seconds=verification.seconds,
        fit_percent=verification.fit_percent,
        theil=verification.theil,
        correlation=verification.correlation,
        residuals=residuals.partition(":")[0].partition(";")[0],
        verdict=verification.verdict,
    )


def _loop(log: FlightLog, axis_survey: AxisSurvey, loop: RateLoop | str | None) -> AxisMargins:
    """Compute the margins of a loop: of one that chirps showed in two ways where the log allows it.

    Without chirps they are those of the craft's model.

    RotoridError where the loop cannot be had, or what the log shows of it does not carry margins.
    """
    axis = axis_survey.axis
    oscillating = oscillation(log, axis)
    if oscillating:
        raise LoopError(oscillating)
    if loop is None:
        return _ordinary(log, axis_survey)
    if isinstance(loop, str):
        raise LoopError(loop)
    # Without PID messages neither limits nor the second way are seen; the margins stand, with that said.
    logged = f"PID{axis_of(axis).letter}" in log.messages
    doubts = (saturation(log, axis) if logged else None, weak_band(loop))
    apart = two_ways_apart(loop)
    refused = next((doubt for doubt in (*doubts, None if loop.measured is None else apart) if doubt), None)
    if refused:
        raise LoopError(refused)
    return AxisMargins(
        state=state_of(loop.margins),
        gains=loop.settings.parameters(),
        computed=loop.margins,
        measured=None if loop.measured is None else loop.measured_margins,
        remarks=(apart,) if apart else (),
    )


def _ordinary(log: FlightLog, axis_survey: AxisSurvey) -> AxisMargins:
    """Compute the margins of an axis without chirps from what sticks told of the craft; RotoridError if too little."""
    if axis_survey.response is None or axis_survey.fit is None:
        raise LoopError(unfit_log(log) or axis_survey.reason)
    frf = axis_survey.response
    try:
        settings = read_settings(log, axis_survey.axis)
    except LoopError as error:
        raise LoopError(unfit_log(log) or str(error)) from error
    loop = ordinary_loop(log.path.name, frf, axis_survey.fit, settings)
    remark = (
        f"from ordinary flying: the craft's model, known from {frf.hz[frf.usable][0]:.2g} to "
        f"{frf.hz[frf.usable][-1]:.2g} Hz, through the controller of the log's parameters"
    )
    limits = tuple(finding.reason for finding in frf.findings if finding.id == "motors-at-limits")
    return AxisMargins(
        state=state_of(loop.margins, ordinary=True),
        gains=loop.settings.parameters(),
        computed=loop.margins,
        ordinary=True,
        remarks=(remark, *limits, *settings.remarks),
    )


def _findings(axes: tuple[AxisRotation, ...]) -> Iterator[Finding]:
    """Warn of thin margins."""
    for axis in axes:
        if axis.loop is None:
            continue
        margins, state = axis.loop.computed, axis.loop.state
        known = {"gain_db": margins.gain_db.value, "phase_deg": margins.phase_deg.value}
        evidence: dict[str, str | int | float | bool] = {"axis": axis.axis, "unstable_part": margins.unstable}
        evidence |= {name: value for name, value in known.items() if value is not None}
        if state is LoopState.UNSTABLE:
            yield Finding(
                "loop-margins",
                Severity.ERROR,
                f"The {axis.axis} loop is unstable with the gains of this log, by the response that was measured.",
                "Do not fly these gains: restore the former ones, or lower P and D of this axis by half.",
                evidence,
            )
        elif state is LoopState.THIN:
            yield Finding(
                "loop-margins",
                Severity.WARNING,
                f"The {axis.axis} loop has a gain margin of {margins.gain_db} and a phase margin of "
                f"{margins.phase_deg}; {LEAST_GAIN_DB:.0f} dB and {LEAST_PHASE_DEG:.0f} deg are sound.",
                ("Fly chirps and let" if axis.loop.ordinary else "Let")
                + " rotorid tune propose gains; until then lower P and D of this axis by a quarter.",
                evidence,
            )
