"""Moments at which the IMU cannot be believed: impacts, saturation, vibration beyond its range.

Which fixes a log happens to have must decide neither whether such a step is believed nor when it was. So a step that
stands out more is believed more, and its variance lies where it may have been: as much of it at each node as that node
is likely to be the one.
"""

from dataclasses import dataclass

import numpy as np

from estimation.timing import TICK

#: s.d. at which half of a step is believed: more than for a reading, since what the IMU does wrong in ordinary
#: vibration is white noise that it is given, and no step.
SHOCK_GATE = 8.0
#: Shares of the gate at which a step begins to be believed, and is believed as a whole.
BEGINNING, WHOLLY = 0.75, 1.25
#: Steps nearer to each other than this are one, s.
APART = 0.5
#: What attitude may have turned by unseen is no more than this, rad: measurements that hardly know it ask for more.
FARTHEST_TURN = 0.3
#: A gate narrows from what is farthest beyond it, over this, to that of the settings.
NARROWING = 8.0
#: Variances that grow by less than this share, from pass to pass, have settled.
SETTLED = 0.2


@dataclass(frozen=True, slots=True)
class Shocks:
    """Steps of attitude and velocity that the IMU may have missed."""

    t: np.ndarray  #: shape (k,): Times at which there may have been one, ascending, s.
    variance: np.ndarray  #: shape (k, 2): Of the step of attitude [rad^2] and of velocity [(m/s)^2] there.
    #: shape (k, 2): How large the step is that is likeliest there, of those beyond `SHOCK_GATE`, rad and m/s; else 0.
    size: np.ndarray

    @classmethod
    def none(cls) -> "Shocks":
        """Return no shocks."""
        return cls(np.empty(0), np.empty((0, 2)), np.empty((0, 2)))

    @property
    def steps(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the times of the steps beyond `SHOCK_GATE`, shape (s,), s, and their sizes, shape (s, 2)."""
        steps = self.size.any(axis=1)
        return self.t[steps], self.size[steps]

    def widened(self, nodes: np.ndarray, shock: np.ndarray, size: np.ndarray) -> "Shocks":
        """Add the moments at which all measurements together ask for a step that the IMU does not know.

        What they ask for is the auxiliary residual of the state's noise (de Jong & Penzer 1998), whose square is twice
        the gain in log-likelihood of a step there: which tells how likely each node about the largest is the one, and
        each kind of step, as a step of attitude shows in velocity too.
        """
        largest = shock.max(axis=1, initial=0.0)
        gate = max(SHOCK_GATE, float(np.sqrt(largest.max(initial=0.0))) / NARROWING)
        size = np.minimum(size, [FARTHEST_TURN, np.inf])
        t, variance, sizes = [self.t], [self.variance], [self.size]
        for k in np.flatnonzero(_peaks(nodes, largest, (BEGINNING * gate) ** 2)):
            about = slice(*np.searchsorted(nodes, [nodes[k] - APART, nodes[k] + APART]))
            likely = np.exp(0.5 * (shock[about] - largest[k]))
            share = believed(float(np.sqrt(largest[k])) / gate)
            t.append(nodes[about])
            # Of a step with precision L and size d, prior variance v leaves v L / (1 + v L); d^2 L is `largest`.
            prior = min(share / (1.0 - share) / largest[k], 1.0) if share < 1.0 else 1.0
            variance.append(prior * size[about] ** 2 * likely / likely.sum())
            beyond = np.zeros_like(likely)
            if largest[k] > gate**2:
                at = np.unravel_index(np.argmax(likely), likely.shape)
                beyond[at] = size[about][at]
            sizes.append(beyond)
        merged, where = np.unique(np.round(np.concatenate(t) / TICK), return_inverse=True)
        total = np.zeros((2, len(merged), 2))
        for values, all_of in zip(total, (variance, sizes), strict=True):
            np.maximum.at(values, where, np.concatenate(all_of))
        shocks = Shocks(merged * TICK, *total)
        return self if shocks._settled(self) else shocks

    def _settled(self, before: "Shocks") -> bool:
        """Return whether variances have hardly grown."""
        return bool((self.variance.sum(axis=0) <= (1.0 + SETTLED) * before.variance.sum(axis=0)).all())

    def add_to(self, variance: np.ndarray, edges: np.ndarray) -> None:
        """Add to the variance (n, 2) of the steps between successive `edges` (n + 1,), in ticks, in place."""
        at = np.round(self.t / TICK).astype(np.int64)
        inside = (at > edges[0]) & (at <= edges[-1])
        np.add.at(variance, np.searchsorted(edges, at[inside]) - 1, self.variance[inside])


def believed(beyond: float) -> float:
    """Return the share of a step that is believed, 0 to 1, by how many times the gate it stands out."""
    ramp = min(max((beyond - BEGINNING) / (WHOLLY - BEGINNING), 0.0), 1.0)
    return ramp * ramp * (3.0 - 2.0 * ramp)


def _peaks(t: np.ndarray, values: np.ndarray, level: float) -> np.ndarray:
    """Return which values are above a level and the largest within `APART` of them, shape (n,)."""
    peaks = np.zeros(len(t), np.bool_)
    for k in np.flatnonzero(values > level):
        first, last = np.searchsorted(t, [t[k] - APART, t[k] + APART])
        peaks[k] = values[k] >= values[first:last].max()
    return peaks
