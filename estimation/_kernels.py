"""Compiled loops of the strapdown filter and smoother: plain float64 arrays in and out.

A *node* is a time at which something is measured or asked for. Between nodes the nominal state is integrated in
sub-steps of the IMU; covariance moves from node to node only. With ``S`` the velocity gained by specific force in NED,
``C`` the integral of the body-to-NED matrix and ``T`` the time between two nodes, the transition of the error state is

    p' = p + T v;  v' = v - [S]x phi - C b_a;  phi' = phi - C b_g;  e' = a e (what wanders, `WANDERS`)

and identity elsewhere: only these entries are ever multiplied. Measurements are scalar with at most seven entries in
their row of H, so no matrix is inverted. The smoother is the modified Bryson-Frazier form (Bierman 1973), which runs on
the adjoint ``lam``, ``Lam`` and needs the covariance only where a result is wanted.

Kernels work on matrices that they make themselves: only of these does the compiler know how far apart rows lie, without
which it works on single numbers. Loops over their rows end at a number that it does not know (``states`` is `N`), since
written out they take longer to compile and to run. Those over columns end at `N`.
"""

from typing import NamedTuple

import numpy as np

from core.compiled import inner, njit
from core.kernel_types import Blocks, Flags, Int64Rows, Int64s, Matrix, Stack, Vector

Array = np.ndarray

N = 28  # states.SIZE; a literal so that loops have constant bounds
SLOW = 9  # states from here on are sensor errors, which change slowly
SLOW_EVERY = 8  # their smoothed values are worked out for every eighth output row
ENTRIES = 7  # most entries that a row of H has
FARTHEST = 0.3  # rad; headings further than this from the first one are a new first one

# What the filter remembers from node to node besides state and covariance: how long each kind has not been believed,
# whether its last reading was beyond the gate, the heading since the first one, the field at the start, rate and
# acceleration now.
DOUBTED, BEYOND, HEADING, FIELD, RATE, ACCELERATION, MEMORY = 0, 9, 18, 19, 22, 25, 28
# First of the error states that wander about zero (Gauss-Markov), and the first behind them.
WANDERS, STEADY = 19, 24

# Kinds of measurement groups.
GPS_POSITION, GPS_HEIGHT, GPS_VELOCITY, GPS_CLIMB, BARO, MAG, GPS2_POSITION, GPS2_VELOCITY, RANGE = range(9)
KINDS = 9
# The receiver or sensor that each kind comes from: what one of them measures may be wrong together.
SOURCES = np.array([0, 0, 0, 0, 1, 2, 3, 3, 4])
# Innovations beyond so many sigma pull less the further out they are, s.d.
BOUND = 3.0
# What attitude is widened by when several sensors speak against the state, rad^2.
DOUBTED_TILT = 0.03

_FLAGS = {"reassoc", "contract", "nsz"}


class Steps(NamedTuple):
    """How a piece of a segment is laid out."""

    #: shapes (k,), (k, 3), (k, 3), (k, 2): IMU increments of the sub-steps and the variance they add to attitude and
    #: velocity.
    sub_dt: Vector
    sub_angle: Matrix
    sub_velocity: Matrix
    sub_noise: Matrix
    #: shape (n + 1,): Node i is reached by sub-steps ``node_sub[i]:node_sub[i + 1]`` and has measurement groups
    #: ``node_group[i]:node_group[i + 1]``.
    node_sub: Int64s
    node_group: Int64s
    node_out: Int64s  #: shape (n,): Row of the output, -1 for nodes that nobody asked for.


class Measurements(NamedTuple):
    """Groups of scalar measurements; see `observations.Observations`."""

    kind: Int64s
    start: Int64s
    axis: Int64s
    z: Vector
    variance: Vector
    admitted: Flags


class SensorModel(NamedTuple):
    """What the filter believes of the sensors, and of the world about them."""

    walk: Vector
    wander_time: Vector
    wander_variance: Vector
    gravity: float
    earth_rate: Vector
    scale: Vector
    jitter: Vector
    gate: float
    patience: float  #: A sensor beyond the gate for so long [s] is believed and the state is not ...
    together: float  #: ... and so are two sensors after this.
    moves: bool  #: Whether the craft can learn its heading.
    hard: bool  #: Whether what is beyond the gate is refused, for who cannot look back over the whole log.


class ForwardPass(NamedTuple):
    """What the filter leaves: its estimates, innovations and, when kept, the history that the smoother walks back."""

    x: Matrix  #: shape (m, 29): Filtered nominal states at the outputs.
    rows: Stack  #: shape (m, 9, 28): Rows of their covariances that belong to position, velocity and attitude.
    sensor_rows: Stack  #: shape (ceil(m / 8), 19, 28): The other rows, of every eighth output.
    #: shape (s,): Of each scalar measurement; inverse variance 0 where it was refused.
    innovation: Vector
    inverse_variance: Vector
    variance: Vector  #: shape (s,): Of each innovation by the filter's own account, however it was weighted.
    #: shapes (n,), (n, 3), (n, 3, 3): T, S and C of the transition to each node.
    transition_time: Vector
    transition_velocity: Matrix
    transition_rotation: Stack
    #: shapes (s, 28), (s, 7), (s, 7): Kalman gain of each scalar measurement and its row of H.
    gain: Matrix
    column: Int64Rows
    value: Matrix
    #: shapes (29,), (28, 28): State and covariance after the last measurement; to begin with, the start.
    last_state: Vector
    last_covariance: Matrix
    log_likelihood: float = 0.0


class Estimates(NamedTuple):
    """What a segment gives at its outputs."""

    x: Matrix  #: shape (m, 29): Nominal states at the outputs.
    covariance: Blocks  #: shape (m, 3, 3, 3): Covariances of position, of velocity and of attitude errors.
    slow_variance: Matrix  #: shape (ceil(m / 8), 19), or (m, 19) of `smooth`: Variance of each sensor error.
    #: shape (s,): How far each scalar measurement lies from what all the others say, squared and over its variance (de
    #: Jong & Penzer 1998); NaN where nothing was smoothed.
    deletion: Vector
    nodes: Vector  #: shape (n,): Times of the filter's nodes, s.
    #: shape (n, 2): Step of attitude and of velocity at each node that all measurements together ask for beyond the
    #: noise of the IMU: squared and over its variance, and its size, rad and m/s.
    shock: Matrix
    shock_size: Matrix


@inner(nogil=True)
def _rotation(state: Array, R: Array) -> None:
    """Fill the body-to-NED matrix of a nominal state."""
    w, x, y, z = state[6], state[7], state[8], state[9]
    R[0, 0] = w * w + x * x - y * y - z * z
    R[0, 1] = 2.0 * (x * y - w * z)
    R[0, 2] = 2.0 * (x * z + w * y)
    R[1, 0] = 2.0 * (x * y + w * z)
    R[1, 1] = w * w - x * x + y * y - z * z
    R[1, 2] = 2.0 * (y * z - w * x)
    R[2, 0] = 2.0 * (x * z - w * y)
    R[2, 1] = 2.0 * (y * z + w * x)
    R[2, 2] = w * w - x * x - y * y + z * z


@inner(nogil=True)
def _copy(one: Array, other: Array) -> None:
    """Copy a matrix of N x N; as an assignment of arrays it takes seconds to compile."""
    for i in range(N):
        for j in range(N):
            other[i, j] = one[i, j]


@inner(nogil=True)
def _turn(state: Array, rx: float, ry: float, rz: float, in_body: bool) -> None:
    """Turn a nominal state by a rotation vector in body axes (right product) or NED axes (left product)."""
    angle2 = rx * rx + ry * ry + rz * rz
    # Series of cos(a/2) and sin(a/2)/a: exact to 1e-12 for the small angles of a step, and free of 0/0.
    if angle2 < 0.01:
        c = 1.0 - angle2 / 8.0 + angle2 * angle2 / 384.0
        s = 0.5 - angle2 / 48.0 + angle2 * angle2 / 3840.0
    else:
        angle = np.sqrt(angle2)
        c = np.cos(0.5 * angle)
        s = np.sin(0.5 * angle) / angle
    x, y, z = s * rx, s * ry, s * rz
    w0, x0, y0, z0 = state[6], state[7], state[8], state[9]
    sign = 1.0 if in_body else -1.0
    w1 = c * w0 - x * x0 - y * y0 - z * z0
    x1 = c * x0 + w0 * x + sign * (y0 * z - z0 * y)
    y1 = c * y0 + w0 * y + sign * (z0 * x - x0 * z)
    z1 = c * z0 + w0 * z + sign * (x0 * y - y0 * x)
    norm = 1.0 / np.sqrt(w1 * w1 + x1 * x1 + y1 * y1 + z1 * z1)
    state[6], state[7], state[8], state[9] = w1 * norm, x1 * norm, y1 * norm, z1 * norm


@inner(nogil=True, fastmath=_FLAGS)
def _propagate_covariance(P: Array, T: float, S: Array, C: Array, stay: Array, fast: int) -> None:
    """P <- F P F' in place; the first nine rows and columns (`fast` of them) and those of what wanders change."""
    # Numbers, not entries of arrays that P might overlap: so the loops work on several columns at once.
    s0, s1, s2 = S[0], S[1], S[2]
    c00, c01, c02 = C[0, 0], C[0, 1], C[0, 2]
    c10, c11, c12 = C[1, 0], C[1, 1], C[1, 2]
    c20, c21, c22 = C[2, 0], C[2, 1], C[2, 2]
    for k in range(N):
        P[0, k] += T * P[3, k]
        P[1, k] += T * P[4, k]
        P[2, k] += T * P[5, k]
        P[3, k] += s2 * P[7, k] - s1 * P[8, k] - (c00 * P[12, k] + c01 * P[13, k] + c02 * P[14, k])
        P[4, k] += s0 * P[8, k] - s2 * P[6, k] - (c10 * P[12, k] + c11 * P[13, k] + c12 * P[14, k])
        P[5, k] += s1 * P[6, k] - s0 * P[7, k] - (c20 * P[12, k] + c21 * P[13, k] + c22 * P[14, k])
        P[6, k] -= c00 * P[9, k] + c01 * P[10, k] + c02 * P[11, k]
        P[7, k] -= c10 * P[9, k] + c11 * P[10, k] + c12 * P[11, k]
        P[8, k] -= c20 * P[9, k] + c21 * P[10, k] + c22 * P[11, k]
    for i in range(WANDERS, STEADY):
        a = stay[i - WANDERS]
        for k in range(N):
            P[i, k] *= a
    for i in range(fast):
        r = P[i]
        r[0] += T * r[3]
        r[1] += T * r[4]
        r[2] += T * r[5]
        r[3] += s2 * r[7] - s1 * r[8] - (c00 * r[12] + c01 * r[13] + c02 * r[14])
        r[4] += s0 * r[8] - s2 * r[6] - (c10 * r[12] + c11 * r[13] + c12 * r[14])
        r[5] += s1 * r[6] - s0 * r[7] - (c20 * r[12] + c21 * r[13] + c22 * r[14])
        r[6] -= c00 * r[9] + c01 * r[10] + c02 * r[11]
        r[7] -= c10 * r[9] + c11 * r[10] + c12 * r[11]
        r[8] -= c20 * r[9] + c21 * r[10] + c22 * r[11]
        for k in range(WANDERS, STEADY):
            r[k] *= stay[k - WANDERS]
    for i in range(fast, N):
        for k in range(9):
            P[i, k] = P[k, i]
        for k in range(WANDERS, STEADY):
            P[i, k] *= stay[k - WANDERS]


@inner(nogil=True, fastmath=_FLAGS)
def _propagate_adjoint(lam: Array, Lam: Array, T: float, S: Array, C: Array, stay: Array, states: int) -> None:
    """Compute lam <- F' lam and Lam <- F' Lam F in place, the transpose of `_propagate_covariance`."""
    s0, s1, s2 = S[0], S[1], S[2]
    c00, c01, c02 = C[0, 0], C[0, 1], C[0, 2]
    c10, c11, c12 = C[1, 0], C[1, 1], C[1, 2]
    c20, c21, c22 = C[2, 0], C[2, 1], C[2, 2]
    for k in range(N):
        Lam[9, k] -= c00 * Lam[6, k] + c10 * Lam[7, k] + c20 * Lam[8, k]
        Lam[10, k] -= c01 * Lam[6, k] + c11 * Lam[7, k] + c21 * Lam[8, k]
        Lam[11, k] -= c02 * Lam[6, k] + c12 * Lam[7, k] + c22 * Lam[8, k]
        Lam[12, k] -= c00 * Lam[3, k] + c10 * Lam[4, k] + c20 * Lam[5, k]
        Lam[13, k] -= c01 * Lam[3, k] + c11 * Lam[4, k] + c21 * Lam[5, k]
        Lam[14, k] -= c02 * Lam[3, k] + c12 * Lam[4, k] + c22 * Lam[5, k]
        Lam[6, k] += s1 * Lam[5, k] - s2 * Lam[4, k]
        Lam[7, k] += s2 * Lam[3, k] - s0 * Lam[5, k]
        Lam[8, k] += s0 * Lam[4, k] - s1 * Lam[3, k]
        Lam[3, k] += T * Lam[0, k]
        Lam[4, k] += T * Lam[1, k]
        Lam[5, k] += T * Lam[2, k]
    for i in range(WANDERS, STEADY):
        a = stay[i - WANDERS]
        for k in range(N):
            Lam[i, k] *= a
    # From both sides in these rows only, since Lam stays symmetric; behind them once for lam.
    for i in range(3, states - 12):
        r = Lam[i] if i < 15 else lam
        r[9] -= c00 * r[6] + c10 * r[7] + c20 * r[8]
        r[10] -= c01 * r[6] + c11 * r[7] + c21 * r[8]
        r[11] -= c02 * r[6] + c12 * r[7] + c22 * r[8]
        r[12] -= c00 * r[3] + c10 * r[4] + c20 * r[5]
        r[13] -= c01 * r[3] + c11 * r[4] + c21 * r[5]
        r[14] -= c02 * r[3] + c12 * r[4] + c22 * r[5]
        r[6] += s1 * r[5] - s2 * r[4]
        r[7] += s2 * r[3] - s0 * r[5]
        r[8] += s0 * r[4] - s1 * r[3]
        r[3] += T * r[0]
        r[4] += T * r[1]
        r[5] += T * r[2]
    for i in range(states):
        if i < 3 or i >= 15:
            for k in range(3, 15):
                Lam[i, k] = Lam[k, i]
        for k in range(WANDERS, STEADY):
            Lam[i, k] *= stay[k - WANDERS]
    for k in range(WANDERS, STEADY):
        lam[k] *= stay[k - WANDERS]


@inner(nogil=True)
def _observe(
    kind: int,
    axis: int,
    x: Array,
    R: Array,
    rate: Array,
    acceleration: Array,
    heading: float,
    field: Array,
    index: Array,
    value: Array,
) -> tuple[float, int, float]:
    """Predict one scalar measurement and fill its row of H (index, value).

    `heading` is by how much measurements have turned the craft about down since it had the heading, and `field` the
    magnetic field, at which the rows of the magnetometer are taken.
    Gives the prediction, the number of entries and how fast the prediction changes with time.
    """
    if kind in (GPS_POSITION, GPS_HEIGHT):
        index[0], value[0] = axis, 1.0
        index[1], value[1] = 19 + axis, 1.0
        return x[axis] + x[20 + axis], 2, x[3 + axis]
    if kind == GPS_CLIMB:
        index[0], value[0] = 5, 1.0
        index[1], value[1] = 22, 1.0
        return x[5] + x[23], 2, acceleration[2]
    if kind == BARO:
        index[0], value[0] = 2, -1.0
        index[1], value[1] = 15, 1.0
        index[2], value[2] = 23, 1.0
        return x[16] + x[24] - x[2], 3, x[5]
    if kind == MAG:
        # R' exp(-[phi]x) m = R' m + R' [m]x phi. Heading and hard iron of a craft that does not turn cannot be told
        # apart; rows of H taken at ever new headings would pretend that they can (Huang, Mourikis & Roumeliotis 2010).
        # So the row of a craft that never moves belongs to its first heading; the field's is that of the prior.
        c, s = np.cos(heading), np.sin(heading)
        r0 = c * R[0, axis] + s * R[1, axis]
        r1 = c * R[1, axis] - s * R[0, axis]
        r2 = R[2, axis]
        m0, m1, m2 = field[0], field[1], field[2]
        index[0], value[0] = 6, r1 * m2 - r2 * m1
        index[1], value[1] = 7, r2 * m0 - r0 * m2
        index[2], value[2] = 8, r0 * m1 - r1 * m0
        index[3], value[3] = 16 + axis, 1.0
        index[4], value[4] = 24, r0
        index[5], value[5] = 25, r1
        index[6], value[6] = 26, r2
        m0, m1, m2 = x[25], x[26], x[27]
        j, k = (axis + 1) % 3, (axis + 2) % 3
        b_j = R[0, j] * m0 + R[1, j] * m1 + R[2, j] * m2
        b_k = R[0, k] * m0 + R[1, k] * m1 + R[2, k] * m2
        b = R[0, axis] * m0 + R[1, axis] * m1 + R[2, axis] * m2
        return b + x[17 + axis], 7, rate[k] * b_j - rate[j] * b_k
    if kind == GPS2_POSITION:
        index[0], value[0] = axis, 1.0
        return x[axis], 1, x[3 + axis]
    if kind == RANGE:
        # Distance along the body's down axis to level ground at height x[28].
        cosine = max(R[2, 2], 0.5)
        distance = (-x[2] - x[28]) / cosine
        index[0], value[0] = 2, -1.0 / cosine
        index[1], value[1] = 6, -distance * R[1, 2] / cosine
        index[2], value[2] = 7, distance * R[0, 2] / cosine
        index[3], value[3] = 27, -1.0 / cosine
        return distance, 4, -x[5] / cosine
    index[0], value[0] = 3 + axis, 1.0
    return x[3 + axis], 1, acceleration[axis]


@inner(nogil=True)
def _inject(x: Array, dx: Array) -> None:
    """Add an error state to the nominal state (p v q b_g b_a b_baro b_m e m h, 29 numbers)."""
    for i in range(6):
        x[i] += dx[i]
    _turn(x, dx[6], dx[7], dx[8], False)
    for i in range(9, N):
        x[i + 1] += dx[i]


@inner(nogil=True)
def _advance(
    x: Array,
    R: Array,
    dt: float,
    angle: Array,
    velocity: Array,
    gravity: float,
    earth_rate: Array,
    S: Array,
    C: Array,
    rate: Array,
    acceleration: Array,
) -> None:
    """Integrate the nominal state over one sub-step, adding to S and C; R, rate and acceleration end up current."""
    # Rate and force less their biases; Earth's rotation as seen from the body.
    ax = angle[0] - dt * (x[10] + R[0, 0] * earth_rate[0] + R[2, 0] * earth_rate[2])
    ay = angle[1] - dt * (x[11] + R[0, 1] * earth_rate[0] + R[2, 1] * earth_rate[2])
    az = angle[2] - dt * (x[12] + R[0, 2] * earth_rate[0] + R[2, 2] * earth_rate[2])
    ux = velocity[0] - dt * x[13]
    uy = velocity[1] - dt * x[14]
    uz = velocity[2] - dt * x[15]
    # The body turns by half the angle while it accelerates.
    bx = ux + 0.5 * (ay * uz - az * uy)
    by = uy + 0.5 * (az * ux - ax * uz)
    bz = uz + 0.5 * (ax * uy - ay * ux)
    sn = R[0, 0] * bx + R[0, 1] * by + R[0, 2] * bz
    se = R[1, 0] * bx + R[1, 1] * by + R[1, 2] * bz
    sd = R[2, 0] * bx + R[2, 1] * by + R[2, 2] * bz
    # Coriolis: -2 w_ie x v with w_ie = (w_n, 0, w_d).
    gn = sn + 2.0 * dt * earth_rate[2] * x[4]
    ge = se + 2.0 * dt * (earth_rate[0] * x[5] - earth_rate[2] * x[3])
    gd = sd + dt * (gravity - 2.0 * earth_rate[0] * x[4])
    x[0] += dt * (x[3] + 0.5 * gn)
    x[1] += dt * (x[4] + 0.5 * ge)
    x[2] += dt * (x[5] + 0.5 * gd)
    x[3] += gn
    x[4] += ge
    x[5] += gd
    for i in range(3):
        for j in range(3):
            C[i, j] += 0.5 * dt * R[i, j]
    _turn(x, ax, ay, az, True)
    _rotation(x, R)
    for i in range(3):
        for j in range(3):
            C[i, j] += 0.5 * dt * R[i, j]
    S[0] += sn
    S[1] += se
    S[2] += sd
    rate[0], rate[1], rate[2] = ax / dt, ay / dt, az / dt
    acceleration[0], acceleration[1], acceleration[2] = gn / dt, ge / dt, gd / dt


@inner(nogil=True, fastmath=_FLAGS)
def _row_times_covariance(P: Array, index: Array, value: Array, count: int, PH: Array) -> None:
    """Fill PH with a row of H times P."""
    row, factor = index[0], value[0]
    for i in range(N):
        PH[i] = factor * P[row, i]
    for j in range(1, count):
        row, factor = index[j], value[j]
        for i in range(N):
            PH[i] += factor * P[row, i]


@inner(nogil=True, fastmath=_FLAGS)
def _take_outer_product(P: Array, left: Array, right: Array, states: int) -> None:
    """P <- P - left right' in place, two rows at a time: of single rows the compiler makes single numbers."""
    for i in range(0, states, 2):
        first, second = left[i], left[i + 1]
        for j in range(N):
            factor = right[j]
            P[i, j] -= first * factor
            P[i + 1, j] -= second * factor


@inner(nogil=True, fastmath=_FLAGS)
def _fuse(
    x: Array,
    P: Array,
    nu: float,
    variance: float,
    index: Array,
    value: Array,
    count: int,
    gain: Array,
    PH: Array,
    states: int,
) -> tuple[float, float]:
    """Fuse one scalar innovation in place and fill the gain; PH (28,) is scratch.

    Returns the inverse variance that the innovation was given, and its variance by the filter's own account.
    """
    _row_times_covariance(P, index, value, count, PH)
    for j in range(count):
        variance += value[j] * PH[index[j]]
    # Beyond three sigma the variance grows with the innovation, so its pull falls (see `_log_density`).
    inv = 1.0 / max(variance, nu * nu / (BOUND * BOUND))
    for i in range(N):
        gain[i] = PH[i] * inv
    _take_outer_product(P, gain, PH, states)
    for i in range(N):
        PH[i] = gain[i] * nu
    _inject(x, PH)
    return inv, variance


@inner(nogil=True)
def _gain_unused(P: Array, variance: float, index: Array, value: Array, count: int, gain: Array) -> None:
    """Fill the gain that a measurement with this innovation variance would have."""
    _row_times_covariance(P, index, value, count, gain)
    for i in range(N):
        gain[i] /= variance


@inner(nogil=True)
def _keep_scalar(
    m: int,
    count: int,
    gain: Array,
    index: Array,
    value: Array,
    scalar_K: Array,
    scalar_index: Array,
    scalar_value: Array,
) -> None:
    """Keep gain and row of H of one scalar for the smoother."""
    for i in range(N):
        scalar_K[m, i] = gain[i]
    for j in range(ENTRIES):
        scalar_index[m, j] = index[j]
        scalar_value[m, j] = value[j] if j < count else 0.0


@inner(nogil=True)
def _log_density(nu: float, variance: float) -> float:
    """Return the log-density of an innovation, without the constant.

    Normal within three sigma; beyond, the tail falls with the ninth power, whose influence function is that of the
    weights in `_fuse`. So an outlier pulls little, but each one costs more the smaller a setting makes its sigma.
    """
    z2 = nu * nu / variance
    if z2 > BOUND * BOUND:
        z2 = BOUND * BOUND * (1.0 + np.log(z2 / (BOUND * BOUND)))
    return float(-0.5 * (np.log(variance) + z2))


@inner(nogil=True)
def _joined_doubt(kind: int, doubted: Array, beyond: Array, together: float) -> bool:
    """Return whether another sensor than that of `kind` has been beyond the gate for long enough, too."""
    for other in range(KINDS):
        if SOURCES[other] != SOURCES[kind] and beyond[other] > 0.0 and doubted[other] > together:
            return True
    return False


@inner(nogil=True)
def _doubt_state(P: Array, kind: int, axis: int, nu: float) -> None:
    """Widen what a scalar measures by its innovation, so that it can pull the state back.

    It was beyond the gate for so long, or together with another sensor, that the state is the likelier culprit.
    Unmodelled movement is process noise, which the smoother need not be told.
    """
    if kind == MAG:
        for i in range(6, 9):
            P[i, i] += 0.1
    elif kind == BARO:
        P[15, 15] += nu * nu
    elif kind == RANGE:
        P[27, 27] += nu * nu
    else:
        row = axis + (0 if kind in (GPS_POSITION, GPS_HEIGHT, GPS2_POSITION) else 3)
        P[row, row] += nu * nu


@inner(nogil=True)
def _write_row(x: Array, P: Array, out: int, out_x: Array, out_P: Array, slow_P: Array) -> None:
    """Keep state and covariance for one row of the output, that of the sensor errors in every eighth."""
    for i in range(x.size):
        out_x[out, i] = x[i]
    for i in range(SLOW):
        for j in range(N):
            out_P[out, i, j] = P[i, j]
    if out % SLOW_EVERY == 0:
        for i in range(SLOW, N):
            for j in range(N):
                slow_P[out // SLOW_EVERY, i - SLOW, j] = P[i, j]


@njit(cache=True, nogil=True)
def forward(
    steps: Steps, readings: Measurements, model: SensorModel, memory: Vector, kept: ForwardPass, keep: bool
) -> float:
    """Run the filter over all nodes; return the log-likelihood without the constant, of what is refused too.

    State and covariance of `kept` are the start and are left at the end. ``memory`` (28,) is what else the filter knows
    at the start, and is left at the end, so that a long segment can be filtered in pieces. ``keep`` tells whether the
    history for the smoother is written.
    """
    sub_dt, sub_angle, sub_velocity, sub_noise, node_sub, node_group, node_out = steps
    group_kind, group_start, scalar_axis, scalar_z, scalar_var, admitted = readings
    walk, wander_time, wander_variance, gravity, earth_rate, scale = model[:6]
    jitter, gate, patience, together, moves, hard = model[6:]
    out_x, out_P, slow_P, scalar_nu, scalar_inv, scalar_S = kept[:6]
    node_T, node_S, node_C, scalar_K, scalar_index, scalar_value, x, covariance = kept[6:14]
    P = np.empty((N, N))
    _copy(covariance, P)
    R = np.empty((3, 3))
    S = np.empty(3)
    C = np.empty((3, 3))
    gain = np.empty(N)
    scratch = np.empty(N)
    stay = np.empty(STEADY - WANDERS)
    index = np.zeros(ENTRIES, np.int64)
    value = np.zeros(ENTRIES)
    doubted = memory[DOUBTED:BEYOND]
    beyond = memory[BEYOND:HEADING]
    field = memory[FIELD:RATE]
    rate = memory[RATE:ACCELERATION]
    acceleration = memory[ACCELERATION:MEMORY]
    heading = memory[HEADING]
    likelihood = 0.0
    _rotation(x, R)
    for node in range(node_out.shape[0]):
        T = 0.0
        phi_var = 0.0
        v_var = 0.0
        for i in range(3):
            S[i] = 0.0
            for j in range(3):
                C[i, j] = 0.0
        for k in range(node_sub[node], node_sub[node + 1]):
            T += sub_dt[k]
            phi_var += sub_noise[k, 0]
            v_var += sub_noise[k, 1]
            _advance(x, R, sub_dt[k], sub_angle[k], sub_velocity[k], gravity, earth_rate, S, C, rate, acceleration)
        if T > 0.0:
            for i in range(STEADY - WANDERS):
                stay[i] = np.exp(-T / wander_time[i])
            _propagate_covariance(P, T, S, C, stay, out_P.shape[1])
            for i in range(3):
                P[3 + i, 3 + i] += v_var
                P[6 + i, 6 + i] += phi_var
            for i in range(STEADY - WANDERS):
                x[WANDERS + 1 + i] *= stay[i]
                P[WANDERS + i, WANDERS + i] += (1.0 - stay[i] * stay[i]) * wander_variance[i]
            for i in range(9, N - 1):
                P[i, i] += T * walk[i]
            # The ground changes as the craft moves over it.
            P[27, 27] += T * walk[27] * np.sqrt(x[3] * x[3] + x[4] * x[4])
            for kind in range(KINDS):
                doubted[kind] += T
        if keep:
            node_T[node] = T
            for i in range(3):
                node_S[node, i] = S[i]
                for j in range(3):
                    node_C[node, i, j] = C[i, j]
        for group in range(node_group[node], node_group[node + 1]):
            kind = group_kind[group]
            first, last = group_start[group], group_start[group + 1]
            worst = 0.0
            loss = 0.0
            for m in range(first, last):
                z, count, speed = _observe(kind, scalar_axis[m], x, R, rate, acceleration, heading, field, index, value)
                nu = scalar_z[m] - z
                s = scale[kind] * scalar_var[m] + (jitter[kind] * speed) ** 2
                for j in range(count):
                    for i in range(count):
                        s += value[i] * value[j] * P[index[i], index[j]]
                loss += _log_density(nu, s)
                scalar_nu[m] = nu
                scalar_inv[m] = 0.0
                scalar_S[m] = s
                # What the sensor's class may do is never refused, however quiet this one is.
                s += scalar_var[m]
                if nu * nu > worst * s:
                    worst = nu * nu / s
            if worst > gate * gate and admitted[group]:
                beyond[kind] = 1.0
                joined = _joined_doubt(kind, doubted, beyond, together)
                if doubted[kind] > patience or (joined and doubted[kind] > together):
                    for m in range(first, last):
                        _doubt_state(P, kind, scalar_axis[m], scalar_nu[m])
                    if joined:
                        # Several sensors that agree against the state: attitude may be as wrong as the rest.
                        for i in range(6, 9):
                            P[i, i] += DOUBTED_TILT
                    beyond[kind] = 0.0
                    doubted[kind] = 0.0
                elif hard:
                    likelihood += loss
                    continue
            elif admitted[group]:
                beyond[kind] = 0.0
                doubted[kind] = 0.0
            for m in range(first, last):
                z, count, speed = _observe(kind, scalar_axis[m], x, R, rate, acceleration, heading, field, index, value)
                if not admitted[group]:
                    if keep:
                        _gain_unused(P, scalar_S[m], index, value, count, gain)
                        _keep_scalar(m, count, gain, index, value, scalar_K, scalar_index, scalar_value)
                    continue
                nu = scalar_z[m] - z
                s = scale[kind] * scalar_var[m] + (jitter[kind] * speed) ** 2
                inv, s = _fuse(x, P, nu, s, index, value, count, gain, scratch, walk.size)
                heading += gain[8] * nu
                if moves or abs(heading) > FARTHEST:
                    heading = 0.0
                _rotation(x, R)
                likelihood += _log_density(nu, s)
                scalar_nu[m] = nu
                scalar_inv[m] = inv
                scalar_S[m] = s
                if keep:
                    _keep_scalar(m, count, gain, index, value, scalar_K, scalar_index, scalar_value)
            if not admitted[group]:
                likelihood += loss
        out = node_out[node]
        if out >= 0:
            _write_row(x, P, out, out_x, out_P, slow_P)
    memory[HEADING] = heading
    _copy(P, covariance)
    return likelihood


@inner(nogil=True, fastmath=_FLAGS)
def _row_times_adjoint(row: Array, Lam: Array, product: Array, states: int) -> None:
    """Fill the product of a row with Lam, eight rows at a time, so that it is not read and written for each."""
    a, b, c, d = row[0], row[1], row[2], row[3]
    for j in range(N):
        product[j] = a * Lam[0, j] + b * Lam[1, j] + c * Lam[2, j] + d * Lam[3, j]
    for i in range(4, states, 8):
        a, b, c, d = row[i], row[i + 1], row[i + 2], row[i + 3]
        e, f, g, h = row[i + 4], row[i + 5], row[i + 6], row[i + 7]
        for j in range(N):
            product[j] += (
                a * Lam[i, j]
                + b * Lam[i + 1, j]
                + c * Lam[i + 2, j]
                + d * Lam[i + 3, j]
                + e * Lam[i + 4, j]
                + f * Lam[i + 5, j]
                + g * Lam[i + 6, j]
                + h * Lam[i + 7, j]
            )


@inner(nogil=True, fastmath=_FLAGS)
def _unfuse(
    lam: Array, Lam: Array, nu: float, inv: float, S: float, K: Array, index: Array, value: Array, u: Array, states: int
) -> tuple[float, float]:
    """Propagate the adjoint back over one scalar measurement with gain K, in place; u (28,) is scratch.

    Returns what the measurement differs by from all the others together, and the variance of that by the filter's own
    account (the deletion residual: de Jong & Penzer 1998). One that was not fused, ``inv`` 0, leaves the adjoint.
    """
    used = inv > 0.0
    c = nu * (inv if used else 1.0 / S)
    s = inv
    _row_times_adjoint(K, Lam, u, states)
    for i in range(N):
        c += K[i] * lam[i]
        s += K[i] * u[i]
    if not used:
        return S * c, S - S * S * s
    for a in range(ENTRIES):
        h = value[a]
        if h == 0.0:
            continue
        i = index[a]
        lam[i] -= h * c
        for j in range(N):
            Lam[i, j] -= h * u[j]
        for j in range(states):
            Lam[j, i] -= h * u[j]
        for b in range(ENTRIES):
            Lam[i, index[b]] += h * value[b] * s
    return c / s, 1.0 / s - (1.0 / inv - S)


@inner(nogil=True, fastmath=_FLAGS)
def _smooth_three(
    P: Array, state: int, lam: Array, Lam: Array, states: int, product: Array, dx: Array, covariance: Array
) -> None:
    """Fill the corrections of three states from `state` on, and their smoothed covariance P - P Lam P'.

    The first three rows of P are those of the filter's; product (3, 28) is scratch.
    """
    for j in range(N):
        product[0, j] = product[1, j] = product[2, j] = 0.0
    for i in range(0, states, 4):
        a0, a1, a2 = P[0, i], P[1, i], P[2, i]
        b0, b1, b2 = P[0, i + 1], P[1, i + 1], P[2, i + 1]
        c0, c1, c2 = P[0, i + 2], P[1, i + 2], P[2, i + 2]
        d0, d1, d2 = P[0, i + 3], P[1, i + 3], P[2, i + 3]
        for j in range(N):
            a, b, c, d = Lam[i, j], Lam[i + 1, j], Lam[i + 2, j], Lam[i + 3, j]
            product[0, j] += a0 * a + b0 * b + c0 * c + d0 * d
            product[1, j] += a1 * a + b1 * b + c1 * c + d1 * d
            product[2, j] += a2 * a + b2 * b + c2 * c + d2 * d
    x0, x1, x2 = 0.0, 0.0, 0.0
    c00, c01, c02, c11, c12, c22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(N):
        p0, p1, p2 = P[0, j], P[1, j], P[2, j]
        x0 += p0 * lam[j]
        x1 += p1 * lam[j]
        x2 += p2 * lam[j]
        c00 += p0 * product[0, j]
        c01 += p1 * product[0, j]
        c02 += p2 * product[0, j]
        c11 += p1 * product[1, j]
        c12 += p2 * product[1, j]
        c22 += p2 * product[2, j]
    dx[state], dx[state + 1], dx[state + 2] = -x0, -x1, -x2
    covariance[0, 0] = P[0, state] - c00
    covariance[1, 1] = P[1, state + 1] - c11
    covariance[2, 2] = P[2, state + 2] - c22
    covariance[0, 1] = covariance[1, 0] = P[0, state + 1] - c01
    covariance[0, 2] = covariance[2, 0] = P[0, state + 2] - c02
    covariance[1, 2] = covariance[2, 1] = P[1, state + 2] - c12


@njit(cache=True, nogil=True, fastmath=_FLAGS)
def backward(
    steps: Steps,
    readings: Measurements,
    kept: ForwardPass,
    wander_time: Vector,
    lam: Vector,
    adjoint: Matrix,
    estimates: Estimates,
) -> None:
    """Fill the smoothed estimates of what `forward` kept, whose filtered states they hold.

    ``lam`` (28,) and ``adjoint`` (28, 28) are lam and Lam behind the last node, zero at the end of a segment, and are
    left as those before the first node. Sensor errors are smoothed only in rows that are multiples of `SLOW_EVERY`.
    """
    node_group, node_out = steps.node_group, steps.node_out
    group_start, scalar_var = readings.start, readings.variance
    _, out_P, slow_P, scalar_nu, scalar_inv, scalar_S = kept[:6]
    node_T, node_S, node_C, scalar_K, scalar_index, scalar_value = kept[6:12]
    out_x, out_covariance, slow_variance, deletion, _, shock, shock_size = estimates
    Lam = np.empty((N, N))
    _copy(adjoint, Lam)
    states = lam.size
    u = np.empty(N)
    dx = np.empty(N)
    product = np.empty((3, N))
    smoothed = np.empty((3, 3))
    stay = np.empty(STEADY - WANDERS)
    for node in range(node_out.shape[0] - 1, -1, -1):
        out = node_out[node]
        if out >= 0:
            for i in range(N):
                dx[i] = 0.0
            for block in range(SLOW // 3 if out % SLOW_EVERY else -(-N // 3)):
                # The last three begin with one of those before.
                state = min(3 * block, N - 3)
                P = out_P[out, state:] if state < SLOW else slow_P[out // SLOW_EVERY, state - SLOW :]
                _smooth_three(P, state, lam, Lam, states, product, dx, smoothed)
                for i in range(3):
                    if state >= SLOW:
                        slow_variance[out // SLOW_EVERY, state - SLOW + i] = smoothed[i, i]
                    else:
                        for j in range(3):
                            out_covariance[out, block, i, j] = smoothed[i, j]
            _inject(out_x[out], dx)
        for group in range(node_group[node + 1] - 1, node_group[node] - 1, -1):
            for m in range(group_start[group + 1] - 1, group_start[group] - 1, -1):
                residual, variance = _unfuse(
                    lam,
                    Lam,
                    scalar_nu[m],
                    scalar_inv[m],
                    scalar_S[m],
                    scalar_K[m],
                    scalar_index[m],
                    scalar_value[m],
                    u,
                    states,
                )
                deletion[m] = residual * residual / (max(variance, 0.0) + scalar_var[m])
        T = node_T[node]
        for block in range(2):
            shock[node, block] = 0.0
            shock_size[node, block] = 0.0
            for i in range(6 - 3 * block, 9 - 3 * block):
                if Lam[i, i] > 0.0 and lam[i] * lam[i] > shock[node, block] * Lam[i, i]:
                    shock[node, block] = lam[i] * lam[i] / Lam[i, i]
                    shock_size[node, block] = abs(lam[i]) / Lam[i, i]
        if T > 0.0:
            for i in range(STEADY - WANDERS):
                stay[i] = np.exp(-T / wander_time[i])
            _propagate_adjoint(lam, Lam, T, node_S[node], node_C[node], stay, states)
    _copy(Lam, adjoint)
