"""What a log, or several, say of every axis: responses, fits, attitude; or why they say nothing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from logparse import Finding, GivenLogs, Severity
from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.closed_loop import AttitudeResponse, attitude_response
from sysid.frequency.coupling import Coupling, coupling
from sysid.frequency.estimate import response
from sysid.frequency.excitation import Within
from sysid.frequency.fit import fit
from sysid.frequency.fitted import FrequencyFit
from sysid.frequency.rate_signals import LogSignals, sources_of
from sysid.frequency.response import COHERENT, FrequencyResponse
from sysid.frequency.time_domain import Verification, hold_out

#: Frequencies that two responses must have in common to be compared, and part of the gain by which flights of a craft
#: differ: outputs are compensated for battery and density to a few percent.
_COMPARED, _UNLIKE = 8, 0.05


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

    @property
    def determined(self) -> bool:
        """Return whether a gain, or a bandwidth with its delay, is known."""
        effective = self.fit is not None and self.fit.parameters["gain"].value is not None
        return effective or (self.attitude is not None and self.attitude.determined)


@dataclass(frozen=True, slots=True)
class FrequencySurvey:
    """All axes of one craft."""

    names: tuple[str, ...]  #: Of the logs.
    axes: tuple[AxisSurvey, ...]
    couplings: tuple[Coupling, ...] = ()  #: Of roll and pitch, where both were asked for and are known.
    #: Of several logs the responses of each by itself, with its name.
    single: tuple[tuple[str, FrequencyResponse], ...] = ()
    findings: tuple[Finding, ...] = ()  #: What is strange about the logs as one craft.

    @property
    def determined(self) -> bool:
        """Return whether anything is known of any axis."""
        return any(axis.determined for axis in self.axes)


def survey(logs: GivenLogs, axes: Sequence[str] = tuple(AXES), within: Within | None = None) -> FrequencySurvey:
    """Estimate what can be had of each axis from logs of one craft."""
    given = sources_of(logs, within)
    found = tuple(_axis(given, axis, within) for axis in axes)
    single = _single(given, axes, within) if len(given) > 1 else ()
    couplings = _couplings(given, found, within)
    return FrequencySurvey(tuple(each.log.name for each in given), found, couplings, single, tuple(_differing(single)))


def _differing(single: Sequence[tuple[str, FrequencyResponse]]) -> Iterator[Finding]:
    """Warn of axes whose gain differs between logs by more than batteries and trims make it."""
    for axis in dict.fromkeys(frf.axis for _, frf in single):
        mine = [(name, frf) for name, frf in single if frf.axis == axis]
        source = mine[0][1].source
        worst = (0.0, "", "")
        for (first, one), (second, other) in combinations([each for each in mine if each[1].source == source], 2):
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


def _single(
    logs: Sequence[LogSignals], axes: Sequence[str], within: Within | None
) -> tuple[tuple[str, FrequencyResponse], ...]:
    """Estimate the responses of each log by itself, to be compared."""
    found = []
    for log in logs:
        for axis in axes:
            with suppress(FrequencyError):
                found.append((log.log.name, response(log, axis, within)))
    return tuple(found)


def _couplings(logs: Sequence[LogSignals], found: Sequence[AxisSurvey], within: Within | None) -> tuple[Coupling, ...]:
    """Look at what roll and pitch do to each other, where the answer of both to their own command is known."""
    known = {each.axis: each.response for each in found if each.fit is not None and each.response is not None}
    couplings = []
    for axis, other in (("roll", "pitch"), ("pitch", "roll")):
        if axis in known and other in known:
            with suppress(FrequencyError):
                couplings.append(coupling(logs, known[axis], other, within))
    return tuple(couplings)


def _axis(logs: Sequence[LogSignals], axis: str, within: Within | None) -> AxisSurvey:
    frf: FrequencyResponse | None = None
    found: FrequencyFit | None = None
    attitude: AttitudeResponse | None = None
    reason = attitude_reason = ""
    if axis not in AXES:
        raise FrequencyError(f"there is no axis {axis!r}; the axes are {', '.join(AXES)}")
    try:
        frf = response(logs, axis, within)
        found = fit(frf)
    except FrequencyError as error:
        reason = str(error)
    check: Verification | None = None
    check_reason = ""
    if found is not None and found.parameters["gain"].value is not None:
        try:
            check = hold_out(found, logs, within)
        except FrequencyError as error:
            check_reason = str(error)
    if AXES[axis].attitude:
        try:
            attitude = attitude_response(logs, axis, within=within)
        except FrequencyError as error:
            attitude_reason = str(error)
    return AxisSurvey(
        axis=axis,
        response=frf,
        fit=found,
        attitude=attitude,
        reason=reason,
        attitude_reason=attitude_reason,
        check=check,
        check_reason=check_reason,
    )
