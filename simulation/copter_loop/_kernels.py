"""Compiled flight of one axis: physics and gyro filter at 2 kHz, controllers at 400 Hz."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]


class AxisNumbers(NamedTuple):
    """Physics: steps of `h` s; `lag` and `flex` are 0 for none."""

    gain: float
    damping: float
    lag: float
    delay_steps: int
    flex_omega: float
    flex_damping: float
    flex_share: float


class ControllerNumbers(NamedTuple):
    """Gains and filter steps of the controllers, and the gyro's biquad (b0, b1, b2, a1, a2)."""

    p: float
    i: float
    d: float
    ff: float
    angle_p: float
    alpha_target: float
    alpha_error: float
    alpha_derivative: float
    imax: float
    limit: float
    b0: float
    b1: float
    b2: float
    a1: float
    a2: float


@njit(cache=True, nogil=True)
def fly_axis(
    c: AxisNumbers,
    g: ControllerNumbers,
    h: float,
    substeps: int,
    chirp: Floats,
    wanted: Floats,
    gust: Floats,
    noise: Floats,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """Fly one axis.

    Parameters
    ----------
    chirp, wanted : ndarray, shape (N,)
        Chirp at the mixer, and attitude target [rad], at every loop.
    gust, noise : ndarray, shape (N * substeps,)
        Disturbing angular acceleration, rad/s^2, and noise of the raw gyro, rad/s.

    Returns
    -------
    output, measured, feedback, target, angle : ndarray, shape (N,)
        Mixer input with the chirp, filtered rate, the controller's part of the mixer input, rate target, attitude.
    """
    n = len(chirp)
    output, measured, feedback = np.zeros(n), np.zeros(n), np.zeros(n)
    target, attitude = np.zeros(n), np.zeros(n)
    pending = np.zeros(c.delay_steps + 1)
    motor = rate = angle = flex = flex_rate = 0.0
    z1 = z2 = low = 0.0
    integral = filtered = error = derivative = 0.0
    decay = np.exp(-h / c.lag) if c.lag > 0.0 else 0.0
    loop = h * substeps
    head = 0
    length = c.delay_steps + 1
    for k in range(n):
        measured[k], attitude[k] = low, angle
        want = g.angle_p * (wanted[k] - angle)
        target[k] = want
        filtered += g.alpha_target * (want - filtered)
        before = error
        error += g.alpha_error * (filtered - low - error)
        derivative += g.alpha_derivative * ((error - before) / loop - derivative)
        integral = min(max(integral + g.i * error * loop, -g.imax), g.imax)
        feedback[k] = g.p * error + integral + g.d * derivative + g.ff * filtered
        u = min(max(feedback[k] + chirp[k], -g.limit), g.limit)
        output[k] = u
        for j in range(substeps):
            pending[head] = u
            head = (head + 1) % length
            command = pending[head]
            motor = command + (motor - command) * decay
            push = c.gain * motor + gust[k * substeps + j]
            rate += h * (push - c.damping * rate)
            angle += h * rate
            moving = rate
            if c.flex_omega > 0.0:
                bend = c.flex_share * push - 2.0 * c.flex_damping * c.flex_omega * flex_rate - c.flex_omega**2 * flex
                flex_rate += h * bend
                flex += h * flex_rate
                moving += flex_rate
            z0 = moving + noise[k * substeps + j] - z1 * g.a1 - z2 * g.a2
            low = z0 * g.b0 + z1 * g.b1 + z2 * g.b2
            z2, z1 = z1, z0
    return output, measured, feedback, target, attitude
