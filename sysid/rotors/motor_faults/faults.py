"""Which motor failed in a flight, since when, and how much of its thrust is missing.

Three readings of one equation (`sysid.rotors.motor_faults.moments`), the plainest first:

- *limit*: in the last seconds before the end (a blow, if there is one) one motor stands at its upper limit and the
  others do not, and yet the craft turns as if it gave less than it is asked for. What is usual comes from the flight
  before these seconds. Outputs at their limit after a blow are its result, and are not read.
- *step*: from some moment on until the end one motor lacks a part of its thrust. Time and motor are those with the
  largest likelihood ratio (Page 1955; Basseville and Nikiforov 1993, section 2.4.3, generalised likelihood ratio for a
  change of known shape and unknown size).
- *pulse*: the same in a window of a third of a second to two seconds, after which the motor recovers. How heavy the
  tails of a flight's gusts are it tells itself: no motor gives *more* than it is asked for, so that the surest window
  which says so is chance, and a pulse must stand out above it.

One motor must explain all three moments: wind, a shifting load and a craft that hits something do not pull along one
motor's own column of the mixer. Noise is not white: its variance is the long-run one, with Bartlett weights over three
seconds (Newey and West 1987).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from logparse import Tables, Vehicle
from sysid.rotors.motor_faults.at_limit import LAST, find_at_limit
from sysid.rotors.motor_faults.fault import MotorFault
from sysid.rotors.motor_faults.moments import read_moments
from sysid.rotors.motor_faults.pulses import find_pulses
from sysid.rotors.motor_faults.steps import find_step

#: Part of the fastest turn after a sudden failure that is its first.
_TURNS = 0.25
#: Specific force of a blow, m/s^2.
_BLOW = 30.0
#: Time before a landing in which the ground pushes, s; a log has none whose outputs end within `_CUT` seconds of the
#: flight, unless the autopilot said so within `_LANDED` seconds before.
_GROUND, _CUT, _LANDED, _LANDINGS = 2.0, 0.3, 4.0, ("LAND_COMPLETE", "LAND_COMPLETE_MAYBE", "DISARMED")


def find_motor_faults(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> tuple[MotorFault, ...]:
    """Find the motors that did not give what they were asked for in a flight.

    Parameters
    ----------
    tables : Tables
        With motors and IMU.
    vehicle : Vehicle
        Whose frame is known.
    start, stop : float
        Lift-off, and touch-down, crash or the end of the log [s]; a blow in the last seconds before it ends the search.

    Returns
    -------
    tuple of MotorFault
        In the order of time; empty where there is none, or where outputs or rates are too slow or too short to tell.

    Raises
    ------
    MissingDataError
        Without the frame, the outputs of all its motors, or the IMU.
    """
    moments = read_moments(tables, vehicle, start, _end(tables, stop))
    if moments is None:
        return ()
    limit, step = find_at_limit(moments, vehicle), find_step(moments, vehicle)
    lasting = limit or step
    if step is not None and (limit is None or limit.motor == step.motor):
        evidence = step.evidence if limit is None else limit.evidence
        lasting = replace(step, t=_suddenly(step, tables, vehicle, moments.step), evidence=evidence)
    pulses = find_pulses(moments if lasting is None else moments.part(moments.t < lasting.t), vehicle)
    return (*pulses, *([lasting] if lasting else []))


def _suddenly(fault: MotorFault, tables: Tables, vehicle: Vehicle, step: float) -> float:
    """Return when the craft began to turn towards a motor that failed at once, as the gyro's times tell it, s."""
    assert tables.imu is not None
    rates = tables.imu.loc[fault.t - step : fault.t + step, ["gyro_x", "gyro_y"]].dropna()
    motor = next(each for each in vehicle.motors if each.number == fault.motor)
    t, towards = rates.index.to_numpy(np.float64), -(rates.to_numpy(np.float64) @ (motor.roll, motor.pitch))
    if len(t) < 4:
        return fault.t
    turned = np.diff(towards)
    first = int(np.argmax(turned >= _TURNS * turned.max()))
    return float(0.5 * (t[first] + t[first + 1]))


def _end(tables: Tables, stop: float) -> float:
    """Return the last time at which motors can be compared, s: before a blow, and before the ground pushes."""
    if tables.motors is None or tables.imu is None or len(tables.motors) < 2:
        return stop
    outputs = tables.motors.index.to_numpy(np.float64)
    last = tables.imu.loc[stop - LAST : stop + _CUT, ["accel_x", "accel_y", "accel_z"]]
    blows = last.index[np.linalg.norm(last.to_numpy(np.float64), axis=1) > _BLOW]
    if len(blows):
        # No output whose interval the blow is in.
        return min(float(blows[0]) - float(np.median(np.diff(outputs))), stop)
    # A log whose outputs end with the flight was cut, or power was lost, in the air.
    said = tables.events is not None and tables.events["event"].loc[stop - _LANDED :].isin(_LANDINGS).any()
    return stop - _GROUND if said or outputs[-1] > stop + _CUT else stop
