"""Compiled loop of one axis in ArduCopter's controllers: physics at 4.8 kHz, controllers at 400 Hz."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from core.compiled import njit
from simulation.atmosphere import GRAVITY

Floats = NDArray[np.float64]


#: Drag over mass of a craft that drifts, 1/s.
_DRAG = 0.3


class AxisConstants(NamedTuple):
    """Numbers of one axis, SI; `lag` 0 and `flex_omega` 0 mean none."""

    gain: float
    damping: float
    lag: float
    delay_steps: int
    flex_omega: float
    flex_damping: float
    flex_share: float
    integrates: bool
    filter_omega: float
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
    #: Of a craft that holds its place: velocity per position [1/s] and acceleration per velocity [1/s]; 0 for none.
    position_p: float
    velocity_p: float


class AxisSignals(NamedTuple):
    """Forcing of one axis: shape (N,) at the loop's rate, `gyro_noise` and `disturbance` (N, substeps)."""

    stick: Floats
    position_chirp: Floats
    velocity_chirp: Floats
    rate_chirp: Floats
    mixer_chirp: Floats
    noise: Floats
    gyro_noise: Floats
    disturbance: Floats


@njit(cache=True, nogil=True)
def fly_axis(
    c: AxisConstants, f: AxisSignals, loop: float
) -> tuple[Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats, Floats]:
    """Fly one axis.

    Returns
    -------
    output, feedback, integral, derivative, measured, unfiltered, asked, target, angle, lean : ndarray, shape (N,)
        Controller output with the chirp and without, two of its terms, filtered measurement that it was computed from,
        mean over the loop before of what the filter got, rate target before and after its filter, attitude and its
        target.
    """
    n, substeps = f.disturbance.shape
    h = loop / substeps
    output, feedback, measured = np.zeros(n), np.zeros(n), np.zeros(n)
    target, attitude, leans, terms = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((2, n))
    unfiltered, asked = np.zeros(n), np.zeros(n)
    pending = np.zeros(c.delay_steps + 1)
    motor = rate = angle = flex = flex_rate = 0.0
    position = velocity = 0.0
    low = first = second = 0.0
    # Bilinear biquad of the second-order Butterworth low-pass.
    warp = np.tan(0.5 * c.filter_omega * h)
    scale = 1.0 / (1.0 + 1.4142135623730951 * warp + warp**2)
    ahead, back1, back2 = warp**2 * scale, 2.0 * (warp**2 - 1.0) * scale, (1.0 - 1.4142135623730951 * warp + warp**2)
    back2 *= scale
    integral = filtered = error = derivative = 0.0
    decay = np.exp(-h / c.lag) if c.lag > 0.0 else 0.0
    fall = np.exp(-c.damping * h)
    for k in range(n):
        y = low + f.noise[k]
        measured[k], attitude[k] = y, angle
        lean = f.stick[k]
        if c.velocity_p > 0.0:
            wanted = c.position_p * (f.position_chirp[k] - position) + f.velocity_chirp[k]
            lean += c.velocity_p * (wanted - velocity) / GRAVITY
            velocity += loop * (GRAVITY * angle - _DRAG * velocity)
            position += loop * velocity
        leans[k] = lean
        want = c.angle_p * (lean - angle) if c.integrates else lean
        want += f.rate_chirp[k]
        # As in the firmware, the rate controller runs before the angle controller and sees its target a loop later.
        filtered += c.alpha_target * ((asked[k - 1] if k else 0.0) - filtered)
        asked[k] = want
        target[k] = filtered
        error_before = error
        error += c.alpha_error * (filtered - y - error)
        derivative += c.alpha_derivative * ((error - error_before) / loop - derivative)
        integral = min(max(integral + c.i * error * loop, -c.imax), c.imax)
        feedback[k] = c.p * error + integral + c.d * derivative + c.ff * filtered
        terms[0, k], terms[1, k] = integral, c.d * derivative
        u = min(max(feedback[k] + f.mixer_chirp[k], -c.limit), c.limit)
        output[k] = u
        for j in range(substeps):
            for m in range(c.delay_steps):
                pending[m] = pending[m + 1]
            pending[c.delay_steps] = u
            command = pending[0]
            before = motor
            motor = command + (motor - command) * decay
            push = c.gain * 0.5 * (before + motor if c.lag > 0.0 else 2.0 * motor) + f.disturbance[k, j]
            if c.integrates:
                rate_before = rate
                rate = rate * fall + push * (1.0 - fall) / c.damping if c.damping > 0.0 else rate + push * h
                angle += 0.5 * h * (rate + rate_before)
                moving = rate
            else:
                moving = push
            if c.flex_omega > 0.0:
                bend = c.flex_share * push - 2.0 * c.flex_damping * c.flex_omega * flex_rate - c.flex_omega**2 * flex
                flex_rate += h * bend
                flex += h * flex_rate
                moving += flex_rate
            moving += f.gyro_noise[k, j]
            if k + 1 < n:
                unfiltered[k + 1] += moving / substeps
            if c.filter_omega > 0.0:
                low = ahead * moving + first
                first = 2.0 * ahead * moving - back1 * low + second
                second = ahead * moving - back2 * low
            else:
                low = moving
    return output, feedback, terms[0], terms[1], measured, unfiltered, asked, target, attitude, leans
