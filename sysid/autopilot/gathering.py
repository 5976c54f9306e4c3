"""From the flights of one craft to everything that its autopilot can be told."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

from estimation import estimate
from logparse import FlightLog, GivenLogs, RotoridError, logs_of
from logparse.craft.quadplane import own_names
from sysid.autopilot.drag import NAMES as DRAG
from sysid.autopilot.drag import drag_values
from sysid.autopilot.gains import feed_forward, gain_values, gains_of_craft, stick_values
from sysid.autopilot.motor_lines import NO_BATCHES
from sysid.autopilot.notches import NAMES as NOTCH
from sysid.autopilot.notches import notch_study, notch_values
from sysid.autopilot.thrust_curve import NAMES as THRUST
from sysid.autopilot.thrust_curve import thrust_values
from sysid.autopilot.values import AutopilotValue, AutopilotValues, ParameterFile, refused
from sysid.frequency.excitation import find_chirps
from sysid.loops.controller import LoopError
from sysid.loops.loop import RateLoop, rate_loop
from sysid.loops.same_craft import other_craft, other_load
from sysid.loops.settings import firmware_version
from sysid.loops.tuning import tune, without_copies
from sysid.records.experiment import Experiment
from sysid.rigid_body.body_fit import fit_rigid_body
from sysid.rigid_body.model import RigidBodyModel

#: What is said where gains are proposed beside what changes the loops.
_ONE_BY_ONE = (
    f"{ParameterFile.GAINS} is for the loops as they flew: load it alone, or load the others and fly the chirps again."
)


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
    values = [_in_names_of(flights[0].vehicle.firmware, each) for each in values]
    proposed = {each.file for each in values if each.proposed.value is not None}
    remarks = failures + ([_ONE_BY_ONE] if ParameterFile.GAINS in proposed and len(proposed) > 1 else [])
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
    reasons = []
    for log in reversed(flights):
        try:
            return notch_values(log, notch_study(log, loops), loops, flown)
        except RotoridError as error:
            reasons.append(str(error))
    # Of flights without batches nothing more is to be said than that.
    why = next((each for each in reasons if NO_BATCHES not in each), reasons[0])
    return refused(NOTCH, ParameterFile.MOTOR_NOTCH, flown, why)


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
