"""Linear state-space model about hover, Kim 2017 eq. 17: attitude and rates against motors.

States are roll, pitch [rad], p, q, r [rad/s]; inputs deviations of the motors from hover, as rotor speeds [rad/s] (the
paper) or as commands between idle and full spin (what a log tells). Without damping A is the paper's; an identified
rigid body adds its rate damping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from core.summary import Summarised, listed
from core.units import STANDARD_GRAVITY
from logparse import MissingDataError
from sysid.records.experiment import Floats
from sysid.records.motor_scaling import command_for
from sysid.rigid_body.model import RigidBodyModel

STATES = ("roll", "pitch", "p", "q", "r")


@dataclass(frozen=True, slots=True, repr=False)
class HoverModel(Summarised):
    """A linear model ``dx/dt = A x + B u``."""

    A: Floats  #: shape (5, 5)
    B: Floats  #: shape (5, n)
    inputs: tuple[str, ...]  #: Motors.
    input_unit: str  #: ``"rad/s"`` or ``"command"`` (1 from idle to full spin).
    trim: Floats  #: shape (n,): Inputs in hover.
    pwm_per_command: float | None  #: us, to turn B for commands into B for PWM (divide); None for rotor speeds.
    eigenvalues: tuple[complex, ...] = field(init=False)  #: Of A, 1/s.
    controllable: bool = field(init=False)  #: Whether the motors reach every state.
    states: tuple[str, ...] = STATES
    kind: Literal["hover"] = "hover"

    def __post_init__(self) -> None:
        """Compute what follows from A and B."""
        powers = [self.B]
        for _ in range(len(self.A) - 1):
            powers.append(self.A @ powers[-1])
        controllable = bool(np.linalg.matrix_rank(np.hstack(powers)) == len(self.A))
        object.__setattr__(self, "eigenvalues", tuple(map(complex, np.linalg.eigvals(self.A))))
        object.__setattr__(self, "controllable", controllable)

    def summary(self) -> Mapping[str, str]:
        """Return the key facts of this result."""
        return {"inputs": f"{listed(self.inputs, 8)} ({self.input_unit})", "states": "roll, pitch, p, q, r"}


def hover_from_speeds(
    speeds: Sequence[float],
    thrust: Sequence[float],
    torque: Sequence[float],
    inertia: Sequence[float],
    forward: Sequence[float],
    right: Sequence[float],
    spin: Sequence[int],
) -> HoverModel:
    """Linearise about hover at given rotor speeds (eq. 17), such as with coefficients of a thrust stand.

    Parameters
    ----------
    speeds : sequence of float
        Rotor speeds in hover, rad/s.
    thrust, torque : sequence of float
        k [N s^2] and b [N m s^2] of each rotor.
    inertia : sequence of float
        Ixx, Iyy, Izz, kg m^2.
    forward, right : sequence of float
        Position of each rotor, m.
    spin : sequence of int
        +1 clockwise seen from above.
    """
    w, k, b, x, y = (np.asarray(values, dtype=np.float64) for values in (speeds, thrust, torque, forward, right))
    turn = np.asarray(spin, dtype=np.float64)
    B = np.zeros((5, len(w)))
    B[2:] = 2.0 * w * np.vstack([-y * k / inertia[0], x * k / inertia[1], -turn * b / inertia[2]])
    names = tuple(f"m{number}" for number in range(1, len(w) + 1))
    return HoverModel(_rates(0.0, 0.0, 0.0), B, names, "rad/s", w, None)


def hover_model(model: RigidBodyModel, density: float = 1.225) -> HoverModel:
    """Linearise an identified rigid body about hover, at its reference voltage.

    Parameters
    ----------
    model : RigidBodyModel
    density : float
        Air, kg/m^3.

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
    air = density / model.reference_density
    command = command_for(STANDARD_GRAVITY / (len(motors) * model.value("thrust") * air), expo)
    if not 0.0 < command < 1.0:
        raise MissingDataError(f"no linear hover model: hover would take a command of {command:.2f}")
    slope = air * (1.0 - expo + 2.0 * expo * command)
    x, y, turn = (
        np.array(values) for values in zip(*[(np.cos(m.angle), np.sin(m.angle), m.spin) for m in motors], strict=True)
    )
    B = np.zeros((5, len(motors)))
    B[2] = model.value("roll_gain") * slope * (model.value("cg_y") - y)
    B[3] = model.value("pitch_gain") * slope * (x - model.value("cg_x"))
    B[4] = model.value("yaw_gain") * slope * -turn
    width = model.vehicle.pwm_max - model.vehicle.pwm_min
    return HoverModel(
        _rates(*(model.value(f"{axis}_damping") for axis in ("roll", "pitch", "yaw"))),
        B,
        tuple(f"m{motor.number}" for motor in motors),
        "command",
        np.full(len(motors), command),
        width * (model.vehicle.spin_max - model.vehicle.spin_min),
    )


def _rates(roll: float, pitch: float, yaw: float) -> Floats:
    A = np.zeros((5, 5))
    A[0, 2] = A[1, 3] = 1.0
    A[2, 2], A[3, 3], A[4, 4] = -roll, -pitch, -yaw
    return A
