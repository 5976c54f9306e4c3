"""What a log, or several, say of every axis: responses, fits, attitude; or why they say nothing.

And what the command of one axis does to another: roll that pitches, pitch that rolls. Of a symmetric craft nothing; a
centre of gravity or a flight controller that sits askew, motors that pull unequally or arms of another length make it.
Both commands are inputs of the axis that should not answer, so that what its own controller does against the coupling
does not count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations
from typing import TypeVar

import numpy as np

from core.parameter import Parameter
from logparse import Finding, GivenLogs, Severity
from sysid.frequency.axes import AXES, Axis, FrequencyError, axis_of
from sysid.frequency.closed_loop import AttitudeResponse, attitude_response
from sysid.frequency.estimate import response, response_of_records
from sysid.frequency.excitation import Within, find_chirps
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.flight_records import chirp_record, flight_record
from sysid.frequency.rate_signals import LogSignals, sources_of
from sysid.frequency.records import AxisRecord
from sysid.frequency.response import COHERENT, FrequencyResponse
from sysid.frequency.time_domain import Verification, hold_out

#: Frequencies that two responses must have in common to be compared, and part of the gain by which flights of a craft
#: differ: outputs are compensated for battery and density to a few percent.
_COMPARED, _UNLIKE = 8, 0.05

Found = TypeVar("Found")


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSurvey:
    """What is known of one axis."""

    axis: str
    response: FrequencyResponse | None  #: From controller output to rate or acceleration.
    fit: FrequencyFit | None
    attitude: AttitudeResponse | None  #: From target to attitude; None for the vertical axis.
    reason: str  #: Why there is no response or no fit; empty where there are both.
    attitude_reason: str  #: Why there is no attitude response; empty where there is.
    check: Verification | None = None  #: On flying that was held out.
    check_reason: str = ""  #: Why nothing could be held out; empty where there is a check, or nothing to check.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Coupling:
    """How strongly the command of one axis turns the craft about another."""

    axis: str  #: That is commanded.
    other: str  #: That should not answer.
    #: Angular acceleration about the other axis in parts of that about the own one, with its sign; near zero for a
    #: symmetric craft.
    ratio: Parameter
    response: FrequencyResponse = field(repr=False)  #: From the command to the rate about the other axis.

    @property
    def significant(self) -> bool:
        """Return whether it is more than its error could be, three standard deviations."""
        known = self.ratio
        return known.value is not None and known.sigma is not None and abs(known.value) > 3.0 * known.sigma


@dataclass(frozen=True, slots=True)
class FrequencySurvey:
    """All axes of one craft."""

    names: tuple[str, ...]  #: Of the logs.
    axes: tuple[AxisSurvey, ...]
    couplings: tuple[Coupling, ...] = ()  #: Of roll and pitch, where both were asked for and are known.
    #: Of several logs the responses of each by itself, with its name.
    single: tuple[tuple[str, FrequencyResponse], ...] = ()
    findings: tuple[Finding, ...] = ()  #: What is strange about the logs as one craft.


def survey(logs: GivenLogs, axes: Sequence[str] = tuple(AXES), within: Within | None = None) -> FrequencySurvey:
    """Estimate what can be had of each axis from logs of one craft."""
    given = sources_of(logs, within)
    surveys = tuple(_axis(given, axis) for axis in axes)
    alone = [(log, axis) for log in given for axis in axes] if len(given) > 1 else []
    tried = [(log.log.name, _tried(partial(response, log, axis))[0]) for log, axis in alone]
    single = tuple((name, frf) for name, frf in tried if frf is not None)
    couplings = tuple(_couplings(given, surveys))
    return FrequencySurvey(
        tuple(signals.log.name for signals in given), surveys, couplings, single, tuple(_differing(single))
    )


def _differing(single: Sequence[tuple[str, FrequencyResponse]]) -> Iterator[Finding]:
    """Warn of axes whose gain differs between logs by more than batteries and trims make it."""
    for axis in dict.fromkeys(frf.axis for _, frf in single):
        mine = [(name, frf) for name, frf in single if frf.axis == axis]
        source = mine[0][1].source
        worst = (0.0, "", "")
        for (first, one), (second, other) in combinations([entry for entry in mine if entry[1].source == source], 2):
            apart = np.log(np.abs(one.response)) - np.log(np.abs(other.at(one.hz)))
            both = (
                one.usable & np.isfinite(apart) & (np.interp(one.hz, other.hz, other.coherence, 0.0, 0.0) >= COHERENT)
            )
            if np.count_nonzero(both) < _COMPARED:
                continue
            middle = float(np.median(apart[both]))
            # Errors of neighbouring frequencies go together: no more than the median error is gained by many.
            error = float(np.hypot(np.median(one.sigma[both]), _UNLIKE))
            if abs(middle) > max(3.0 * error, abs(worst[0])):
                worst = (middle, first, second)
        if worst[0]:
            yield Finding(
                "flights-not-alike",
                Severity.WARNING,
                f"The {axis} gain of {worst[1]} is {100.0 * (np.exp(worst[0]) - 1.0):+.0f} % from that of {worst[2]}: "
                "their sum is the response of neither.",
                "Give logs of one craft with one load; look at the curves of each.",
                {"axis": axis, "apart": worst[0]},
            )


def _tried(make: Callable[[], Found]) -> tuple[Found | None, str]:
    """Return what is made, or why it is not."""
    try:
        return make(), ""
    except FrequencyError as error:
        return None, str(error)


def _couplings(logs: Sequence[LogSignals], surveys: Sequence[AxisSurvey]) -> Iterator[Coupling]:
    """Estimate the coupling of roll and pitch, where the response of both to their own command is known."""
    known = {entry.axis: entry.response for entry in surveys if entry.fit is not None and entry.response is not None}
    for axis, other in (("roll", "pitch"), ("pitch", "roll")):
        if axis in known and other in known:
            records = [record for log in logs for record in _records(log, AXES[axis], AXES[other])]
            across = replace(AXES[other], input=AXES[axis].input)
            with suppress(FrequencyError):
                cross = response_of_records(records, across, gyro_filter_hz=known[axis].gyro_filter_hz, refined=False)
                yield Coupling(axis=axis, other=other, ratio=_ratio(known[axis], cross), response=cross)


def _ratio(own: FrequencyResponse, cross: FrequencyResponse) -> Parameter:
    """Average the ratio of two responses over frequency; it is real where both have the same lag."""
    mine = own.at(cross.hz)
    coherent = np.interp(cross.hz, own.hz, own.coherence, 0.0, 0.0) >= 0.6
    known = coherent & np.isfinite(mine) & np.isfinite(cross.sigma) & (np.abs(cross.response) > 0.0)
    counts = cross.weight_of_points[known]
    if float(np.sum(counts)) < 4.0:
        return Parameter(None, None, "1", "too few frequencies at which the axis answers its own command")
    ratio = cross.response[known] / mine[known]
    deviation = cross.sigma[known] * np.abs(ratio)
    weight = counts / deviation**2
    mean = float(np.sum(weight * ratio.real) / np.sum(weight))
    rest = np.abs(ratio - mean) ** 2 / (2.0 * deviation**2)
    excess = max(1.0, float(np.sum(counts * rest) / max(float(np.sum(counts)) - 1.0, 1.0)))
    sigma = float(np.sqrt(excess / np.sum(weight)))
    if sigma > 0.3:
        return Parameter(None, None, "1", f"{mean:.2f} ± {sigma:.2f}: too uncertain to be of use")
    return Parameter(mean, sigma, "1")


def _records(source: LogSignals, commanded: Axis, answering: Axis) -> list[AxisRecord]:
    """Cut records with the command looked at as first input and that of the answering axis as second."""
    signals, log = source.of(answering), source.log
    if any(name not in signals.columns for name in (commanded.input, answering.input, answering.output)):
        return []
    names = {commanded.name, answering.name}
    pair = [chirp for chirp in find_chirps(log, source.within) if chirp.worthwhile and chirp.axis in names]
    try:
        if pair:
            both_flown = {chirp.axis for chirp in pair} == names
            return [chirp_record(log, signals, answering, chirp, [commanded]) for chirp in pair] if both_flown else []
        first, second = (flight_record(source, source.of(axis), axis) for axis in (commanded, answering))
    except FrequencyError:
        return []
    if first.start != second.start or len(first.output) != len(second.output):
        return []
    inputs, instruments = (
        np.column_stack([getattr(record, name)[:, 0] for record in (first, second)])
        for name in ("inputs", "instruments")
    )
    return [replace(second, inputs=inputs, instruments=instruments)]


def _axis(logs: Sequence[LogSignals], axis: str) -> AxisSurvey:
    model: FrequencyFit | None = None
    check: Verification | None = None
    check_reason = ""
    turns = bool(axis_of(axis).attitude)
    frf, reason = _tried(lambda: response(logs, axis))
    if frf is not None:
        model, reason = _tried(partial(fit, frf))
    if model is not None and model.parameters["gain"].value is not None:
        check, check_reason = _tried(partial(hold_out, model, logs))
    attitude, attitude_reason = _tried(lambda: attitude_response(logs, axis)) if turns else (None, "")
    return AxisSurvey(
        axis=axis,
        response=frf,
        fit=model,
        attitude=attitude,
        reason=reason,
        attitude_reason=attitude_reason,
        check=check,
        check_reason=check_reason,
    )
