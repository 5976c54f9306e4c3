"""Stretches without GPS: how much faster errors grow there than the model of the sensors says.

Between fixes a filter's sigma is that of its model: white noise, and biases that walk. Scales and axes of a real IMU,
and vibration that goes with throttle, are not in it. So where GPS is lost for long, the rest of the log is asked: fixes
are held back in turns, and the velocities that the filter then predicts are compared with those held back.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from estimation import _kernels
from estimation.observations import Observations

#: A receiver silent for longer than this is out, s.
LONGEST_SILENCE = 5.0
#: For how long fixes are held back, and are given before they are held back again, s.
HELD_BACK, GIVEN = (8.0, 20.0), 8.0
#: Measurements of receivers, which are held back together.
RECEIVERS = (*range(_kernels.BARO), _kernels.GPS2_POSITION, _kernels.GPS2_VELOCITY)
#: Horizontal fixes: a receiver without any of them is out.
HORIZONTAL = (_kernels.GPS_POSITION, _kernels.GPS_VELOCITY, _kernels.GPS2_POSITION, _kernels.GPS2_VELOCITY)
#: Velocities, whose innovations after a stretch without fixes show how fast the variance grew.
VELOCITIES = (_kernels.GPS_VELOCITY, _kernels.GPS_CLIMB, _kernels.GPS2_VELOCITY)
#: How many times faster variances grow than stated on a craft of which nothing is known yet, which counts for one
#: outage: real craft show 1 to 16.
CLASS_GROWTH = 4.0


def outages(observations: Observations, start: float, stop: float) -> list[tuple[float, float]]:
    """Return from when to when no receiver was believed, s; empty where there is no receiver."""
    t = observations.t[np.isin(observations.kind, HORIZONTAL) & observations.admitted]
    if t.size == 0:
        return []
    return [(a, b) for a, b in pairwise([start, *t.tolist(), stop]) if b - a > LONGEST_SILENCE]


def variance_growth(nis: Callable[[Observations], np.ndarray], observations: Observations, start: float) -> np.ndarray:
    """Estimate how many times faster than stated variances grow without GPS, shape (3,).

    `nis` filters observations and returns the normalised innovation squared of each reading.
    """
    flown = np.isin(observations.kind, RECEIVERS) & observations.admitted & (observations.t > start)
    length = np.ptp(observations.t[flown]) if flown.any() else 0.0
    velocities = np.isin(observations.kind, VELOCITIES)
    largest = np.ones(2)
    for held_back in HELD_BACK:
        turn = held_back + GIVEN
        squares: list[list[float]] = [[], []]
        for phase in np.arange(0.0, turn, held_back):
            since = (observations.t - start - phase) % turn - GIVEN
            held = flown & (since > 0.0) & (observations.t > start + phase)
            late = np.repeat(held & velocities & (since > 0.5 * held_back), np.diff(observations.start))
            if late.any():
                squared = nis(replace(observations, admitted=observations.admitted & ~held))
                for k, vertical in enumerate((False, True)):
                    squares[k] += squared[late & ((observations.axis == 2) == vertical)].tolist()
        for k, values in enumerate(squares):
            weight = length / turn if values else 0.0
            mean = float(np.mean(values)) if values else 0.0
            largest[k] = max(largest[k], (CLASS_GROWTH + weight * mean) / (1.0 + weight))
    return largest[[0, 0, 1]]


def widen(covariance: np.ndarray, t: np.ndarray, spans: Sequence[tuple[float, float]], growth: np.ndarray) -> None:
    """Widen in outages, in place, what the covariance grew by since the fixes on both sides."""
    variance = np.diagonal(covariance, axis1=2, axis2=3)
    factors = np.array([growth, growth, np.full(3, growth[0])])
    for start, stop in spans:
        first, last = np.searchsorted(t, [start, stop])
        rows, edges = slice(first, last), [row for row in (first - 1, last) if 0 <= row < len(t)]
        if first == last or not edges:
            continue
        now = variance[rows]
        flat = variance[edges].reshape(len(edges), 9).T
        known = np.column_stack([np.interp(t[rows], t[edges], values) for values in flat]).reshape(-1, 3, 3)
        scale = np.sqrt(1.0 + (factors - 1.0) * np.maximum(1.0 - known / now, 0.0))
        covariance[rows] *= scale[..., :, None] * scale[..., None, :]
