"""The fixed-interval smoother over one segment of a log."""

from dataclasses import dataclass

import numpy as np

from estimation import _kernels
from estimation.filter import ForwardPass, Problem
from estimation.states import SIZE


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Estimates that use the whole segment.

    Attributes
    ----------
    x : ndarray, shape (m, 26)
        Nominal states at the outputs.
    covariance : ndarray, shape (m, 9, 9)
        Covariance of position, velocity and attitude errors.
    variance : ndarray, shape (m, 25)
        Variance of each error state.
    """

    x: np.ndarray
    covariance: np.ndarray
    variance: np.ndarray


def smooth(problem: Problem, result: ForwardPass) -> Smoothed:
    """Walk back over a kept forward pass (modified Bryson-Frazier, Bierman 1973); no matrix is inverted."""
    rows = problem.outputs
    smoothed = Smoothed(result.x.copy(), np.empty((rows, 9, 9)), np.empty((rows, SIZE)))
    _kernels.backward(
        result.transition_time,
        result.transition_velocity,
        result.transition_rotation,
        problem.node_group,
        problem.node_out,
        problem.observations.start,
        result.innovation,
        result.inverse_variance,
        result.gain,
        result.index,
        result.value,
        problem.noise.gps_error_time,
        smoothed.x,
        result.P,
        smoothed.covariance,
        smoothed.variance,
    )
    return smoothed
