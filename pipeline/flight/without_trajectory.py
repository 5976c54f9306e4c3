"""What a flight tells without its trajectory: how the craft turns, the gains that chirps propose, and its motors.

Neither this nor the trajectory waits for the other, so that a copy of the process can do it on a second processor.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial

import scipy

from logparse import Finding, Flight, FlightLog, MissingDataError
from pipeline.execution import executors
from pipeline.execution.stages import Progress, Stages, silent
from pipeline.flight.rotation import find_rotation
from pipeline.results.failure import Failure, present
from pipeline.results.rotation import RotationResult
from pipeline.results.span import Span
from sysid.autopilot.gathering import gain_values
from sysid.autopilot.values import AutopilotValue
from sysid.loops.tuning import tune_known
from sysid.rotors.motor_faults.outputs import check_outputs
from sysid.rotors.motor_faults.trims import steady_trims, weak_from_start
from sysid.rotors.steady_trims import SteadyTrims

#: Stages that take no time of the progress bar where a copy of the process does them.
STAGES = ("rotation",)


@dataclass(frozen=True, slots=True, kw_only=True)
class WithoutTrajectory:
    """What a flight tells without its trajectory, and the stages that found it."""

    rotation: RotationResult | Failure
    gains: tuple[AutopilotValue, ...] = ()  #: That are proposed to the autopilot.
    trims: SteadyTrims | None = None
    motor_findings: tuple[Finding, ...] = ()
    stages: Stages


def begin(
    log: FlightLog, sound: Span | Failure, part: Span | Failure, progress: Progress, time_limit: float, *, alone: bool
) -> Callable[[], WithoutTrajectory]:
    """Return a function that waits for what needs no trajectory.

    In a process that does nothing else, a copy of it does the work meanwhile; otherwise the work is done at once.
    """
    look = partial(_look, log, sound, part, Stages(silent if alone else progress, time_limit))
    if alone:
        _ = scipy.optimize, scipy.fft  # what both processes need is imported before there are two
        return executors.begin(look)
    result = look()
    return lambda: result


def _look(log: FlightLog, sound: Span | Failure, part: Span | Failure, stages: Stages) -> WithoutTrajectory:
    """Look at the rotation in `part` of a flight, of which models are made, and at the motors while it was `sound`."""
    if isinstance(sound, Failure):
        return WithoutTrajectory(rotation=sound, stages=stages)
    rotation, gains = (part, ()) if isinstance(part, Failure) else _rotation_and_gains(log, part, stages)
    trims, findings = present(stages.run("account", lambda _: _motors(log, sound))) or (None, ())
    return WithoutTrajectory(
        rotation=rotation,
        gains=gains,
        trims=trims,
        motor_findings=findings,
        # What was unforeseen is among the findings; errors may not pass to another process.
        stages=replace(stages, progress=silent, unforeseen={}),
    )


def _rotation_and_gains(
    log: FlightLog, part: Span, stages: Stages
) -> tuple[RotationResult | Failure, tuple[AutopilotValue, ...]]:
    """Estimate how the craft turns, and the gains that chirps propose to the autopilot.

    Gains from ordinary flying are left to `rotorid tune`: without chirps most are refused.
    """
    result = stages.run("rotation", lambda _: find_rotation(log, part))
    if isinstance(result, Failure):
        return result, ()
    rotation, loops = result
    if not any(axis.loop is not None and not axis.loop.ordinary for axis in rotation.axes):
        return rotation, ()
    proposed = stages.run("advice", lambda _: tuple(gain_values(tune_known(log, loops), log.parameters_flown)))
    return rotation, present(proposed) or ()


def _motors(log: FlightLog, sound: Span) -> tuple[SteadyTrims | None, tuple[Finding, ...]]:
    """Compare motor outputs with the mixer and with one another, as far as the log has what that takes.

    A motor that is weak by its trims must be so in the other flights of the log too.
    """
    with suppress(MissingDataError):
        # Trims of outputs in another order say nothing about a motor.
        if findings := check_outputs(log.tables, log.vehicle, sound.start, sound.stop):
            return None, findings
    trims = _trims(log, sound)
    if trims is None:
        return None, ()
    others = (_trims(log, flight) for flight in log.flights if flight != log.flight)
    return trims, weak_from_start(trims, [other for other in others if other is not None])


def _trims(log: FlightLog, flight: Span | Flight) -> SteadyTrims | None:
    """Return the trims of a flight; None where the log does not show them."""
    try:
        return steady_trims(log.tables, log.vehicle, flight.start, flight.stop)
    except MissingDataError:
        return None
