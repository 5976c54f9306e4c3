"""Where a craft's motors sit and how they turn, in the order of a record's inputs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from logparse import MissingDataError
from sysid.records.experiment import Experiment, Floats


@dataclass(frozen=True, slots=True)
class MotorGeometry:
    """Directions of the arms and of rotation."""

    #: shape (n,): Position of each motor in arms: cosine and sine of its angle from the nose. Thrust there pitches the
    #: nose up by `forward` and rolls to the left by `right`.
    forward: Floats
    right: Floats
    #: shape (n,): +1 clockwise seen from above (its torque turns the nose to the left), -1 counter-clockwise, 0
    #: unknown.
    spin: Floats


def motor_geometry(record: Experiment) -> MotorGeometry:
    """Look the record's motors up in its craft."""
    motors = {f"m{motor.number}": motor for motor in (record.vehicle.motors if record.vehicle is not None else ())}
    unknown = [name for name in record.input_names if name not in motors]
    if unknown:
        raise MissingDataError(
            f"{record.name}: where motor {', '.join(unknown)} sits is not known, so that moments cannot be computed; "
            "log parameters (FRAME_CLASS, FRAME_TYPE)"
        )
    used = [motors[name] for name in record.input_names]
    return MotorGeometry(
        forward=np.array([np.cos(motor.angle) for motor in used]),
        right=np.array([np.sin(motor.angle) for motor in used]),
        spin=np.array([float(motor.spin) for motor in used]),
    )
