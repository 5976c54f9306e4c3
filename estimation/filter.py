"""The strapdown error-state Kalman filter over one segment of a log."""

from dataclasses import dataclass, replace

import numpy as np

from estimation import _kernels
from estimation.observations import Observations
from estimation.place import World
from estimation.shocks import Shocks
from estimation.states import FIELD, SIZE, TERRAIN, WANDERING, SensorNoise
from estimation.timing import TICK, TURNING, InertialSignal

#: Nodes are never further apart than this, s: the error state's transition is of first order in time.
LONGEST_STEP = 0.04
#: Sub-steps shorter than this, s, are merged where settings are only compared with each other.
COARSE = 0.008
#: White noise of a sensor is believed to be no less and no more than these times that of its class or its report: what
#: innovations do not show (rounding, errors that last) is there all the same, and averaging does not take it away.
QUIETEST, LOUDEST = 0.2, 5.0
#: A sensor beyond the gate for so long is believed and the state is not, s; so are two sensors together.
PATIENCE, TOGETHER = 10.0, 1.0


@dataclass(frozen=True, slots=True)
class Problem:
    """One segment as the kernels read it."""

    t: np.ndarray  #: shape (n,): Times of the nodes, s.
    #: shapes (k,), (k, 3), (k, 3), (k, 2): IMU increments of the sub-steps and the variance they add to attitude and
    #: velocity.
    sub_dt: np.ndarray
    sub_angle: np.ndarray
    sub_velocity: np.ndarray
    sub_noise: np.ndarray
    #: shape (n + 1,): Node i is reached by sub-steps ``node_sub[i]:node_sub[i + 1]`` and has measurement groups
    #: ``node_group[i]:node_group[i + 1]``.
    node_sub: np.ndarray
    node_group: np.ndarray
    node_out: np.ndarray  #: shape (n,): Row of the output, -1 for nodes that nobody asked for.
    observations: Observations
    world: World
    noise: SensorNoise
    #: shapes (29,), (28, 28): The start.
    x: np.ndarray
    P: np.ndarray
    white_scale: np.ndarray  #: shape (9,): Factor on the white variance of each kind of measurement.
    moves: bool  #: Whether the craft turns, and so can learn its heading.
    #: shape (28,): Variances at the beginning of the segment, of a piece that begins later; what wanders does so
    #: with its own.
    prior: np.ndarray | None = None

    @property
    def outputs(self) -> int:
        """Number of rows asked for."""
        return int(self.node_out.max(initial=-1)) + 1


@dataclass(frozen=True, slots=True)
class ForwardPass:
    """What the filter leaves: its estimates, innovations and, when kept, the history that the smoother walks back."""

    x: np.ndarray  #: shape (m, 29): Filtered nominal states at the outputs.
    rows: np.ndarray  #: shape (m, 9, 28): Rows of their covariances that belong to position, velocity and attitude.
    sensor_rows: np.ndarray  #: shape (ceil(m / 8), 19, 28): The other rows, of every eighth output.
    #: shape (s,): Of each scalar measurement; inverse variance 0 where it was refused.
    innovation: np.ndarray
    inverse_variance: np.ndarray
    variance: np.ndarray  #: shape (s,): Of each innovation by the filter's own account, however it was weighted.
    log_likelihood: float
    #: shapes (n,), (n, 3), (n, 3, 3): T, S and C of the transition to each node (see `_kernels`).
    transition_time: np.ndarray
    transition_velocity: np.ndarray
    transition_rotation: np.ndarray
    #: shapes (s, 28), (s, 7), (s, 7): Kalman gain of each scalar measurement and its row of H.
    gain: np.ndarray
    index: np.ndarray
    value: np.ndarray
    #: shapes (29,), (28, 28): State and covariance after the last measurement.
    last_state: np.ndarray
    last_covariance: np.ndarray


@dataclass(frozen=True, slots=True)
class Filtered:
    """What the filter has to say of a whole segment."""

    observations: Observations
    white_scale: np.ndarray  #: shape (9,)
    stop: float  #: Its end, s.
    #: shape (s,)
    innovation: np.ndarray
    inverse_variance: np.ndarray
    log_likelihood: float
    #: shapes (29,), (28, 28): As of `ForwardPass`.
    last_state: np.ndarray
    last_covariance: np.ndarray
    shocks: Shocks  #: Steps that the IMU missed.


def assemble(
    signal: InertialSignal,
    observations: Observations,
    outputs: np.ndarray,
    x: np.ndarray,
    P: np.ndarray,
    world: World,
    noise: SensorNoise,
    *,
    white_scale: np.ndarray | None = None,
    imu_scale: np.ndarray | None = None,
    start: float = -np.inf,
    stop: float = np.inf,
    finest: float = 0.0,
    moves: bool | None = None,
    prior: np.ndarray | None = None,
    shocks: Shocks | None = None,
) -> Problem:
    """Lay out nodes and sub-steps of one segment, or of a piece of it."""
    first, last = ticks(np.array([max(signal.start, start), min(signal.stop, stop)]))
    observations = observations.between(first * TICK, last * TICK)
    asked = ticks(outputs)
    measured = ticks(observations.t)
    filler = np.arange(first, last, round(LONGEST_STEP / TICK))
    nodes = _merged(np.array([first, last]), asked, measured, filler)
    imu = ticks(signal.samples_between(first * TICK, last * TICK))
    if finest > 0.0 and imu.size:
        share = imu // round(finest / TICK)
        imu = imu[np.concatenate([[True], np.diff(share) > 0])]
    steps = _merged(nodes, imu[(imu > first) & (imu < last)])
    t = steps * TICK
    angle, velocity, variance = signal.increments(t)
    variance = np.ascontiguousarray(variance if imu_scale is None else variance * imu_scale)
    if shocks is not None:
        shocks.add_to(variance, steps)
    node_sub = np.concatenate([[0], np.searchsorted(steps, nodes)])
    node_out = np.full(len(nodes), -1, np.int64)
    node_out[np.searchsorted(nodes, asked)] = np.arange(len(asked))
    return Problem(
        t=nodes * TICK,
        sub_dt=np.diff(t),
        sub_angle=np.ascontiguousarray(angle),
        sub_velocity=np.ascontiguousarray(velocity),
        sub_noise=variance,
        node_sub=node_sub.astype(np.int64),
        node_group=np.concatenate([[0], np.searchsorted(measured, nodes, side="right")]).astype(np.int64),
        node_out=node_out,
        observations=observations,
        world=world,
        noise=noise,
        x=x,
        P=P,
        white_scale=np.ones(_kernels.KINDS) if white_scale is None else white_scale,
        moves=bool(signal.beyond(TURNING).any()) if moves is None else moves,
        prior=prior,
    )


def _merged(*ticks: np.ndarray) -> np.ndarray:
    """Merge ticks into one ascending sequence without repetition."""
    merged = np.sort(np.concatenate(ticks))
    return np.asarray(merged[np.concatenate([[True], np.diff(merged) > 0])])


def ticks(t: np.ndarray) -> np.ndarray:
    """Round times to the grid on which nodes are merged."""
    return np.round(np.asarray(t, float) / TICK).astype(np.int64)


def new_memory(x: np.ndarray) -> np.ndarray:
    """Return what the filter remembers of a segment that begins with state x (see `_kernels`)."""
    memory = np.zeros(_kernels.MEMORY)
    memory[_kernels.FIELD : _kernels.RATE] = x[FIELD + 1 : TERRAIN + 1]
    return memory


def run(problem: Problem, *, keep: bool = True, hard: bool = False, memory: np.ndarray | None = None) -> ForwardPass:
    """Filter one segment, or a piece of it.

    Who smooths does better to fuse what is beyond the gate with little weight and to judge it by the past and the
    future (`smoother.refused`): a gate that knows the past only, once wrong, locks itself out.
    """
    o = problem.observations
    nodes, scalars, rows = len(problem.t), len(o.z), problem.outputs
    kept_nodes, kept_scalars = (nodes, scalars) if keep else (0, 0)
    x, P = problem.x.copy(), problem.P.copy()
    result = ForwardPass(
        x=np.empty((rows, SIZE + 1)),
        rows=np.empty((rows, _kernels.SLOW, SIZE)),
        sensor_rows=np.empty((-(-rows // _kernels.SLOW_EVERY), SIZE - _kernels.SLOW, SIZE)),
        innovation=np.empty(scalars),
        inverse_variance=np.zeros(scalars),
        variance=np.empty(scalars),
        log_likelihood=0.0,
        transition_time=np.empty(kept_nodes),
        transition_velocity=np.empty((kept_nodes, 3)),
        transition_rotation=np.empty((kept_nodes, 3, 3)),
        gain=np.empty((kept_scalars, SIZE)),
        index=np.zeros((kept_scalars, _kernels.ENTRIES), np.int64),
        value=np.zeros((kept_scalars, _kernels.ENTRIES)),
        last_state=x,
        last_covariance=P,
    )
    prior = np.diag(problem.P) if problem.prior is None else problem.prior
    likelihood = _kernels.forward(
        x,
        P,
        problem.sub_dt,
        problem.sub_angle,
        problem.sub_velocity,
        problem.sub_noise,
        problem.node_sub,
        problem.node_group,
        problem.node_out,
        o.kind,
        o.start,
        o.axis,
        o.z,
        o.variance,
        # A sensor that is not there has no error to wander.
        problem.noise.random_walks() * (prior > 0.0),
        problem.noise.wander_times(),
        np.ascontiguousarray(prior[WANDERING]),
        problem.world.gravity,
        problem.world.earth_rate,
        problem.white_scale,
        problem.noise.jitter(),
        problem.noise.gate,
        hard,
        PATIENCE,
        TOGETHER,
        o.admitted,
        problem.moves,
        new_memory(x) if memory is None else memory,
        keep,
        result.transition_time,
        result.transition_velocity,
        result.transition_rotation,
        result.innovation,
        result.inverse_variance,
        result.variance,
        result.gain,
        result.index,
        result.value,
        result.x,
        result.rows,
        result.sensor_rows,
    )
    symmetrise(P)
    return replace(result, log_likelihood=float(likelihood))


def symmetrise(matrix: np.ndarray) -> None:
    """Make a square matrix the mean of itself and its transpose, in place.

    What rounding makes of them apart, no measurement takes away: it grew with the cube of time, until after 80 minutes
    a covariance of one pass was none any more.
    """
    matrix[...] = 0.5 * (matrix + matrix.T)


def matched_scale(problem: Problem, result: ForwardPass) -> np.ndarray:
    """Scale each sensor's white variance so that innovations are as large as the filter expects (Mehra 1970).

    Medians stand for means, so that neither outliers nor the first seconds count. The scale is the same for a sensor
    throughout the log, and its root is between `QUIETEST` and `LOUDEST`.
    """
    o = problem.observations
    scale = np.ones(_kernels.KINDS)
    kinds = o.scalar_kind
    for kind in range(_kernels.KINDS):
        if kind == _kernels.GPS2_POSITION:
            # Its variance stands for a wander over minutes, which innovations do not show.
            continue
        mine = (kinds == kind) & (result.inverse_variance > 0.0)
        if np.count_nonzero(mine) < 30:
            continue
        nominal = o.variance[mine]
        state = np.median(1.0 / result.inverse_variance[mine] - problem.white_scale[kind] * nominal)
        # 0.4549 is the median of chi-square with one degree of freedom.
        wanted = np.median(result.innovation[mine] ** 2) / 0.4549 - state
        scale[kind] = min(max(wanted / np.median(nominal), QUIETEST**2), LOUDEST**2)
    return scale
