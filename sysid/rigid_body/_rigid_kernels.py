"""Translation of a craft whose attitude is known, and the derivatives of its accelerations by every parameter.

Parameters are numbered as in `THETA` of `sysid.rigid_body.body_motion`: 0 thrust, 1 expo, 2-4 linear drag, 5-7
quadratic drag, 8 climb loss, 9-10 tilt, 11 motor lag; then of the flight 12 wind exponent, 13 thrust scale and the
wind's coefficients towards north and east in turn.

Arrays are copied element by element: numba takes seconds to compile the error text of one slice assignment.
"""

from __future__ import annotations

from math import exp, log, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.compiled import inner, njit
from core.kernel_types import Int64s, Matrix, Stack, Vector
from core.units import STANDARD_GRAVITY

Floats = NDArray[np.float64]

#: Linear drag goes with the rotors' speed, sqrt(density thrust); else with density.
ROTOR_DRAG = 1

#: Quadratic drag along an axis goes with the square of the speed along it; else with that times the whole speed.
AXIS_DRAG = 2

#: Below this height the wind's profile is level, m.
LEVEL_BELOW = 0.5


class MotionSignals(NamedTuple):
    """What the equations of motion read of a flight, sample by sample."""

    states: Matrix  #: shape (N, 18): As of `MeasuredMotion`.
    density: Vector  #: shape (N,)
    #: shape (N, 4): Sums of c and of c^2 times the square of the relative voltage, behind the motors' lag, and their
    #: derivatives by it.
    late: Matrix
    heights: Vector  #: shape (N,): Above the place of take-off, m.


#: Signals of a sample: rotation matrix by rows, relative density, sum of c and of c^2 times the square of the relative
#: voltage, and the derivatives of these two by the motors' lag.
_SIGNALS = 14

#: Products and sums may be one instruction.
_FAST = {"contract"}


@inner(nogil=True, fastmath=_FAST)
def _blend(signals: MotionSignals, k: int, part: float, out: Floats) -> None:
    """Signals between samples k and k + 1."""
    states, density, late = signals.states, signals.density, signals.late
    following = k if part == 0.0 else k + 1
    for i in range(9):
        out[i] = states[k, 6 + i] + part * (states[following, 6 + i] - states[k, 6 + i])
    out[9] = density[k] + part * (density[following] - density[k])
    for i in range(4):
        out[10 + i] = late[k, i] + part * (late[following, i] - late[k, i])


@inner(nogil=True, fastmath=_FAST)
def _wind(theta: Floats, shapes: Floats, k: int, part: float) -> tuple[float, float]:
    """Wind at the reference height, between samples k and k + 1."""
    north = east = 0.0
    following = k if part == 0.0 else k + 1
    for i in range(shapes.shape[1]):
        b = shapes[k, i] + part * (shapes[following, i] - shapes[k, i])
        north += theta[14 + 2 * i] * b
        east += theta[15 + 2 * i] * b
    return north, east


@inner(nogil=True, fastmath=_FAST)
def _above(height: float) -> float:
    """Logarithm of the height over the reference's."""
    return log(max(height, LEVEL_BELOW) / 10.0)


@inner(nogil=True, fastmath=_FAST)
def _relative(s: Floats, north: float, east: float, state: Floats) -> tuple[float, float, float]:
    """Velocity through the air along body axes, of a state."""
    rn, re, rd = state[3] - north, state[4] - east, state[5]
    return (
        s[0] * rn + s[3] * re + s[6] * rd,
        s[1] * rn + s[4] * re + s[7] * rd,
        s[2] * rn + s[5] * re + s[8] * rd,
    )


@inner(nogil=True, fastmath=_FAST)
def _acceleration(theta: Floats, s: Floats, u: tuple[float, float, float], law: int, out: Floats) -> None:
    """Acceleration in world axes at a velocity u through the air."""
    ux, uy, uz = u
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


@inner(nogil=True, fastmath=_FAST)
def _derivatives(
    theta: Floats,
    s: Floats,
    shape: Floats,
    wind: tuple[float, float],
    above: float,
    u: tuple[float, float, float],
    law: int,
    body: Floats,
    by_velocity: Floats,
    by_theta: Floats,
) -> None:
    """Differentiate the acceleration (world axes) by velocity (3, 3) and parameters (3, q).

    `wind` is that at the reference height, `shape` (w,) its shapes, `above` the logarithm of the height over it; `body`
    (3, 3) is scratch.
    """
    profile = exp(theta[12] * above)
    density = s[9]
    curve = (1.0 - theta[1]) * s[10] + theta[1] * s[11]
    gain = theta[0] * theta[13] * density
    thrust = gain * curve
    linear = sqrt(max(density * thrust, 0.0) / STANDARD_GRAVITY) if law & ROTOR_DRAG else density
    by_thrust = 0.5 * linear / thrust if law & ROTOR_DRAG and thrust > 0.0 else 0.0
    speed = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    slower = density / speed if speed > 1e-9 else 0.0
    climb = max(-u[2], 0.0)
    # In body axes first: d a_b / d u and d a_b / d thrust.
    for i in range(3):
        if law & AXIS_DRAG:
            for j in range(3):
                body[i, j] = 0.0
            body[i, i] = -linear * theta[2 + i] - 2.0 * density * theta[5 + i] * abs(u[i])
        else:
            for j in range(3):
                body[i, j] = -slower * theta[5 + i] * u[i] * u[j]
            body[i, i] -= linear * theta[2 + i] + density * theta[5 + i] * speed
    body[2, 2] -= 2.0 * density * theta[8] * climb
    lean = (
        theta[9] - by_thrust * theta[2] * u[0],
        theta[10] - by_thrust * theta[3] * u[1],
        -1.0 - by_thrust * theta[4] * u[2],
    )
    by_log = profile * above
    lag = gain * ((1.0 - theta[1]) * s[12] + theta[1] * s[13])
    bend, per_thrust, per_scale = gain * (s[11] - s[10]), theta[13] * density * curve, theta[0] * density * curve
    for a in range(3):
        r0, r1, r2 = s[3 * a], s[3 * a + 1], s[3 * a + 2]
        x = r0 * body[0, 0] + r1 * body[1, 0] + r2 * body[2, 0]
        y = r0 * body[0, 1] + r1 * body[1, 1] + r2 * body[2, 1]
        z = r0 * body[0, 2] + r1 * body[1, 2] + r2 * body[2, 2]
        for b in range(3):
            by_velocity[a, b] = x * s[3 * b] + y * s[3 * b + 1] + z * s[3 * b + 2]
        pull = r0 * lean[0] + r1 * lean[1] + r2 * lean[2]
        by_theta[a, 0] = pull * per_thrust
        by_theta[a, 1] = pull * bend
        for i in range(3):
            along = -s[3 * a + i] * u[i]
            by_theta[a, 2 + i] = linear * along
            by_theta[a, 5 + i] = density * (abs(u[i]) if law & AXIS_DRAG else speed) * along
        by_theta[a, 8] = r2 * density * climb * climb
        by_theta[a, 9] = r0 * thrust
        by_theta[a, 10] = r1 * thrust
        blown = by_velocity[a, 0] * wind[0] + by_velocity[a, 1] * wind[1]
        by_theta[a, 11] = pull * lag
        by_theta[a, 12] = -blown * by_log
        by_theta[a, 13] = pull * per_scale
        for i in range(len(shape)):
            by_theta[a, 14 + 2 * i] = -by_velocity[a, 0] * profile * shape[i]
            by_theta[a, 15 + 2 * i] = -by_velocity[a, 1] * profile * shape[i]


@njit(cache=True, nogil=True, fastmath=_FAST)
def accelerations(
    theta: Vector, signals: MotionSignals, shapes: Matrix, law: int, stride: int, out: Matrix, jacobian: Stack
) -> None:
    """Mean accelerations at measured velocities and heights, and their derivatives by the parameters.

    Means are by trapezoids from every `stride`-th sample to the next. Accelerations of all samples are not kept: with
    their derivatives those of a long flight would be larger than all that is known of it.

    Shapes: `theta` (q,); `shapes` (N, w); `out` (n, 3); `jacobian` (n, 3, q).
    """
    s, push, q = np.empty(_SIGNALS), np.empty(3), len(theta)
    body, by_velocity, by_theta = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, q))
    flat, total, sums = by_theta.reshape(3 * q), np.empty(3), np.empty(3 * q)
    for row in range(len(out)):
        for a in range(3):
            total[a] = 0.0
        for c in range(3 * q):
            sums[c] = 0.0
        for n in range(stride + 1):
            k = row * stride + n
            # What is between two means belongs to both by half.
            weight = (0.5 if n == 0 or n == stride else 1.0) / stride
            if row == 0 or n > 0:
                _blend(signals, k, 0.0, s)
                wind = _wind(theta, shapes, k, 0.0)
                above = _above(signals.heights[k])
                profile = exp(theta[12] * above)
                u = _relative(s, profile * wind[0], profile * wind[1], signals.states[k])
                _acceleration(theta, s, u, law, push)
                _derivatives(theta, s, shapes[k], wind, above, u, law, body, by_velocity, by_theta)
            for a in range(3):
                total[a] += weight * push[a]
            for c in range(3 * q):
                sums[c] += weight * flat[c]
        for a in range(3):
            out[row, a] = total[a]
            for c in range(q):
                jacobian[row, a, c] = sums[a * q + c]


@inner(nogil=True, fastmath=_FAST)
def _step(
    theta: Floats,
    signals: MotionSignals,
    shapes: Floats,
    at: tuple[int, int],
    dt: float,
    ground: float,
    law: int,
    x: Floats,
    work: Floats,
) -> None:
    """Advance positions and velocities by a sample (Runge-Kutta, fourth order); work is (6, 14).

    `at` are where that begins among the signals and among the wind's shapes.
    """
    s, stage = work[0], work[1, :6]
    for i in range(4):
        part = 0.0 if i == 0 else (1.0 if i == 3 else 0.5)
        if i != 2:
            _blend(signals, at[0], part, s)
        north, east = _wind(theta, shapes, at[1], part)
        for a in range(6):
            stage[a] = x[a] + (part * dt * work[1 + i, a] if i > 0 else 0.0)
        rate = work[2 + i]
        for a in range(3):
            rate[a] = stage[3 + a]
        profile = exp(theta[12] * _above(ground - stage[2]))
        _acceleration(theta, s, _relative(s, profile * north, profile * east, stage), law, rate[3:])
    for a in range(6):
        x[a] += dt / 6.0 * (work[2, a] + 2.0 * work[3, a] + 2.0 * work[4, a] + work[5, a])


@njit(cache=True, nogil=True, fastmath=_FAST)
def ahead(
    thetas: Matrix,
    signals: MotionSignals,
    shapes: Matrix,
    dt: float,
    ground: float,
    law: int,
    starts: Int64s,
    marks: Int64s,
    out: Stack,
) -> None:
    """Run from the measured state at each start; keep positions and velocities at the marked samples after it.

    `thetas`, (S, q), are as known at the starts; the wind's `shapes`, (n, w), go with the samples since a start; `out`,
    (S, M, 6), is NED.
    """
    x, work = np.empty(6), np.empty((6, _SIGNALS))
    for s in range(len(starts)):
        for a in range(6):
            x[a] = signals.states[starts[s], a]
        theta, mark = thetas[s], 0
        for k in range(marks[-1]):
            _step(theta, signals, shapes, (starts[s] + k, k), dt, ground, law, x, work)
            if k + 1 == marks[mark]:
                for a in range(6):
                    out[s, mark, a] = x[a]
                mark += 1
