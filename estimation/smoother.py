"""The fixed-interval smoother over one segment of a log."""

import numpy as np

from estimation import _kernels
from estimation._kernels import Estimates, ForwardPass
from estimation.filter import FilterSegment, symmetrise
from estimation.observations import Observations
from estimation.shocks import NARROWING
from estimation.states import SIZE

#: Passes over a log at most. Each narrows the gate eightfold, so that more serve readings on the gate's edge only.
PASSES = 6


def admit(observations: Observations, deletion: np.ndarray, gate: float) -> np.ndarray:
    """Choose the groups of measurements for the next pass, shape (g,)."""
    if len(observations.t) == 0:
        return observations.admitted
    worst = np.sqrt(np.maximum.reduceat(np.append(deletion, 0.0), observations.start[:-1]))
    worst[np.diff(observations.start) == 0] = 0.0
    level = np.full(_kernels.KINDS, gate)
    for kind in range(_kernels.KINDS):
        mine = (observations.kind == kind) & observations.admitted
        if mine.any():
            level[kind] = max(gate, float(worst[mine].max()) / NARROWING)
    limit = np.where(observations.admitted, level[observations.kind], gate)
    return np.asarray(worst <= limit)


#: Rows that are filled in at a time, a multiple of `_kernels.SLOW_EVERY`: few enough to stay in the cache.
FILLED = 1024
#: lam and Lam of the modified Bryson-Frazier smoother, shapes (28,), (28, 28).
Adjoint = tuple[np.ndarray, np.ndarray]


def new_adjoint() -> Adjoint:
    """Return the adjoint at the end of a segment, which nothing follows."""
    return np.zeros(SIZE), np.zeros((SIZE, SIZE))


def smooth(problem: FilterSegment, result: ForwardPass) -> Estimates:
    """Walk back over a kept forward pass (modified Bryson-Frazier, Bierman 1973); no matrix is inverted.

    Sensor errors hardly change from row to row: they are smoothed in every eighth row and interpolated between.
    """
    estimates = smooth_piece(problem, result, new_adjoint())
    fill_in(estimates.x)
    return estimates._replace(slow_variance=between_rows(estimates.slow_variance, len(estimates.x)))


def smooth_piece(problem: FilterSegment, result: ForwardPass, adjoint: Adjoint) -> Estimates:
    """Walk back over a piece of a segment; sensor errors are those of every eighth row (see `fill_in`)."""
    rows = problem.outputs
    estimates = Estimates(
        x=result.x.copy(),
        covariance=np.empty((rows, 3, 3, 3)),
        slow_variance=np.empty(result.sensor_rows.shape[:2]),
        deletion=np.empty(len(result.innovation)),
        nodes=problem.t,
        shock=np.empty((len(problem.t), 2)),
        shock_size=np.empty((len(problem.t), 2)),
    )
    readings, times = problem.observations.readings, problem.noise.wander_times()
    _kernels.backward(problem.steps, readings, result, times, *adjoint, estimates)
    symmetrise(adjoint[1])
    return estimates


def fill_in(x: np.ndarray) -> None:
    """Fill in the sensor errors of smoothed states, shape (m, 29), of which every eighth row is known."""
    for first in range(0, len(x), FILLED):
        rows = min(FILLED, len(x) - first)
        known = x[first : first + FILLED + 1 : _kernels.SLOW_EVERY, 10:]
        x[first : first + rows, 10:] = between_rows(known, rows)


def filtered(result: ForwardPass) -> Estimates:
    """Return the forward pass's own estimates of a piece, from what came before alone; see `smooth_piece`."""
    slow = np.diagonal(result.sensor_rows[:, :, _kernels.SLOW :], axis1=1, axis2=2)
    nothing = np.empty((0, 2))
    unknown = np.full(len(result.innovation), np.nan)
    blocks = np.stack([result.rows[:, k : k + 3, k : k + 3] for k in range(0, _kernels.SLOW, 3)], axis=1)
    return Estimates(result.x, blocks, slow, unknown, np.empty(0), nothing, nothing)


def between_rows(known: np.ndarray, rows: int) -> np.ndarray:
    """Interpolate what is known in every eighth row, shape (ceil(rows / 8), c) or (ceil(rows / 8),), to all of them."""
    steps = np.diff(known, axis=0, append=known[-1:])
    parts = np.arange(_kernels.SLOW_EVERY).reshape(-1, *[1] * (known.ndim - 1)) / _kernels.SLOW_EVERY
    return np.asarray((known[:, None] + parts * steps[:, None]).reshape(-1, *known.shape[1:])[:rows])
