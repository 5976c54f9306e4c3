"""From a table of other origin to the signals of an `Experiment`: motion capture, recorders, published benchmarks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

if TYPE_CHECKING:
    from logparse.foreign.motion import MotionTable

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class TableSignals:
    """Inputs, outputs and context of a table, as `Experiment` takes them."""

    u: Floats
    y: Floats
    input_names: tuple[str, ...]
    units: dict[str, str]
    context: pd.DataFrame


def table_signals(motion: MotionTable) -> TableSignals:
    """Arrange a table's motion and inputs as an experiment has them.

    Outputs are x, y, z (north, east, up of the first sample, m); inputs the motors ``m1 ...``, then further inputs.
    """
    position = (motion.position - motion.position[0]) * np.array([1.0, 1.0, -1.0])
    w, x, y, z = motion.quaternion.T
    context = {
        "roll": np.unwrap(np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))),
        "pitch": np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0)),
        "yaw": np.unwrap(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))),
        **{f"w_{axis}": motion.rates[:, k] for k, axis in enumerate("xyz")},
        **{f"v_{axis}": motion.velocity[:, k] for k, axis in enumerate("ned")},
        **{f"q_{part}": motion.quaternion[:, k] for k, part in enumerate("wxyz")},
        "voltage": np.full(len(motion.t), np.nan) if motion.voltage is None else motion.voltage,
        "density": np.full(len(motion.t), np.nan),
    }
    motors = tuple(f"m{motor.number}" for motor in motion.vehicle.motors)
    return TableSignals(
        u=np.column_stack([motion.motors, motion.inputs]),
        y=position,
        input_names=(*motors, *motion.input_names),
        units={**dict.fromkeys(motors, motion.motor_unit), **dict.fromkeys("xyz", "m")},
        context=pd.DataFrame(context, index=pd.Index(motion.t, name="t")),
    )
