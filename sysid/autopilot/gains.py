"""Gains as `tune` proposes them, and the feed-forward of the rate target's derivative, as autopilot values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from core.parameter import Parameter
from logparse import FlightLog
from sysid.autopilot.values import AutopilotValue, ParameterFile, decided, refused
from sysid.frequency.survey import FrequencySurvey
from sysid.loops.controller import AXES
from sysid.loops.tuning import tune

#: Largest sigma of a feed-forward that is set, as a part of it.
_KNOWN = 0.05


def feed_forward(survey: FrequencySurvey, flown: Mapping[str, float]) -> list[AutopilotValue]:
    """Return D_FF of each axis: the output that gives the angular acceleration asked for, one over the craft's gain.

    AC_PID adds D_FF times the derivative of the rate target, rad/s^2, to its output.
    """
    values: list[AutopilotValue] = []
    for axis in survey.axes:
        name = f"ATC_RAT_{AXES[axis.axis]}_D_FF"
        gain = None if axis.fit is None else axis.fit.parameters["gain"]
        if gain is None or gain.value is None or gain.sigma is None or not gain.value > 0.0:
            why = axis.reason if gain is None else gain.reason or "the gain is not above 0"
            values += refused([name], ParameterFile.D_FF, flown, why)
        elif gain.sigma > _KNOWN * gain.value:
            values += refused([name], ParameterFile.D_FF, flown, f"the craft's gain is known to {gain} only")
        else:
            inverse = Parameter(1.0 / gain.value, gain.sigma / gain.value**2, "", f"one over the craft's gain, {gain}")
            values += decided({name: inverse}, ParameterFile.D_FF, flown)
    return values


def gain_values(logs: Sequence[FlightLog], flown: Mapping[str, float]) -> list[AutopilotValue]:
    """Return the gains that `tune` proposes, or why it proposes none."""
    found = tune(list(logs))
    if found.refused is not None:
        names = [f"ATC_RAT_{letters}_{term}" for letters in AXES.values() for term in "PID"]
        return refused(names, ParameterFile.GAINS, flown, found.refused)
    reasons = found.reasons()
    return [
        AutopilotValue(name, ParameterFile.GAINS, found.rollback.get(name), Parameter(value, None, "", reasons[name]))
        for name, value in sorted(found.proposed.items())
    ]
