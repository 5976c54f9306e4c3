"""The fixed-interval smoother over one segment of a log."""

from dataclasses import dataclass

import numpy as np

from estimation import _kernels
from estimation.filter import ForwardPass, Problem
from estimation.states import SIZE

#: lam and Lam of the modified Bryson-Frazier smoother, shapes (26,), (26, 26).
Adjoint = tuple[np.ndarray, np.ndarray]


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


def new_adjoint() -> Adjoint:
    """Give the adjoint at the end of a segment, which nothing follows."""
    return np.zeros(SIZE), np.zeros((SIZE, SIZE))


def smooth(problem: Problem, result: ForwardPass) -> Estimates:
    """Walk back over a kept forward pass (modified Bryson-Frazier, Bierman 1973); no matrix is inverted.

    Sensor errors hardly change from row to row: they are smoothed in every eighth row and interpolated between.
    """
    return filled_in(smooth_piece(problem, result, new_adjoint()), smoothed=True)


def smooth_piece(problem: Problem, result: ForwardPass, adjoint: Adjoint) -> Estimates:
    """Walk back over a piece of a segment.

    Parameters
    ----------
    problem, result : Problem, ForwardPass
        Of the piece, its history kept.
    adjoint : pair of ndarray
        Of the piece behind it; becomes that before this one.

    Returns
    -------
    Estimates
        `slow_variance` of every eighth row, and sensor errors of `x` in these rows only: see `filled_in`.
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
        *adjoint,
        x,
        result.rows,
        result.sensor_rows,
        covariance,
        variance,
    )
    return Estimates(x, covariance, variance)


def filled_in(found: Estimates, *, smoothed: bool) -> Estimates:
    """Fill in what is known of every eighth row only: variances of sensor errors and, where smoothed, these errors."""
    if smoothed:
        row = np.arange(len(found.x))
        known = row[:: _kernels.SLOW_EVERY]
        for column in range(10, found.x.shape[1]):
            found.x[:, column] = np.interp(row, known, found.x[known, column]) if row.size else 0.0
    return Estimates(found.x, found.covariance, _between_rows(found.slow_variance, len(found.x)))


def filtered(result: ForwardPass) -> Estimates:
    """Give the forward pass's own estimates of a piece, which know nothing of what comes after; see `smooth_piece`."""
    slow = np.diagonal(result.sensor_rows[:, :, _kernels.SLOW :], axis1=1, axis2=2)
    return Estimates(result.x, result.rows[:, :, : _kernels.SLOW], slow)


def _between_rows(known: np.ndarray, rows: int) -> np.ndarray:
    """Interpolate what is known in every eighth row."""
    if rows == 0:
        return known
    row = np.arange(rows)
    return np.column_stack([np.interp(row, row[:: _kernels.SLOW_EVERY], column) for column in known.T])
