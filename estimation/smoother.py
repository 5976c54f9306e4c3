"""The fixed-interval smoother over one segment of a log."""

from dataclasses import dataclass

import numpy as np

from estimation import _kernels
from estimation.filter import ForwardPass, Problem


@dataclass(frozen=True, slots=True)
class Smoothed:
    """Estimates that use the whole segment.

    Attributes
    ----------
    x : ndarray, shape (m, 26)
        Nominal states at the outputs.
    covariance : ndarray, shape (m, 9, 9)
        Covariance of position, velocity and attitude errors.
    slow_variance : ndarray, shape (m, 16)
        Variance of each sensor error.
    """

    x: np.ndarray
    covariance: np.ndarray
    slow_variance: np.ndarray


def smooth(problem: Problem, result: ForwardPass) -> Smoothed:
    """Walk back over a kept forward pass (modified Bryson-Frazier, Bierman 1973); no matrix is inverted.

    Sensor errors hardly change from row to row: they are smoothed in every eighth row and interpolated between.
    """
    rows = problem.outputs
    x = result.x.copy()
    covariance = np.empty((rows, _kernels.SLOW, _kernels.SLOW))
    variance = np.empty(result.sensor_rows.shape[:2])
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
        x,
        result.rows,
        result.sensor_rows,
        covariance,
        variance,
    )
    row = np.arange(rows)
    known = row[:: _kernels.SLOW_EVERY]
    errors = x[:, 10:]
    between = np.column_stack([np.interp(row, known, column) for column in np.hstack([errors[known], variance]).T])
    x[:, 10:] = between[:, : errors.shape[1]]
    return Smoothed(x, covariance, between[:, errors.shape[1] :])
