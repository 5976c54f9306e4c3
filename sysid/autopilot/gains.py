"""Gains as `tune` proposes them, the feed-forward of the rate target's derivative and what the stick asks for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from core.parameter import Parameter
from logparse import FlightLog
from sysid.autopilot.values import AutopilotValue, ParameterFile, decided, refused
from sysid.frequency.axes import FrequencyError
from sysid.frequency.estimate import response
from sysid.frequency.fit import fit
from sysid.frequency.rate_signals import sources_of
from sysid.loops.controller import AXES
from sysid.loops.tuning import Tuning

#: Largest sigma of a feed-forward that is set, as a part of it.
_KNOWN = 0.05

#: Part of the mixer's room in hover that an acceleration asked for may take; the rest is for disturbances.
_ASKED = 0.5

#: Parameters of an axis' largest acceleration, and a rad/s^2 in their units: centidegrees, since ArduCopter 4.7
#: degrees. Yaw asks for a small part.
_ACCELERATIONS = {
    "ATC_ACCEL_R_MAX": ("roll", 100.0 * math.degrees(1.0)),
    "ATC_ACCEL_P_MAX": ("pitch", 100.0 * math.degrees(1.0)),
    "ATC_ACC_R_MAX": ("roll", math.degrees(1.0)),
    "ATC_ACC_P_MAX": ("pitch", math.degrees(1.0)),
}


def gains_of_craft(flights: Sequence[FlightLog], tuning: Tuning) -> dict[str, Parameter]:
    """Return the gain of each axis, rad/s^2 per unit of the controller's output, or why it is not determined."""
    gains, signals = {}, sources_of(flights)
    known = {item.axis: item.loop.frf for item in tuning.axes if item.loop is not None and item.loop.ordinary}
    for axis in AXES:
        try:
            gains[axis] = fit(known[axis] if axis in known else response(signals, axis)).parameters["gain"]
        except FrequencyError as error:
            gains[axis] = Parameter(None, None, "", str(error))
    return gains


def feed_forward(gains: Mapping[str, Parameter], flown: Mapping[str, float]) -> list[AutopilotValue]:
    """Return D_FF of each axis: the output that gives the angular acceleration asked for, one over the craft's gain.

    AC_PID adds D_FF times the derivative of the rate target, rad/s^2, to its output.
    """
    values: list[AutopilotValue] = []
    for axis, gain in gains.items():
        name = f"ATC_RAT_{AXES[axis]}_D_FF"
        if gain.value is None or gain.sigma is None or not gain.value > 0.0:
            values += refused([name], ParameterFile.D_FF, flown, gain.reason or "the gain is not above 0")
        elif gain.sigma > _KNOWN * gain.value:
            values += refused([name], ParameterFile.D_FF, flown, f"the craft's gain is known to {gain} only")
        else:
            inverse = Parameter(1.0 / gain.value, gain.sigma / gain.value**2, "", f"one over the craft's gain, {gain}")
            values += decided({name: inverse}, ParameterFile.D_FF, flown)
    return values


def gain_values(tuning: Tuning, flown: Mapping[str, float]) -> list[AutopilotValue]:
    """Return the gains that `tune` proposes, or why it proposes none."""
    if tuning.refused is not None:
        names = [f"ATC_RAT_{letters}_{term}" for letters in AXES.values() for term in "PID"]
        return refused(names, ParameterFile.GAINS, flown, tuning.refused)
    reasons = tuning.reasons()
    return [
        AutopilotValue(name, ParameterFile.GAINS, tuning.rollback.get(name), Parameter(value, None, "", reasons[name]))
        for name, value in sorted(tuning.proposed.items())
    ]


def stick_values(tuning: Tuning, gains: Mapping[str, Parameter], flown: Mapping[str, float]) -> list[AutopilotValue]:
    """Return limits of what the stick asks for, lower ones where motors or loops could not follow.

    A motor's thrust moves by half of the mixer's input of an axis (AP_MotorsMatrix), so that in hover at throttle h the
    input has room for 2 min(h, 1 - h); the stick is shaped with the time constant ATC_INPUT_TC.
    """
    values: list[AutopilotValue] = []
    hover = flown.get("MOT_THST_HOVER", 0.0)
    for name, (axis, unit) in _ACCELERATIONS.items():
        gain = gains[axis]
        if gain.value is None or gain.sigma is None or name not in flown or not 0.0 < hover < 1.0:
            continue
        asked = _ASKED * 2.0 * min(hover, 1.0 - hover)
        why = f"half of the acceleration that the motors have room for in hover, {100.0 * asked:.0f} %"
        most = Parameter(asked * unit * gain.value, asked * unit * gain.sigma, "", f"{why} of the craft's gain, {gain}")
        assert most.value is not None
        values += _bounded(name, most, flown, 0.0 < flown[name] <= most.value)
    loops = [axis.tuned or axis.loop for axis in tuning.axes if axis.axis in ("roll", "pitch")]
    crossovers = [hz for loop in loops if loop is not None and (hz := loop.margins.crossover_hz.value) is not None]
    shaped = flown.get("ATC_INPUT_TC", 0.0)
    if crossovers and shaped > 0.0:
        least = 0.5 / (math.pi * min(crossovers))
        why = f"with which the rate loops follow, that cross over at {min(crossovers):.1f} Hz"
        values += _bounded("ATC_INPUT_TC", Parameter(least, None, "", why), flown, shaped >= least)
    return values


def _bounded(name: str, bound: Parameter, flown: Mapping[str, float], kept: bool) -> list[AutopilotValue]:
    """Return that what flew keeps a bound, or the bound itself."""
    if kept:
        return refused([name], ParameterFile.GAINS, flown, f"within {bound}, {bound.reason}", right=True)
    return decided({name: bound}, ParameterFile.GAINS, flown)
