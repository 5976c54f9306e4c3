"""What is said of a motor that did not give what it was asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from logparse import Vehicle
from sysid.records.motor_scaling import commands_for, motor_pwm

Kind = Literal["limit", "step", "pulse"]

#: Smallest loss of thrust that is named, and its size in standard deviations.
SMALLEST, SURE = 0.10, 8.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorFault:
    """Thrust that one motor did not give."""

    motor: int  #: Number in the autopilot's frame.
    kind: Kind
    t: float  #: When it began, s.
    end: float  #: When it ended, or the last time looked at, s.
    #: Part of the thrust that is missing, 0 to 1, and its standard deviation.
    loss: float
    sigma: float
    #: Part of the output above the lowest PWM that would give the thrust that is left: 0.8 of the output gives about
    #: 0.64 of the thrust.
    output: float
    score: float  #: Loss over its standard deviation in the search, which chooses time and motor.
    evidence: str  #: What of it stands in the log, for a person to check.
    alternatives: tuple[int, ...] = ()  #: Other motors that explain it nearly as well; usually none.


def output_left(thrust: float, loss: float, vehicle: Vehicle) -> float:
    """Return the part of an output above the lowest PWM that would give the thrust that is left."""
    asked, given = (
        float(motor_pwm(commands_for(np.asarray(part * thrust), vehicle.thrust_expo), vehicle)) - vehicle.pwm_min
        for part in (1.0, 1.0 - loss)
    )
    return given / asked if loss < 1.0 else 0.0
