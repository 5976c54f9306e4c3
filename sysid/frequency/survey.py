"""What a log, or several, say of every axis: responses, fits, attitude; or why they say nothing."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

from logparse import FlightLog
from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.closed_loop import AttitudeResponse, attitude_response
from sysid.frequency.coupling import Coupling, coupling
from sysid.frequency.estimate import response
from sysid.frequency.excitation import Within
from sysid.frequency.fit import FrequencyFit, fit
from sysid.frequency.response import FrequencyResponse
from sysid.frequency.time_domain import Verification, hold_out


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

    @property
    def determined(self) -> bool:
        """Return whether anything is known of any axis."""
        return any(axis.determined for axis in self.axes)


def survey(
    logs: FlightLog | Sequence[FlightLog], axes: Sequence[str] = tuple(AXES), within: Within | None = None
) -> FrequencySurvey:
    """Estimate what can be had of each axis from logs of one craft.

    Parameters
    ----------
    logs : FlightLog or sequence of FlightLog
    axes : sequence of str
    within : tuple of float, optional
        From when to when a log counts, s on its boot clock; default its longest flight, and chirps wherever they are.

    Raises
    ------
    FrequencyError
        For an axis that does not exist.
    """
    given = [logs] if isinstance(logs, FlightLog) else list(logs)
    found = tuple(_axis(given, axis, within) for axis in axes)
    single = _single(given, axes, within) if len(given) > 1 else ()
    return FrequencySurvey(tuple(log.name for log in given), found, _couplings(given, found, within), single)


def _single(
    logs: Sequence[FlightLog], axes: Sequence[str], within: Within | None
) -> tuple[tuple[str, FrequencyResponse], ...]:
    """Estimate the responses of each log by itself, to be compared."""
    found = []
    for log in logs:
        for axis in axes:
            with suppress(FrequencyError):
                found.append((log.name, response(log, axis, within)))
    return tuple(found)


def _couplings(logs: Sequence[FlightLog], found: Sequence[AxisSurvey], within: Within | None) -> tuple[Coupling, ...]:
    """Look at what roll and pitch do to each other, where the answer of both to their own command is known."""
    known = {each.axis: each.response for each in found if each.fit is not None and each.response is not None}
    couplings = []
    for axis, other in (("roll", "pitch"), ("pitch", "roll")):
        if axis in known and other in known:
            with suppress(FrequencyError):
                couplings.append(coupling(logs, known[axis], other, within))
    return tuple(couplings)


def _axis(logs: list[FlightLog], axis: str, within: Within | None) -> AxisSurvey:
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
