"""Stretches without GPS: how much faster errors grow there than the model of the sensors says.

Between fixes a filter's sigma is that of its model: white noise, and biases that walk. Scales and axes of a real IMU,
and vibration that goes with throttle, are not in it. So where GPS stays away for long, the log is asked: fixes are held
back in turns where there are some, and the velocities that the filter then foretells are compared with those held back.
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
#: Kinds of measurement that are held back, those of them without which a receiver is out, and those foretold.
RECEIVERS = (*range(_kernels.BARO), _kernels.GPS2_POSITION, _kernels.GPS2_VELOCITY)
LEVEL = (_kernels.GPS_POSITION, _kernels.GPS_VELOCITY, _kernels.GPS2_POSITION, _kernels.GPS2_VELOCITY)
FORETOLD = (_kernels.GPS_VELOCITY, _kernels.GPS_CLIMB, _kernels.GPS2_VELOCITY)
#: How many times faster variances grow than stated on a craft of which nothing is known yet, which counts for one
#: outage: real craft show 1 to 16.
CLASS_EXCESS = 4.0


def outages(observations: Observations, start: float, stop: float) -> list[tuple[float, float]]:
    """Return from when to when no receiver was believed, s; none where there is no receiver."""
    t = observations.t[np.isin(observations.kind, LEVEL) & observations.admitted]
    if t.size == 0:
        return []
    return [(a, b) for a, b in pairwise([start, *t.tolist(), stop]) if b - a > LONGEST_SILENCE]


def excess(surprises: Callable[[Observations], np.ndarray], observations: Observations, start: float) -> np.ndarray:
    """Find how many times faster than stated variances grow without GPS, shape (3,)."""
    flown = np.isin(observations.kind, RECEIVERS) & observations.admitted & (observations.t > start)
    length = np.ptp(observations.t[flown]) if flown.any() else 0.0
    foretold = np.isin(observations.kind, FORETOLD)
    largest = np.ones(2)
    for held_back in HELD_BACK:
        turn = held_back + GIVEN
        squares: list[list[float]] = [[], []]
        for phase in np.arange(0.0, turn, held_back):
            since = (observations.t - start - phase) % turn - GIVEN
            held = flown & (since > 0.0) & (observations.t > start + phase)
            late = np.repeat(held & foretold & (since > 0.5 * held_back), np.diff(observations.start))
            if late.any():
                surprise = surprises(replace(observations, admitted=observations.admitted & ~held))
                for k, vertical in enumerate((False, True)):
                    squares[k] += surprise[late & ((observations.axis == 2) == vertical)].tolist()
        for k, values in enumerate(squares):
            weight = length / turn if values else 0.0
            seen = float(np.mean(values)) if values else 0.0
            largest[k] = max(largest[k], (CLASS_EXCESS + weight * seen) / (1.0 + weight))
    return largest[[0, 0, 1]]


def widen(covariance: np.ndarray, t: np.ndarray, spans: Sequence[tuple[float, float]], excess: np.ndarray) -> None:
    """Widen what is unknown in outages, in place."""
    variance = np.diagonal(covariance, axis1=2, axis2=3)
    factors = np.array([excess, excess, np.full(3, excess[0])])
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
