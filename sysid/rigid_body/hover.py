"""Linear state-space model about hover, Kim 2017 eq. 17: attitude and rates against motors.

States are roll, pitch [rad], p, q, r [rad/s]; inputs deviations of the motors' commands from hover, of which the paper
has rotor speeds. Without damping A is the paper's; an identified rigid body adds its rate damping.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from core.summary import Summarised, listed
from core.units import STANDARD_GRAVITY
from logparse import MissingDataError
from sysid.records.experiment import Floats
from sysid.records.motor_scaling import command_for
from sysid.rigid_body.model import RigidBodyModel

STATES = ("roll", "pitch", "p", "q", "r")


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class HoverModel(Summarised):
    """A linear model ``dx/dt = A x + B u``."""

    A: Floats  #: shape (5, 5)
    B: Floats  #: shape (5, n)
    inputs: tuple[str, ...]  #: Motors.
    input_unit: str = "command"  #: 1 from idle to full spin.
    trim: Floats  #: shape (n,): Inputs in hover.
    pwm_per_command: float  #: us, to turn B for commands into B for PWM (divide).
    eigenvalues: tuple[complex, ...]  #: Of A, 1/s.
    controllable: bool  #: Whether the motors reach every state.
    states: tuple[str, ...] = STATES
    kind: Literal["hover"] = "hover"

    def summary(self) -> Mapping[str, str]:
        """Return the few facts by which a reader knows this result."""
        return {"inputs": f"{listed(self.inputs, 8)} ({self.input_unit})", "states": "roll, pitch, p, q, r"}


def hover_model(model: RigidBodyModel) -> HoverModel:
    """Linearise an identified rigid body about hover, at its reference voltage in sea-level air.

    Raises
    ------
    MissingDataError
        When a turning effectiveness or thrust is not determined, or the craft cannot hover so.
    """
    missing = [
        f"{name} ({model.parameters[name].reason})"
        for name in ("thrust", "roll_gain", "pitch_gain", "yaw_gain")
        if not model.parameters[name].determined
    ]
    if missing:
        raise MissingDataError(f"no linear hover model: not determined is {'; '.join(missing)}")
    motors, expo = model.vehicle.motors, model.value("thrust_expo")
    command = command_for(STANDARD_GRAVITY / (len(motors) * model.value("thrust")), expo)
    if not 0.0 < command < 1.0:
        raise MissingDataError(f"no linear hover model: hover would take a command of {command:.2f}")
    slope = 1.0 - expo + 2.0 * expo * command
    x, y, turn = (
        np.array(values) for values in zip(*[(np.cos(m.angle), np.sin(m.angle), m.spin) for m in motors], strict=True)
    )
    A, B = np.zeros((5, 5)), np.zeros((5, len(motors)))
    A[0, 2] = A[1, 3] = 1.0
    A[[2, 3, 4], [2, 3, 4]] = [-model.value(f"{axis}_damping") for axis in ("roll", "pitch", "yaw")]
    B[2] = model.value("roll_gain") * slope * (model.value("cg_y") - y)
    B[3] = model.value("pitch_gain") * slope * (x - model.value("cg_x"))
    B[4] = model.value("yaw_gain") * slope * -turn
    reached = np.hstack([np.linalg.matrix_power(A, power) @ B for power in range(len(A))])
    width = model.vehicle.pwm_max - model.vehicle.pwm_min
    return HoverModel(
        A=A,
        B=B,
        inputs=tuple(f"m{motor.number}" for motor in motors),
        trim=np.full(len(motors), command),
        pwm_per_command=width * (model.vehicle.spin_max - model.vehicle.spin_min),
        eigenvalues=tuple(map(complex, np.linalg.eigvals(A))),
        controllable=bool(np.linalg.matrix_rank(reached) == len(A)),
    )
