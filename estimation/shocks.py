"""Moments at which the IMU cannot be believed: impacts, saturation, vibration beyond its range."""

from dataclasses import dataclass

import numpy as np

from estimation.timing import TICK

#: s.d. beyond which a step is no noise of the IMU: more than for a reading, since what the IMU does wrong in ordinary
#: vibration is white noise that it is given, and no step.
SHOCK_GATE = 8.0
#: Steps nearer to each other than this are one, s.
APART = 0.5
#: What attitude may have turned by unseen is no more than this, rad: measurements that hardly know it ask for more.
FARTHEST_TURN = 0.3
#: A gate narrows from what is farthest beyond it, over this, to that of the settings.
NARROWING = 8.0


@dataclass(frozen=True, slots=True)
class Shocks:
    """Steps of attitude and velocity that the IMU may have missed."""

    t: np.ndarray  #: shape (k,): Ascending, s.
    variance: np.ndarray  #: shape (k, 2): Of the step of attitude [rad^2] and of velocity [(m/s)^2] there.

    @classmethod
    def none(cls) -> "Shocks":
        """Return no shocks."""
        return cls(np.empty(0), np.empty((0, 2)))

    def widened(self, nodes: np.ndarray, shock: np.ndarray, size: np.ndarray) -> "Shocks":
        """Add the moments at which all measurements together ask for a step that the IMU does not know.

        What they ask for is the auxiliary residual of the state's noise (de Jong & Penzer 1998). A true step shows at
        its neighbours, and a step of attitude in velocity too, so only the largest about a moment is taken.

        Parameters
        ----------
        nodes, shock, size : ndarray, shapes (n,), (n, 2), (n, 2)
            See `smoother.Estimates`.
        """
        largest = shock.max(axis=1, initial=0.0)
        level = max(SHOCK_GATE, float(np.sqrt(largest.max(initial=0.0))) / NARROWING)
        struck = _peaks(nodes, largest, level**2)
        new = np.where(shock == largest[:, None], np.minimum(size, [FARTHEST_TURN, np.inf]) ** 2, 0.0)
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


def _peaks(t: np.ndarray, values: np.ndarray, level: float) -> np.ndarray:
    """Return which values are above a level and the largest within `APART` of them, shape (n,)."""
    peaks = np.zeros(len(t), np.bool_)
    for k in np.flatnonzero(values > level):
        first, last = np.searchsorted(t, [t[k] - APART, t[k] + APART])
        peaks[k] = values[k] >= values[first:last].max()
    return peaks
