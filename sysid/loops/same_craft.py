"""Whether logs are of one craft: its frame, autopilot and motors, and how strongly it answers."""

from __future__ import annotations

import numpy as np

from logparse import FlightLog
from sysid.loops.loop import RateLoop

#: Parameters that make another craft of it.
_OF_THE_CRAFT = ("FRAME_CLASS", "FRAME_TYPE")

#: Factor of the craft's gain that two flights of one craft do not differ by; and that beyond which they are not summed,
#: because the error of the sum is not that of either: batteries and loads make less.
REBUILT, SUMMED = 1.5, 1.2

#: Ratio of mean voltages that one battery does not pass through, from 4.2 to 3.3 V a cell; another cell makes more.
_OTHER_BATTERY = 1.3


def other_craft(before: FlightLog, after: FlightLog) -> str | None:
    """Return why two logs are not of one craft."""
    for name in _OF_THE_CRAFT:
        a, b = before.parameters_flown.get(name), after.parameters_flown.get(name)
        if a is not None and b is not None and a != b:
            return f"{name} is {a:g} in {before.path.name} and {b:g} in {after.path.name}: these are two craft"
    first, second = before.vehicle, after.vehicle
    if first.board_id and second.board_id and first.board_id != second.board_id:
        return f"{before.path.name} and {after.path.name} were logged by two autopilots: these are two craft"
    if first.motors and second.motors and len(first.motors) != len(second.motors):
        return f"{len(first.motors)} motors before and {len(second.motors)} after: these are two craft"
    a, b = (_voltage(log) for log in (before, after))
    if max(a, b) > _OTHER_BATTERY * min(a, b):
        return f"{before.path.name} flew on {a:.1f} V and {after.path.name} on {b:.1f} V: these are two craft"
    return None


def _voltage(log: FlightLog) -> float:
    """Return the median voltage of a flight; NaN where it is not known."""
    battery = log.tables.battery
    if battery is None or log.flight is None:
        return np.nan
    flown = battery["voltage"].loc[log.flight.start : log.flight.stop]
    return float(flown[flown > 1.0].median())


def gain_apart(first: RateLoop, second: RateLoop) -> float:
    """Return by which factor the craft's gain differs between flights, around the crossover; at least 1."""
    low, high = max(first.hz[0], second.hz[0], 2.0), min(first.hz[-1], second.hz[-1], 20.0)
    hz = np.geomspace(low, high, 40) if high > low else first.hz
    gains = [
        np.interp(hz, loop.hz, np.log(np.abs(loop.plant.response / loop.flown.gyro.response(loop.hz))))
        for loop in (first, second)
    ]
    return float(np.exp(abs(np.median(gains[0] - gains[1]))))
