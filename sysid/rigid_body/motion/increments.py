"""Changes of velocity over short blocks beside what the equations of motion make of the measured motion.

Along the measured velocities, heights and attitudes the model gives an acceleration and its derivatives by all
parameters; their integrals over a block, held against the measured change of velocity, are equations of motion that are
linear in small changes of the parameters and sum up nothing from block to block.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.records.experiment import Floats
from sysid.rigid_body.motion._rigid_kernels import accelerations
from sysid.rigid_body.motion.body_motion import LAG, Motion

#: Length of a block, s: longer than the motor outputs' sampling, shorter than a gust.
BLOCK_SECONDS = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Increments:
    """What the blocks of a flight say."""

    edges: np.ndarray  #: shape (K + 1,): Samples at which blocks begin and end.
    seconds: float  #: Length of a block, s.
    missed: Floats  #: shape (K, 3): Measured change of velocity less that of the model, NED, m/s.
    #: shape (K, 3, q): Derivatives of the model's change of velocity by the parameters of the kernels.
    jacobian: Floats


def velocity_increments(flight: Motion, theta: Floats, law: int) -> Increments:
    """Hold the changes of velocity of a flight against the model's in a constant wind, over blocks of `BLOCK_SECONDS`.

    Shapes: `theta` (q,).
    """
    count = len(flight.t)
    size = min(max(round(BLOCK_SECONDS / flight.dt), 1), count - 1)
    seconds = size * flight.dt
    model, jacobian = mean_accelerations(flight, theta, np.ones((count, 1)), law, size)
    edges = np.arange(0, count, size)
    missed = np.diff(flight.velocity[edges], axis=0) - seconds * model
    return Increments(edges=edges, seconds=seconds, missed=missed, jacobian=seconds * jacobian)


def mean_accelerations(flight: Motion, theta: Floats, shapes: Floats, law: int, stride: int) -> tuple[Floats, Floats]:
    """Compute the model's accelerations along a flight as it was measured.

    Shapes: `theta` (q,); `shapes` (N, w).
    """
    means = (len(flight.t) - 1) // stride
    model, jacobian = np.empty((means, 3)), np.empty((means, 3, len(theta)))
    heights = flight.ground - flight.position[:, 2]
    signals = flight.signals(theta[LAG])
    accelerations(theta, *signals, shapes, heights, flight.velocity, law, stride, model, jacobian)
    return model, jacobian
