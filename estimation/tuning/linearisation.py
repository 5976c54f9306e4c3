"""The start that a segment is linearised about: its heading, and its tilt where nothing else tells it."""

import numpy as np

from estimation.attitude import error_rotation, turned_by
from estimation.filter import ForwardPass, Problem
from estimation.smoother import smooth
from estimation.states import ACCEL_BIAS, ATTITUDE

#: Tilt and the accelerometer's bias are known to begin with if their 1-sigma is below this, rad and m/s^2.
TILT_KNOWN, BIAS_KNOWN = 0.2, 0.5
#: Passes at most until the start of an IMU that was never calibrated settles, and what it then still turns by, rad.
RELINEARISED, SETTLED = 8, np.radians(0.5)


def relinearised(problem: Problem, result: ForwardPass, *, levelled: bool) -> np.ndarray:
    """Return the start to linearise about, shape (29,): that of the prior with its heading smoothed.

    The prior moves along. That does no harm to a heading, of which it says little. Tilt moves too where nothing but the
    force in flight told it, and it is as wide; and along with the accelerometer's bias where that is.
    """
    x = problem.x.copy()
    smoothed = smooth(problem, result).x[0]
    turn = error_rotation(x[6:10], smoothed[6:10])
    if problem.P[ACCEL_BIAS, ACCEL_BIAS] > BIAS_KNOWN**2:
        x[13:16] = smoothed[13:16]
    if not is_sought(problem.P, levelled=levelled):
        turn[:2] = 0.0
    x[6:10] = turned_by(x[6:10], turn)
    return x


def settled(before: np.ndarray, after: np.ndarray) -> bool:
    """Return whether two starts, shape (29,), linearise about the same attitude."""
    return bool(np.linalg.norm(error_rotation(before[6:10], after[6:10])) < SETTLED)


def is_sought(P: np.ndarray, *, levelled: bool) -> bool:
    """Return whether a start's tilt is so unknown that it takes several passes to find it."""
    return moves_bias(P, levelled=levelled) or bool(P[ATTITUDE, ATTITUDE] >= TILT_KNOWN**2)


def moves_bias(P: np.ndarray, *, levelled: bool) -> bool:
    """Return whether a start's tilt is as unknown as the accelerometer's bias that made it, so that both move."""
    return levelled and bool(P[ACCEL_BIAS, ACCEL_BIAS] > BIAS_KNOWN**2)
