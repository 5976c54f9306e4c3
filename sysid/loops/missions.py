"""Missions for drag, wind, thrust and position as ``.waypoints`` files (QGC WPL 110), with their expected errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from core.units import STANDARD_GRAVITY

#: Metres per degree of latitude.
_METRES_PER_DEGREE = 111_320.0

#: What ordinary logs leave of the mean acceleration of a leg: standard deviation [m/s^2] of a sample, and the time [s]
#: over which samples are alike.
_ACCELERATION_NOISE, _ALIKE = 0.15, 2.0


class _Command(IntEnum):
    """MAVLink's commands; those of VTOLs take off, land and stay on the motors that lift."""

    WAYPOINT, TAKEOFF, LAND, SPEED = 16, 22, 21, 178
    VTOL_TAKEOFF, VTOL_LAND, VTOL_STATE = 84, 85, 3000


@dataclass(frozen=True, slots=True)
class Leg:
    """A straight leg: north and east [m] from home, height [m] above it, speed [m/s] and a stay [s] at its end."""

    north: float
    east: float
    height: float
    speed: float
    stay: float = 0.0


def waypoints(home: tuple[float, float, float], legs: Sequence[Leg], vtol: bool = False) -> str:
    """Write a mission: take-off, legs with their speeds, landing at home; of a VTOL without its wings."""
    lat, lon, alt = home
    up, down = (_Command.VTOL_TAKEOFF, _Command.VTOL_LAND) if vtol else (_Command.TAKEOFF, _Command.LAND)
    lines = ["QGC WPL 110"]

    def add(command: _Command, x: float, y: float, z: float, *first: float) -> None:
        # Places are relative to home, which comes first; commands without one are of the mission's frame.
        frame = 0 if len(lines) == 1 else 2 if command in (_Command.SPEED, _Command.VTOL_STATE) else 3
        numbers = [f"{value:.8f}" for value in (*first, *(0.0,) * (4 - len(first)), x, y, z)]
        head = (len(lines) - 1, int(len(lines) == 1), frame, int(command))
        lines.append("\t".join([*map(str, head), *numbers, "1"]))

    add(_Command.WAYPOINT, lat, lon, alt)
    add(up, 0.0, 0.0, legs[0].height)
    if vtol:
        add(_Command.VTOL_STATE, 0.0, 0.0, 0.0, 3.0)  # stays on the motors that lift
    speed = None
    for leg in legs:
        if leg.speed != speed:
            add(_Command.SPEED, 0.0, 0.0, 0.0, 1.0, leg.speed)
            speed = leg.speed
        north = lat + leg.north / _METRES_PER_DEGREE
        east = lon + leg.east / (_METRES_PER_DEGREE * math.cos(math.radians(lat)))
        add(_Command.WAYPOINT, north, east, leg.height, leg.stay)
    add(down, lat, lon, 0.0)
    return "\n".join(lines) + "\n"


def drag_legs(height: float) -> tuple[Leg, ...]:
    """Return there and back at four speeds in each of two directions, so that wind and drag part."""
    legs: list[Leg] = [Leg(0.0, 0.0, height, 3.0, 5.0)]
    for speed in (3.0, 6.0, 9.0, 12.0):
        legs += [Leg(120.0, 0.0, height, speed, 3.0), Leg(0.0, 0.0, height, speed, 3.0)]
        legs += [Leg(0.0, 120.0, height, speed, 3.0), Leg(0.0, 0.0, height, speed, 3.0)]
    return tuple(legs)


def thrust_legs(height: float) -> tuple[Leg, ...]:
    """Return climbs and descents between two heights with stays in hover."""
    legs = [Leg(0.0, 0.0, height, 3.0, 15.0)]
    for _ in range(5):
        legs += [Leg(0.0, 0.0, height + 15.0, 3.0, 8.0), Leg(0.0, 0.0, height, 3.0, 8.0)]
    return tuple(legs)


def position_legs(height: float) -> tuple[Leg, ...]:
    """Return moves in all three directions with stays: what position models are fitted to."""
    corners = [(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)]
    legs = [Leg(0.0, 0.0, height, 4.0, 10.0)]
    for turn, speed in enumerate((2.0, 4.0, 6.0)):
        for k, (north, east) in enumerate(corners):
            legs.append(Leg(north, east, height + 6.0 * ((k + turn) % 2), speed, 4.0))
    return (*legs, Leg(0.0, 0.0, height, 4.0, 10.0))


def drag_errors(legs: Sequence[Leg]) -> dict[str, float]:
    """Predict standard deviations of linear drag [1/s], quadratic drag [1/m] and wind [m/s] from legs there and back.

    Each leg gives its mean acceleration ``-(c1 + c2 |v - w|) (v - w)`` along and across itself; the wind is fitted too.
    """
    rows, weights = [], []
    before = legs[0]
    for leg in legs[1:]:
        move = np.array([leg.north - before.north, leg.east - before.east])
        distance = float(np.hypot(*move))
        before = leg
        if distance < 20.0:
            continue
        velocity = move / distance * leg.speed
        steps = np.diag([1e-5, 1e-5, 1e-4, 1e-4])
        # Drag of a usual multirotor, 1/s and 1/m.
        at = np.array([0.15, 0.02, 0.5, 0.5])
        base = _deceleration(at, velocity)
        rows.append(np.stack([(_deceleration(at + step, velocity) - base) / step.sum() for step in steps], axis=1))
        seconds = max(distance / leg.speed - 4.0, 1.0)
        weights.append(seconds / _ALIKE / _ACCELERATION_NOISE**2)
    information = sum(weight * row.T @ row for weight, row in zip(weights, rows, strict=True))
    sigma = np.sqrt(np.diag(np.linalg.inv(np.asarray(information))))
    return {"drag_linear": float(sigma[0]), "drag_quadratic": float(sigma[1]), "wind": float(max(sigma[2:]))}


def _deceleration(parameters: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    air = velocity - parameters[2:]
    return np.asarray(-(parameters[0] + parameters[1] * np.hypot(*air)) * air)


def thrust_errors(legs: Sequence[Leg]) -> dict[str, float]:
    """Predict the relative standard deviation of the thrust scale from the time in hover and climb."""
    seconds = sum(leg.stay for leg in legs)
    return {"thrust_scale": float(_ACCELERATION_NOISE / STANDARD_GRAVITY / math.sqrt(max(seconds / _ALIKE, 1.0)))}
