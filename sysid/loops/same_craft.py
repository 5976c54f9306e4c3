"""Whether logs are of one craft and load: frame, autopilot and motors, what carries it, how strongly it answers."""

from __future__ import annotations

import numpy as np

from logparse import FlightLog, Vehicle
from sysid.loops.loop import RateLoop
from sysid.records.context import air_density, standard_density
from sysid.records.motor_scaling import curve, motor_commands

#: Factor of the craft's gain that two flights of one craft do not differ by; and that beyond which they are not summed,
#: because the error of the sum is not that of either: batteries and loads make less.
REBUILT, SUMMED = 1.5, 1.2

#: Ratio of mean voltages that one battery does not pass through, from 4.2 to 3.3 V a cell; another cell makes more.
_OTHER_BATTERY = 1.3

#: Factor of the thrust that carries a craft that its flights do not differ by: seventy firmware flights of four craft,
#: up to 2850 m and in 5 m/s of wind, do by 2 %. A fifth of payload makes more.
_OTHER_LOAD = 1.1

#: Time after take-off and before landing that is not flight alone, and the least that is looked at between them, s.
_ENDS, _SHORTEST = 5.0, 10.0


def other_craft(before: FlightLog, after: FlightLog) -> str | None:
    """Return why two logs are not of one craft."""
    for name in ("FRAME_CLASS", "FRAME_TYPE"):
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


def other_load(before: FlightLog, after: FlightLog) -> str | None:
    """Report that two flights of one craft were not carried by one thrust: another payload, or other propellers."""
    first, second = (_lift(log, before.vehicle) for log in (before, after))
    if not max(first, second) > _OTHER_LOAD * min(first, second):
        return None
    return (
        f"{after.path.name} was carried by {second / first:.2f} times the thrust of {before.path.name}, at one voltage "
        "and density: another payload, or other motors or propellers; give flights of one load"
    )


def _lift(log: FlightLog, vehicle: Vehicle) -> float:
    """Return the mean of a flight's vertical thrust, which is its weight, in parts of full at a volt; NaN if unknown.

    By the curve of one `vehicle` for all flights: what a pulse gives does not depend on a flight's parameters.
    """
    tables, flight = log.tables, log.flight
    motors, attitude, battery, gps, baro = tables.motors, tables.attitude, tables.battery, tables.gps, tables.baro
    if flight is None or motors is None or attitude is None or battery is None or not vehicle.motors:
        return np.nan
    start, stop = flight.start + _ENDS, flight.stop - _ENDS
    pulses = motors.loc[start:stop].dropna()
    known = battery["voltage"].loc[start:stop].dropna()
    if stop - start < _SHORTEST or len(pulses) < 2 or not len(known):
        return np.nan
    t = pulses.index.to_numpy(np.float64)
    thrust = curve(motor_commands(pulses.to_numpy(np.float64), vehicle), vehicle.thrust_expo).mean(axis=1)
    upright = (np.cos(attitude["roll"]) * np.cos(attitude["pitch"])).dropna()
    upright, voltage = (np.interp(t, one.index, one.to_numpy(np.float64)) for one in (upright, known))
    height = np.nan if gps is None else float(gps["alt"].loc[start:stop].median())
    pressure = np.nan if baro is None else float(baro["pressure"].loc[start:stop].median())
    density = standard_density(np.array(height)) if np.isfinite(height) else air_density(np.array(pressure))
    return float(np.mean(thrust * upright * voltage**2) * (density if np.isfinite(density) else 1.225))


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
