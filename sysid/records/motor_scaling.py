"""The autopilot's output scaling: PWM to command and command to thrust (ArduPilot AP_MotorsMulticopter)."""

from __future__ import annotations

from typing import TypeVar

import numpy as np

from logparse import Vehicle
from sysid.records import Floats

_Command = TypeVar("_Command", float, Floats)

#: Standard error of a thrust curve that stands in the autopilot's parameters: few owners measure it, and those
#: recommended for small and large propellers run from 0.5 to 0.8.
EXPO_SIGMA = 0.1


def motor_commands(pwm: Floats, vehicle: Vehicle) -> Floats:
    """Invert the autopilot's output scaling: command c between idle and full spin, 0 to 1, not clipped."""
    width = vehicle.pwm_max - vehicle.pwm_min
    idle = vehicle.pwm_min + vehicle.spin_min * width
    full = vehicle.pwm_min + vehicle.spin_max * width
    return np.asarray((pwm - idle) / (full - idle))


def motor_pwm(command: _Command, vehicle: Vehicle) -> _Command:
    """Return the PWM [us] of a command: the inverse of `motor_commands`."""
    width = vehicle.pwm_max - vehicle.pwm_min
    return vehicle.pwm_min + width * (vehicle.spin_min + command * (vehicle.spin_max - vehicle.spin_min))


def curve(command: Floats, expo: float) -> Floats:
    """Thrust over full thrust, ``(1 - e) c + e c^2``."""
    return np.asarray((1.0 - expo) * command + expo * command**2)


def curve_slope(command: Floats, expo: float) -> Floats:
    """Slope of `curve` over the command."""
    return np.asarray(1.0 - expo + 2.0 * expo * command)


def commands_for(thrust: Floats, expo: float) -> Floats:
    """Solve ``(1 - e) c + e c^2 = thrust`` for the commands."""
    if abs(expo) < 1e-6:
        return thrust
    return np.asarray((expo - 1.0 + np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * thrust)) / (2.0 * expo))


def command_for(thrust: float, expo: float) -> float:
    """Solve ``(1 - e) c + e c^2 = thrust`` for the command."""
    return float(commands_for(np.asarray(thrust, dtype=np.float64), expo))
