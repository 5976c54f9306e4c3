"""The fixed-interval smoother over one segment of a log."""

from dataclasses import dataclass

import numpy as np

from estimation import _kernels
from estimation.filter import ForwardPass, Problem


@dataclass(frozen=True, slots=True)
class Estimates:
    """What a segment gives at its outputs.

    Attributes
    ----------
    x : ndarray, shape (m, 27)
        Nominal states at the outputs.
    covariance : ndarray, shape (m, 9, 9)
        Covariance of position, velocity and attitude errors.
    slow_variance : ndarray, shape (m, 17)
        Variance of each sensor error.
    """

    x: np.ndarray
    covariance: np.ndarray
    slow_variance: np.ndarray


def smooth(problem: Problem, result: ForwardPass) -> Estimates:
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
    x[:, 10:] = _between_rows(x[:: _kernels.SLOW_EVERY, 10:], rows)
    return Estimates(x, covariance, _between_rows(variance, rows))


def filtered(result: ForwardPass) -> Estimates:
    """Give the forward pass's own estimates, which know nothing of what comes after."""
    slow = np.diagonal(result.sensor_rows[:, :, _kernels.SLOW :], axis1=1, axis2=2)
    covariance = result.rows[:, :, : _kernels.SLOW].copy()
    return Estimates(result.x, covariance, _between_rows(slow, len(result.x)))


def _between_rows(known: np.ndarray, rows: int) -> np.ndarray:
    """Interpolate what is known in every eighth row."""
    if rows == 0:
        return known
    row = np.arange(rows)
    return np.column_stack([np.interp(row, row[:: _kernels.SLOW_EVERY], column) for column in known.T])
