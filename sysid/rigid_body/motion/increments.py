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

    Parameters
    ----------
    flight : Motion
    theta : ndarray, shape (q,)
        Parameters in the order of `_rigid_kernels`.
    law : int
        Of drag.
    """
    count = len(flight.t)
    model, jacobian = np.empty((count, 3)), np.empty((count, 3, len(theta)))
    heights = flight.ground - flight.position[:, 2]
    still = np.ones((count, 1))
    accelerations(theta, flight.signals(theta[LAG]), still, heights, flight.velocity, law, model, jacobian)
    size = min(max(round(BLOCK_SECONDS / flight.dt), 1), count - 1)
    edges = np.arange(0, count, size)

    def over_blocks(rates: Floats) -> Floats:
        sums = np.cumsum(0.5 * (rates[1:] + rates[:-1]) * flight.dt, axis=0)
        return np.asarray(np.diff(np.concatenate([np.zeros((1, *rates.shape[1:])), sums])[edges], axis=0))

    missed = np.diff(flight.velocity[edges], axis=0) - over_blocks(model)
    return Increments(edges=edges, seconds=size * flight.dt, missed=missed, jacobian=over_blocks(jacobian))
