"""From the flights of one craft to everything that its autopilot can be told: what models, gains and the stick say."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from core.parameter import Parameter
from estimation import estimate
from logparse import FlightLog, GivenLogs, RotoridError, logs_of
from logparse.craft.quadplane import own_names
from sysid.autopilot.drag import NAMES as DRAG
from sysid.autopilot.drag import drag_values
from sysid.autopilot.motor_lines import NoBatchesError
from sysid.autopilot.notches import NAMES as NOTCH
from sysid.autopilot.notches import notch_study, notch_values
from sysid.autopilot.thrust_curve import NAMES as THRUST
from sysid.autopilot.thrust_curve import thrust_values
from sysid.autopilot.values import AutopilotValue, AutopilotValues, ParameterFile, decided, refused
from sysid.frequency.axes import FrequencyError
from sysid.frequency.estimate import response
from sysid.frequency.excitation import find_chirps
from sysid.frequency.fit import fit
from sysid.frequency.rate_signals import sources_of
from sysid.loops.controller import AXES, LoopError
from sysid.loops.loop import RateLoop, rate_loop
from sysid.loops.same_craft import other_craft, other_load
from sysid.loops.settings import firmware_version
from sysid.loops.tuning import Tuning, tune, without_copies
from sysid.records.experiment import Experiment
from sysid.rigid_body.body_fit import fit_rigid_body
from sysid.rigid_body.model import RigidBodyModel

#: Largest sigma of a feed-forward that is set, as a part of it.
_KNOWN = 0.05

#: Highest feed-forward that ArduPilot documents, which yaw needs more than: its torque is weak.
_DOCUMENTED = 0.02

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


def autopilot_values(logs: GivenLogs) -> AutopilotValues:
    """Propose parameters to the autopilot of a craft, each with its sigma and reason, or say why not.

    Parameters
    ----------
    logs : FlightLog, path-like, or a sequence of either
        Flights of one craft with ArduPilot.

    Raises
    ------
    LoopError
        Where the logs are of another autopilot than ArduCopter 4.0 to 4.7, or of two craft.
    """
    flights = without_copies(logs_of(logs))
    if not flights:
        raise LoopError("no log was given")
    for log in flights:
        firmware_version(log)
        if other := other_craft(flights[0], log) or other_load(flights[0], log):
            raise LoopError(other)
    flown = flights[-1].parameters_flown
    fitted, records, failures = _records(flights)
    values: list[AutopilotValue] = []
    try:
        if not records:
            raise LoopError("; ".join(failures))
        values += body_values(fit_rigid_body(records), fitted, records, flown)
    except RotoridError as error:
        values += refused(THRUST, ParameterFile.ESC, flown, str(error))
        values += refused(DRAG, ParameterFile.WIND, flown, str(error))
    chirps = [log for log in flights if any(chirp.at_mixer for chirp in find_chirps(log))]
    values += batch_values(flights, chirps, flown)
    tuning = tune(chirps or flights)
    values += gain_values(tuning, flown)
    with_rates = [log for log in flights if log.tables.has("rates")]
    if with_rates:
        gains = gains_of_craft(with_rates, tuning)
        values += feed_forward(gains, flown)
        values += stick_values(tuning, gains, flown)
    values = [_in_names_of(flights[0].vehicle.firmware, value) for value in values]
    proposed = {value.file for value in values if value.proposed.value is not None}
    one_by_one = (
        f"{ParameterFile.GAINS} is for the loops as they flew: load it alone, or load the others and fly the chirps "
        "again."
    )
    remarks = failures + ([one_by_one] if ParameterFile.GAINS in proposed and len(proposed) > 1 else [])
    return AutopilotValues(tuple(log.name for log in flights), tuple(values), tuple(remarks))


def _in_names_of(firmware: str | None, value: AutopilotValue) -> AutopilotValue:
    """Return a value whose parameters the firmware itself knows."""
    reason = own_names(value.proposed.reason, firmware)
    return replace(value, name=own_names(value.name, firmware), proposed=replace(value.proposed, reason=reason))


def batch_values(
    flights: Sequence[FlightLog], chirps: Sequence[FlightLog], flown: Mapping[str, float]
) -> list[AutopilotValue]:
    """Return the notch by the last flight whose batches show the motors' lines; else why the last one's do not."""
    loops: dict[str, RateLoop] = {}
    for axis in ("roll", "pitch") if any("ISBH" in log.messages for log in flights) else ():
        with suppress(RotoridError):
            loops[axis] = rate_loop(chirps, axis)
    errors: list[RotoridError] = []
    for log in reversed(flights):
        try:
            return notch_values(log, notch_study(log, loops), loops, flown)
        except RotoridError as error:
            errors.append(error)
    # Of flights without batches nothing more is to be said than that.
    why = next((error for error in errors if not isinstance(error, NoBatchesError)), errors[0])
    return refused(NOTCH, ParameterFile.MOTOR_NOTCH, flown, str(why))


def body_values(
    model: RigidBodyModel, logs: Sequence[FlightLog], records: Sequence[Experiment], flown: Mapping[str, float]
) -> list[AutopilotValue]:
    """Return what thrust and drag of an identified rigid body are to the autopilot; `records` are those of `logs`."""
    return [
        *thrust_values(model, logs, records, flown),
        *drag_values(model, records, firmware_version(logs[-1]), flown),
    ]


def _records(flights: Sequence[FlightLog]) -> tuple[list[FlightLog], list[Experiment], list[str]]:
    """Cut the records that a rigid body is fitted to; return their logs, them, and why a flight gives none."""
    logs, records, failures = [], [], []
    for log in flights:
        try:
            records.append(Experiment.from_flight(log, estimate(log.tables, date=log.start_utc), 50.0))
            logs.append(log)
        except RotoridError as error:
            failures.append(str(error))
    return logs, records, failures


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
            why = f"one over the craft's gain, {gain}"
            if 1.0 / gain.value > _DOCUMENTED:
                why += f"; beyond the {_DOCUMENTED:g} that is documented, of which ground stations warn"
            inverse = Parameter(1.0 / gain.value, gain.sigma / gain.value**2, "", why)
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
    """Return the bound, or that the value flown keeps it."""
    if kept:
        return refused([name], ParameterFile.GAINS, flown, f"within {bound}, {bound.reason}", right=True)
    return decided({name: bound}, ParameterFile.GAINS, flown)
