"""Translation of a craft whose attitude is known, with the sensitivities of its path to every parameter.

Parameters are numbered as in `THETA` of `sysid.rigid_body.motion.body_motion`: 0 thrust, 1 expo, 2-4 linear drag, 5-7
quadratic drag, 8 climb loss, 9-10 tilt, 11 motor lag; then of the flight 12 wind exponent, 13 thrust scale and the
wind's coefficients towards north and east in turn; then, as columns of sensitivities only, the initial position and
velocity.

Arrays are copied element by element: numba takes seconds to compile the error text of one slice assignment.
"""

from __future__ import annotations

from math import log, sqrt

import numpy as np
from numpy.typing import NDArray

from logparse.numerics.compiled import inner, njit
from logparse.numerics.kernel_types import Matrix, Stack, Vector
from logparse.units import STANDARD_GRAVITY

Floats = NDArray[np.float64]


#: Linear drag goes with the rotors' speed, sqrt(density thrust); else with density.
ROTOR_DRAG = 1

#: Quadratic drag along an axis goes with the square of the speed along it; else with that times the whole speed.
AXIS_DRAG = 2

#: Below this height the wind's profile is level, m.
_LOWEST = 0.5

#: Columns of the signals array: rotation matrix by rows, relative density, sum of c and of c^2 times the square of the
#: relative voltage, and the derivatives of these two by the motors' lag.
SIGNALS = 14


@inner(nogil=True)
def _blend(signals: Floats, k: int, part: float, out: Floats) -> None:
    """Signals between samples k and k + 1."""
    if part == 0.0:
        for i in range(out.shape[0]):
            out[i] = signals[k, i]
    else:
        for i in range(out.shape[0]):
            out[i] = (1.0 - part) * signals[k, i] + part * signals[k + 1, i]


@inner(nogil=True)
def _wind(theta: Floats, shapes: Floats, k: int, part: float) -> tuple[float, float]:
    """Wind at the reference height, between samples k and k + 1."""
    north = east = 0.0
    for i in range(shapes.shape[1]):
        b = shapes[k, i] if part == 0.0 else (1.0 - part) * shapes[k, i] + part * shapes[k + 1, i]
        north += theta[14 + 2 * i] * b
        east += theta[15 + 2 * i] * b
    return north, east


@inner(nogil=True)
def _acceleration(
    theta: Floats, s: Floats, north: float, east: float, height: float, v: Floats, law: int, out: Floats
) -> None:
    profile = (max(height, _LOWEST) / 10.0) ** theta[12]
    rn, re, rd = v[0] - profile * north, v[1] - profile * east, v[2]
    ux = s[0] * rn + s[3] * re + s[6] * rd
    uy = s[1] * rn + s[4] * re + s[7] * rd
    uz = s[2] * rn + s[5] * re + s[8] * rd
    density = s[9]
    thrust = theta[0] * theta[13] * density * ((1.0 - theta[1]) * s[10] + theta[1] * s[11])
    linear = sqrt(max(density * thrust, 0.0) / STANDARD_GRAVITY) if law & ROTOR_DRAG else density
    climb = max(-uz, 0.0)
    if law & AXIS_DRAG:
        qx, qy, qz = density * abs(ux), density * abs(uy), density * abs(uz)
    else:
        qx = qy = qz = density * sqrt(ux * ux + uy * uy + uz * uz)
    ax = theta[9] * thrust - (linear * theta[2] + qx * theta[5]) * ux
    ay = theta[10] * thrust - (linear * theta[3] + qy * theta[6]) * uy
    az = -thrust - (linear * theta[4] + qz * theta[7]) * uz + density * theta[8] * climb * climb
    out[0] = s[0] * ax + s[1] * ay + s[2] * az
    out[1] = s[3] * ax + s[4] * ay + s[5] * az
    out[2] = s[6] * ax + s[7] * ay + s[8] * az + STANDARD_GRAVITY


@inner(nogil=True)
def _derivatives(
    theta: Floats,
    s: Floats,
    shapes: Floats,
    k: int,
    part: float,
    height: float,
    v: Floats,
    law: int,
    body: Floats,
    by_velocity: Floats,
    by_height: Floats,
    by_theta: Floats,
) -> None:
    """Differentiate the acceleration (world axes) by velocity (3, 3), height (3,) and parameters (3, q).

    `body` (3, 3) is scratch.
    """
    north, east = _wind(theta, shapes, k, part)
    clear = height > _LOWEST
    ratio = max(height, _LOWEST) / 10.0
    profile = ratio ** theta[12]
    rn, re, rd = v[0] - profile * north, v[1] - profile * east, v[2]
    u = (
        s[0] * rn + s[3] * re + s[6] * rd,
        s[1] * rn + s[4] * re + s[7] * rd,
        s[2] * rn + s[5] * re + s[8] * rd,
    )
    density = s[9]
    curve = (1.0 - theta[1]) * s[10] + theta[1] * s[11]
    gain = theta[0] * theta[13] * density
    thrust = gain * curve
    linear = sqrt(max(density * thrust, 0.0) / STANDARD_GRAVITY) if law & ROTOR_DRAG else density
    by_thrust = 0.5 * linear / thrust if law & ROTOR_DRAG and thrust > 0.0 else 0.0
    speed = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    climb = max(-u[2], 0.0)
    # In body axes first: d a_b / d u and d a_b / d thrust.
    for i in range(3):
        axis = abs(u[i]) if law & AXIS_DRAG else speed
        for j in range(3):
            if law & AXIS_DRAG:
                body[i, j] = -density * theta[5 + i] * axis if i == j else 0.0
            else:
                body[i, j] = -density * theta[5 + i] * u[i] * u[j] / speed if speed > 1e-9 else 0.0
        body[i, i] -= linear * theta[2 + i] + density * theta[5 + i] * axis
    body[2, 2] -= 2.0 * density * theta[8] * climb
    lean = (
        theta[9] - by_thrust * theta[2] * u[0],
        theta[10] - by_thrust * theta[3] * u[1],
        -1.0 - by_thrust * theta[4] * u[2],
    )
    rotation = s[:9].reshape(3, 3)
    for a in range(3):
        for b in range(3):
            total = 0.0
            for i in range(3):
                for j in range(3):
                    total += rotation[a, i] * body[i, j] * rotation[b, j]
            by_velocity[a, b] = total
    by_log = profile * log(ratio)
    by_rise = theta[12] * profile / (10.0 * ratio) if clear else 0.0
    lag = gain * ((1.0 - theta[1]) * s[12] + theta[1] * s[13])
    for a in range(3):
        r = rotation[a]
        pull = r[0] * lean[0] + r[1] * lean[1] + r[2] * lean[2]
        by_theta[a, 0] = pull * thrust / theta[0]
        by_theta[a, 1] = pull * gain * (s[11] - s[10])
        for i in range(3):
            by_theta[a, 2 + i] = -r[i] * linear * u[i]
            by_theta[a, 5 + i] = -r[i] * density * (abs(u[i]) if law & AXIS_DRAG else speed) * u[i]
        by_theta[a, 8] = r[2] * density * climb * climb
        by_theta[a, 9] = r[0] * thrust
        by_theta[a, 10] = r[1] * thrust
        blown = by_velocity[a, 0] * north + by_velocity[a, 1] * east
        by_theta[a, 11] = pull * lag
        by_theta[a, 12] = -blown * by_log
        by_theta[a, 13] = pull * thrust / theta[13]
        by_height[a] = -blown * by_rise
        for i in range(shapes.shape[1]):
            shape = shapes[k, i] if part == 0.0 else (1.0 - part) * shapes[k, i] + part * shapes[k + 1, i]
            by_theta[a, 14 + 2 * i] = -by_velocity[a, 0] * profile * shape
            by_theta[a, 15 + 2 * i] = -by_velocity[a, 1] * profile * shape


@njit(cache=True, nogil=True)
def accelerations(
    theta: Vector,
    signals: Matrix,
    shapes: Matrix,
    heights: Vector,
    velocities: Matrix,
    law: int,
    out: Matrix,
    jacobian: Stack,
) -> None:
    """Accelerations at measured velocities and heights, and their derivatives by the parameters.

    Parameters
    ----------
    theta : ndarray, shape (q,)
    signals : ndarray, shape (N, 14)
    shapes : ndarray, shape (N, w)
        Of the wind over time; q = 14 + 2 w.
    heights : ndarray, shape (N,)
        m above the place of take-off.
    velocities : ndarray, shape (N, 3)
        NED, m/s.
    law : int
        Sum of `ROTOR_DRAG` and `AXIS_DRAG` as they hold.
    out : ndarray, shape (N, 3)
        Receives accelerations, NED, m/s^2.
    jacobian : ndarray, shape (N, 3, q)
        Receives their derivatives.
    """
    body, by_velocity, by_height = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for k in range(len(signals)):
        north, east = _wind(theta, shapes, k, 0.0)
        _acceleration(theta, signals[k], north, east, heights[k], velocities[k], law, out[k])
        _derivatives(
            theta, signals[k], shapes, k, 0.0, heights[k], velocities[k], law, body, by_velocity,
            by_height, jacobian[k],
        )  # fmt: skip


@inner(nogil=True)
def _step(
    theta: Floats, signals: Floats, shapes: Floats, k: int, dt: float, ground: float, law: int, x: Floats, work: Floats
) -> None:
    """Advance positions and velocities from sample k to k + 1 (Runge-Kutta, fourth order); work is (6, 14)."""
    s, stage = work[0], work[1, :6]
    for i in range(4):
        part = 0.0 if i == 0 else (1.0 if i == 3 else 0.5)
        if i != 2:
            _blend(signals, k, part, s)
        north, east = _wind(theta, shapes, k, part)
        for a in range(6):
            stage[a] = x[a] + (part * dt * work[1 + i, a] if i > 0 else 0.0)
        rate = work[2 + i]
        for a in range(3):
            rate[a] = stage[3 + a]
        _acceleration(theta, s, north, east, ground - stage[2], stage[3:], law, rate[3:])
    for a in range(6):
        x[a] += dt / 6.0 * (work[2, a] + 2.0 * work[3, a] + 2.0 * work[4, a] + work[5, a])


@inner(nogil=True)
def _keep(x: Floats, out: Floats, row: int) -> None:
    """Copy as much of a state as a row of the output has room for."""
    for a in range(out.shape[1]):
        out[row, a] = x[a]


@njit(cache=True, nogil=True)
def path(
    theta: Vector,
    signals: Matrix,
    shapes: Matrix,
    dt: float,
    ground: float,
    law: int,
    start: int,
    initial: Vector,
    out: Matrix,
) -> None:
    """Positions and velocities (NED) from an initial state by the fourth-order Runge-Kutta method.

    Parameters
    ----------
    theta, signals, shapes, law
        As for `accelerations`.
    dt : float
        s.
    ground : float
        Down coordinate of the place of take-off, m.
    start : int
        Sample at which the run starts.
    initial : ndarray, shape (6,)
    out : ndarray, shape (n, 6)
        Receives samples `start` to `start + n - 1`.
    """
    x, work = initial.copy(), np.empty((6, SIGNALS))
    _keep(x, out, 0)
    for n in range(1, len(out)):
        _step(theta, signals, shapes, start + n - 1, dt, ground, law, x, work)
        _keep(x, out, n)


@njit(cache=True, nogil=True)
def ahead(
    thetas: Matrix,
    signals: Matrix,
    shapes: Matrix,
    dt: float,
    ground: float,
    law: int,
    states: Matrix,
    steps: int,
    every: int,
    out: Matrix,
) -> None:
    """Positions predicted from the state `steps` samples before.

    Parameters
    ----------
    thetas : ndarray, shape (R, q)
        Parameters as they are known at each restart, at samples 0, `every`, 2 `every`, ...
    signals, dt, ground, law
        As for `path`.
    shapes : ndarray, shape (steps + 1, w)
        Of the wind over the time since a restart.
    states : ndarray, shape (N, 6)
        Measured positions and velocities, NED.
    steps : int
    every : int
        Restart at every so many-th sample only.
    out : ndarray, shape (N, 3)
        Receives positions, NED; samples that no restart leads to are left alone.
    """
    x, work = np.empty(6), np.empty((6, SIGNALS))
    for restart in range((len(states) - steps - 1) // every + 1):
        first = restart * every
        for a in range(6):
            x[a] = states[first, a]
        for k in range(steps):
            _step(thetas[restart], signals[first:], shapes, k, dt, ground, law, x, work)
        _keep(x, out, first + steps)


@inner(nogil=True)
def _keep_sensitivities(z: Floats, out: Floats, row: int) -> None:
    for a in range(3):
        for c in range(z.shape[1]):
            out[row, a, c] = z[a, c]


@njit(cache=True, nogil=True)
def path_sensitivities(
    theta: Vector,
    signals: Matrix,
    shapes: Matrix,
    dt: float,
    ground: float,
    law: int,
    start: int,
    initial: Vector,
    stride: int,
    out: Matrix,
    sensitivities: Stack,
) -> None:
    """Positions as `path` and their derivatives by parameters and initial state: (n, 3) and (n, 3, q + 6).

    Of every `stride`-th sample only, from `start` on.
    """
    x = initial.copy()
    q = len(theta)
    columns = q + 6
    z = np.zeros((6, columns))
    for i in range(6):
        z[i, q + i] = 1.0
    stage, rate = np.empty(6), np.zeros((4, 6))
    stage_z, rate_z = np.empty((6, columns)), np.zeros((4, 6, columns))
    s = np.empty(SIGNALS)
    # The columns of the initial state stay zero here.
    body, by_velocity, by_height, by_theta = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.zeros((3, columns))
    _keep(x, out, 0)
    _keep_sensitivities(z, sensitivities, 0)
    for n in range(1, (len(out) - 1) * stride + 1):
        k = start + n - 1
        for i in range(4):
            part = 0.0 if i == 0 else (1.0 if i == 3 else 0.5)
            if i != 2:
                _blend(signals, k, part, s)
                north, east = _wind(theta, shapes, k, part)
            step, before = part * dt, max(i - 1, 0)
            for a in range(6):
                stage[a] = x[a] + step * rate[before, a]
                for c in range(columns):
                    stage_z[a, c] = z[a, c] + step * rate_z[before, a, c]
            height = ground - stage[2]
            for a in range(3):
                rate[i, a] = stage[3 + a]
            _acceleration(theta, s, north, east, height, stage[3:], law, rate[i, 3:])
            _derivatives(theta, s, shapes, k, part, height, stage[3:], law, body, by_velocity, by_height, by_theta)
            for a in range(3):
                vn, ve, vd, h = by_velocity[a, 0], by_velocity[a, 1], by_velocity[a, 2], by_height[a]
                for c in range(columns):
                    rate_z[i, a, c] = stage_z[3 + a, c]
                    rate_z[i, 3 + a, c] = (
                        by_theta[a, c]
                        + vn * stage_z[3, c]
                        + ve * stage_z[4, c]
                        + vd * stage_z[5, c]
                        - h * stage_z[2, c]
                    )
        for a in range(6):
            x[a] += dt / 6.0 * (rate[0, a] + 2.0 * rate[1, a] + 2.0 * rate[2, a] + rate[3, a])
            for c in range(columns):
                z[a, c] += (
                    dt / 6.0 * (rate_z[0, a, c] + 2.0 * rate_z[1, a, c] + 2.0 * rate_z[2, a, c] + rate_z[3, a, c])
                )
        if n % stride == 0:
            _keep(x, out, n // stride)
            _keep_sensitivities(z, sensitivities, n // stride)
