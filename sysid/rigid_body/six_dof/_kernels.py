"""Equations of motion of `sysid.rigid_body.six_dof.model`, run from many starts of one record; compiled.

The kernels take plain arrays. Rows of `drives` are what the inputs do in the sample interval that begins there, in the
order of `DRIVES`; numbers beyond it are further inputs.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from core.compiled import inner, njit
from core.units import STANDARD_GRAVITY

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

#: Columns of the drives: total strength of the rotors, their moments about the axes, angular momentum of the rotors
#: over the body's axes (spin times speed) and its derivative, mean speed, and the battery's part in the thrust.
DRIVES = ("thrust", "roll", "pitch", "yaw", "momentum", "momentum_rate", "speed", "charge")

#: Places of the parameters in theta; those of further inputs come after them, six for each.
THETA = (
    "thrust",
    "thrust_offset",
    "tilt_x",
    "tilt_y",
    "drag_rotor_x",
    "drag_rotor_y",
    "drag_rotor_z",
    "drag_quadratic_x",
    "drag_quadratic_y",
    "drag_quadratic_z",
    "roll_gain",
    "pitch_gain",
    "yaw_gain",
    "roll_damping",
    "pitch_damping",
    "yaw_damping",
    "inertia_x",
    "inertia_y",
    "inertia_z",
    "gyroscopic_x",
    "gyroscopic_y",
    "rotor_inertia",
    "roll_offset",
    "pitch_offset",
    "yaw_offset",
    "roll_by_speed",
    "pitch_by_speed",
)
SHARED = len(THETA)
#: Parameters of one further input: acceleration along x, y, z and angular acceleration about x, y, z.
PER_INPUT = 6

#: Numbers of a state: position, velocity, rotation by rows, rates.
STATES = 18
#: Numbers that integration notes meanwhile.
SCRATCH = 24


@inner()
def _turn(rotation: Floats, x: float, y: float, z: float, out: Floats) -> None:
    """Multiply a rotation (9,) by that of a rotation vector, ``out = R exp([x y z])``."""
    square = x * x + y * y + z * z
    if square > 1e-8:
        angle = np.sqrt(square)
        a = np.sin(angle) / angle
        b = (1.0 - np.cos(angle)) / square
    else:
        a = 1.0 - square / 6.0
        b = 0.5 - square / 24.0
    e00 = 1.0 - b * (y * y + z * z)
    e01 = b * x * y - a * z
    e02 = b * x * z + a * y
    e10 = b * x * y + a * z
    e11 = 1.0 - b * (x * x + z * z)
    e12 = b * y * z - a * x
    e20 = b * x * z - a * y
    e21 = b * y * z + a * x
    e22 = 1.0 - b * (x * x + y * y)
    for row in range(3):
        r0, r1, r2 = rotation[3 * row], rotation[3 * row + 1], rotation[3 * row + 2]
        out[3 * row] = r0 * e00 + r1 * e10 + r2 * e20
        out[3 * row + 1] = r0 * e01 + r1 * e11 + r2 * e21
        out[3 * row + 2] = r0 * e02 + r1 * e12 + r2 * e22


@inner()
def _turning(theta: Floats, drive: Floats, w: Floats, air: Floats, push: Floats, out: Floats) -> None:
    """Angular acceleration in body axes; `push` is what is added to it from outside, (3,)."""
    wx, wy, wz = w[0], w[1], w[2]
    thrust, momentum, speed = drive[0], drive[4], drive[6]
    out[0] = (
        theta[10] * drive[1]
        - theta[13] * wx
        + theta[16] * wy * wz
        - theta[19] * momentum * wy
        + theta[22] * thrust
        + theta[25] * speed * air[1]
        + push[0]
    )
    out[1] = (
        theta[11] * drive[2]
        - theta[14] * wy
        + theta[17] * wx * wz
        + theta[20] * momentum * wx
        + theta[23] * thrust
        + theta[26] * speed * air[0]
        + push[1]
    )
    out[2] = (
        theta[12] * drive[3]
        - theta[15] * wz
        + theta[18] * wx * wy
        + theta[21] * drive[5]
        + theta[24] * thrust
        + push[2]
    )
    for k in range(8, drive.shape[0]):
        at = 27 + 6 * (k - 8)
        for axis in range(3):
            out[axis] += theta[at + 3 + axis] * drive[k]


@inner()
def _forcing(theta: Floats, drive: Floats, air: Floats, out: Floats) -> None:
    """Specific force in body axes, m/s^2."""
    pull = theta[0] * drive[0] + theta[1] * drive[7]
    speed = drive[6]
    along = np.sqrt(air[0] * air[0] + air[1] * air[1] + air[2] * air[2])
    for axis in range(3):
        out[axis] = -(theta[4 + axis] * speed + theta[7 + axis] * along) * air[axis]
    out[0] += pull * theta[2]
    out[1] += pull * theta[3]
    out[2] -= pull
    for k in range(8, drive.shape[0]):
        at = 27 + 6 * (k - 8)
        for axis in range(3):
            out[axis] += theta[at + axis] * drive[k]


@inner()
def _advance(
    theta: Floats, drive: Floats, wind: Floats, push: Floats, dt: float, substeps: int, state: Floats, scratch: Floats
) -> None:
    """Integrate one sample interval as `advance` does, without arrays of its own; scratch (24,)."""
    h = dt / substeps
    air, turn, force, speed = scratch[:3], scratch[3:6], scratch[6:9], scratch[9:12]
    middle, w = scratch[12:21], scratch[21:24]
    for _ in range(substeps):
        rotation = state[6:15]
        for axis in range(3):
            air[axis] = (
                rotation[axis] * (state[3] - wind[0])
                + rotation[3 + axis] * (state[4] - wind[1])
                + rotation[6 + axis] * (state[5] - wind[2])
            )
        _turning(theta, drive, state[15:18], air, push[3:6], turn)
        for axis in range(3):
            w[axis] = state[15 + axis] + 0.5 * h * turn[axis]
        _turn(rotation, 0.5 * h * w[0], 0.5 * h * w[1], 0.5 * h * w[2], middle)
        _forcing(theta, drive, air, force)
        for axis in range(3):
            speed[axis] = state[3 + axis] - wind[axis] + 0.5 * h * push[axis]
            for k in range(3):
                speed[axis] += 0.5 * h * middle[3 * axis + k] * force[k]
        speed[2] += 0.5 * h * STANDARD_GRAVITY
        for axis in range(3):
            air[axis] = middle[axis] * speed[0] + middle[3 + axis] * speed[1] + middle[6 + axis] * speed[2]
        _turning(theta, drive, w, air, push[3:6], turn)
        _forcing(theta, drive, air, force)
        for axis in range(3):
            acceleration = (
                middle[3 * axis] * force[0]
                + middle[3 * axis + 1] * force[1]
                + middle[3 * axis + 2] * force[2]
                + push[axis]
            )
            if axis == 2:
                acceleration += STANDARD_GRAVITY
            state[axis] += h * (state[3 + axis] + 0.5 * h * acceleration)
            state[3 + axis] += h * acceleration
        _turn(middle, 0.5 * h * w[0], 0.5 * h * w[1], 0.5 * h * w[2], rotation)
        for axis in range(3):
            state[15 + axis] += h * turn[axis]


@njit(cache=True)
def advance(theta: Floats, drive: Floats, wind: Floats, push: Floats, dt: float, substeps: int, state: Floats) -> None:
    """Integrate one sample interval in place: midpoint rule in rates, attitude and velocity.

    `drive`, (8 + e,), is held over the interval; `push`, (6,), is an acceleration in the world and an angular one in
    the body from outside; `state`, (18,), is position, velocity (NED), rotation from body to world by rows, and rates.
    """
    _advance(theta, drive, wind, push, dt, substeps, state, np.empty(SCRATCH))


@inner()
def _run(
    theta: Floats,
    drives: Floats,
    wind: Floats,
    push: Floats,
    states: Floats,
    first: int,
    marks: Integers,
    dt: float,
    substeps: int,
    given: bool,
    state: Floats,
    scratch: Floats,
    out: Floats,
) -> None:
    """Run from one start as `ahead` does."""
    for k in range(STATES):
        state[k] = states[first, k]
    mark = 0
    for step in range(marks[-1]):
        row = first + step
        _advance(theta, drives[row], wind[first], push, dt, substeps, state, scratch)
        if given:
            for k in range(6, STATES):
                state[k] = states[row + 1, k]
        if step + 1 == marks[mark]:
            for k in range(STATES):
                out[mark, k] = state[k]
            mark += 1


@njit(cache=True)
def ahead(
    theta: Floats,
    drives: Floats,
    wind: Floats,
    pushes: Floats,
    states: Floats,
    starts: Integers,
    marks: Integers,
    dt: float,
    substeps: int,
    given: bool,
) -> Floats:
    """Run from the measured state at each start and return the states at the marked numbers of samples after it.

    Shapes: `pushes` (S, 6), `starts` (S,), `marks` (M,) from 1 upwards, result (S, M, 18).
    """
    out = np.empty((len(starts), len(marks), STATES))
    state, scratch = np.empty(STATES), np.empty(SCRATCH)
    for s in range(len(starts)):
        _run(theta, drives, wind, pushes[s], states, starts[s], marks, dt, substeps, given, state, scratch, out[s])
    return out


@njit(cache=True)
def shifted_and_lagged(values: Floats, delay: float, lag: float) -> Floats:
    """Delay a signal by a number of samples of either sign, then pass it through a first-order lag.

    Shapes: `values` (N,).
    """
    n = len(values)
    out = np.empty(n)
    keep = np.exp(-1.0 / lag) if lag > 1e-3 else 0.0
    memory = values[0]
    for k in range(n):
        place = min(max(k - delay, 0.0), n - 1.0)
        low = min(int(place), n - 2)
        part = place - low
        value = (1.0 - part) * values[low] + part * values[low + 1]
        if 1 <= low < n - 2:
            before = values[low - 1] - 2.0 * values[low] + values[low + 1]
            after = values[low] - 2.0 * values[low + 1] + values[low + 2]
            bend = (1.0 - part) * before + part * after
            value -= (0.5 * part * (1.0 - part) - 1.0 / 24.0) * bend
        out[k] = value + lag * (1.0 - keep) * (memory - value)
        memory = keep * memory + (1.0 - keep) * value
    return out
