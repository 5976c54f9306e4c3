"""Moments at which the IMU cannot be believed: impacts, saturation, vibration beyond its range."""

from dataclasses import dataclass

import numpy as np

from estimation.timing import TICK

#: A gate narrows from what is farthest beyond it, over this, to that of the settings.
NARROWING = 8.0


@dataclass(frozen=True, slots=True)
class Shocks:
    """Steps of attitude and velocity that the IMU may have missed.

    Attributes
    ----------
    t : ndarray, shape (k,)
        Ascending, s.
    variance : ndarray, shape (k, 2)
        Of the step of attitude [rad^2] and of velocity [(m/s)^2] there.
    """

    t: np.ndarray
    variance: np.ndarray

    @classmethod
    def none(cls) -> "Shocks":
        """Return no shocks."""
        return cls(np.empty(0), np.empty((0, 2)))

    def widened(self, nodes: np.ndarray, shock: np.ndarray, size: np.ndarray, gate: float) -> "Shocks":
        """Add the moments at which all measurements together ask for a step that the IMU does not know.

        What they ask for is the auxiliary residual of the state's noise (de Jong & Penzer 1998). A true step shows at
        its neighbours too, so only those are taken that come near the largest.

        Parameters
        ----------
        nodes, shock, size : ndarray, shapes (n,), (n, 2), (n, 2)
            See `smoother.Estimates`.
        gate : float
            s.d. beyond which a step is too large for the noise of the IMU.
        """
        level = np.maximum(gate, np.sqrt(shock.max(axis=0, initial=0.0)) / NARROWING)
        new = np.where(shock > level**2, size**2, 0.0)
        struck = new.any(axis=1)
        t = np.concatenate([self.t, nodes[struck]])
        variance = np.concatenate([self.variance, new[struck]])
        merged, where = np.unique(np.round(t / TICK), return_inverse=True)
        total = np.zeros((len(merged), 2))
        np.maximum.at(total, where, variance)
        return Shocks(merged * TICK, total)

    def add_to(self, variance: np.ndarray, edges: np.ndarray) -> None:
        """Add to the variance (n, 2) of the steps between successive `edges` (n + 1,), in ticks, in place."""
        at = np.round(self.t / TICK).astype(np.int64)
        inside = (at > edges[0]) & (at <= edges[-1])
        np.add.at(variance, np.searchsorted(edges, at[inside]) - 1, self.variance[inside])
