"""What a log, or several, say of every axis: responses, fits, attitude; or why they say nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from logparse import FlightLog
from sysid.frequency.axes import AXES, FrequencyError
from sysid.frequency.closed_loop import AttitudeResponse, attitude_response
from sysid.frequency.estimate import response
from sysid.frequency.excitation import Within
from sysid.frequency.fit import FrequencyFit, fit
from sysid.frequency.response import FrequencyResponse


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisSurvey:
    """What is known of one axis."""

    axis: str
    response: FrequencyResponse | None  #: From controller output to rate or acceleration.
    fit: FrequencyFit | None
    attitude: AttitudeResponse | None  #: From target to attitude; None for the vertical axis.
    reason: str  #: Why there is no response or no fit; empty where there are both.
    attitude_reason: str  #: Why there is no attitude response; empty where there is.

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
    return FrequencySurvey(tuple(log.name for log in given), tuple(_axis(given, axis, within) for axis in axes))


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
    if AXES[axis].attitude:
        try:
            attitude = attitude_response(logs, axis, within=within)
        except FrequencyError as error:
            attitude_reason = str(error)
    return AxisSurvey(
        axis=axis, response=frf, fit=found, attitude=attitude, reason=reason, attitude_reason=attitude_reason
    )
