"""The strapdown error-state Kalman filter over one segment of a log."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from estimation import _kernels
from estimation._kernels import ForwardPass, Steps
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


@dataclass(frozen=True)
class FilterSegment:
    """One segment as the kernels read it."""

    t: np.ndarray  #: shape (n,): Times of the nodes, s.
    steps: Steps
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
        return int(self.steps.node_out.max(initial=-1)) + 1

    @cached_property
    def log_likelihood(self) -> float:
        """Log-likelihood of its observations, by a pass of the filter."""
        return run(self, keep=False).log_likelihood


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
) -> FilterSegment:
    """Set up nodes and sub-steps of one segment, or of a piece of it."""
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
    return FilterSegment(
        t=nodes * TICK,
        steps=Steps(
            np.diff(t),
            np.ascontiguousarray(angle),
            np.ascontiguousarray(velocity),
            variance,
            node_sub.astype(np.int64),
            np.concatenate([[0], np.searchsorted(measured, nodes, side="right")]).astype(np.int64),
            node_out,
        ),
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


def run(
    problem: FilterSegment, *, keep: bool = True, hard: bool = False, memory: np.ndarray | None = None
) -> ForwardPass:
    """Filter one segment, or a piece of it.

    Who smooths does better to fuse what is beyond the gate with little weight and to judge it by the past and the
    future (`smoother.refused`): a gate that knows the past only, once wrong, locks itself out.
    """
    o = problem.observations
    nodes, scalars, rows = len(problem.t), len(o.z), problem.outputs
    kept_nodes, kept_scalars = (nodes, scalars) if keep else (0, 0)
    prior = np.diag(problem.P) if problem.prior is None else problem.prior
    result = ForwardPass(
        x=np.empty((rows, SIZE + 1)),
        rows=np.empty((rows, _kernels.SLOW, SIZE)),
        sensor_rows=np.empty((-(-rows // _kernels.SLOW_EVERY), SIZE - _kernels.SLOW, SIZE)),
        innovation=np.empty(scalars),
        inverse_variance=np.zeros(scalars),
        variance=np.empty(scalars),
        transition_time=np.empty(kept_nodes),
        transition_velocity=np.empty((kept_nodes, 3)),
        transition_rotation=np.empty((kept_nodes, 3, 3)),
        gain=np.empty((kept_scalars, SIZE)),
        column=np.zeros((kept_scalars, _kernels.ENTRIES), np.int64),
        value=np.zeros((kept_scalars, _kernels.ENTRIES)),
        last_state=problem.x.copy(),
        last_covariance=problem.P.copy(),
    )
    noise = problem.noise
    model = _kernels.SensorModel(
        # A sensor that is not there has no error to wander.
        walk=noise.random_walks() * (prior > 0.0),
        wander_time=noise.wander_times(),
        wander_variance=np.ascontiguousarray(prior[WANDERING]),
        gravity=problem.world.gravity,
        earth_rate=problem.world.earth_rate,
        scale=problem.white_scale,
        jitter=noise.jitter(),
        gate=noise.gate,
        patience=PATIENCE,
        together=TOGETHER,
        moves=problem.moves,
        hard=hard,
    )
    memory = new_memory(problem.x) if memory is None else memory
    likelihood = _kernels.forward(problem.steps, o.readings, model, memory, result, keep)
    symmetrise(result.last_covariance)
    return result._replace(log_likelihood=float(likelihood))


def symmetrise(matrix: np.ndarray) -> None:
    """Make a square matrix the mean of itself and its transpose, in place.

    What rounding makes of them apart, no measurement takes away: it grew with the cube of time, until after 80 minutes
    a covariance of one pass was none any more.
    """
    matrix[...] = 0.5 * (matrix + matrix.T)


def matched_scale(problem: FilterSegment, result: ForwardPass) -> np.ndarray:
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
