"""Flights in which one motor loses thrust at a known time: rotation of a rigid body under a rate controller."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.signal import lfilter

from logparse import Tables, Vehicle
from logparse.craft.frames import motor_table
from tests.timed import inertial, timed

#: Steps of the simulation [s], of logged outputs and of logged rates.
STEP, OUTPUTS, RATES = 0.005, 0.1, 0.04
EXPO, SPIN_MIN, SPIN_MAX = 0.65, 0.15, 0.95


@dataclass(frozen=True)
class Fault:
    """One motor gives `part` of its output above 1000 us from `t` on, until `until`."""

    motor: int
    t: float
    part: float
    until: float = np.inf


def craft(frame_class: str, frame_type: str) -> Vehicle:
    return Vehicle(
        frame_class=frame_class,
        frame_type=frame_type,
        motors=motor_table(frame_class, frame_type, None),
        thrust_expo=EXPO,
        spin_min=SPIN_MIN,
        spin_max=SPIN_MAX,
    )


@njit(cache=True)
def _thrust(pwm):
    command = np.clip((pwm - 1000.0 - 1000.0 * SPIN_MIN) / (1000.0 * (SPIN_MAX - SPIN_MIN)), 0.0, 1.0)
    return (1.0 - EXPO) * command + EXPO * command**2


@njit(cache=True)
def _pwm(thrust):
    thrust = np.clip(thrust, 0.0, 1.0)
    command = (EXPO - 1.0 + np.sqrt((1.0 - EXPO) ** 2 + 4.0 * EXPO * thrust)) / (2.0 * EXPO)
    return np.round(1000.0 + 1000.0 * (SPIN_MIN + command * (SPIN_MAX - SPIN_MIN)))


@njit(cache=True)
def _rotate(factors, shares, parts, targets, moments):
    """Turn under a rate controller: the motors' outputs [us] and angular rates [rad/s] before each step."""
    gain, damping = np.array([60.0, 60.0, 8.0]), np.array([0.3, 0.3, 0.2])
    into, limit = np.array([0.3, 0.3, 0.08]), 0.4
    proportional, hover = np.array([0.1, 0.1, 0.25]), 0.35
    pwm, rates = np.empty_like(parts), np.empty_like(moments)
    rate, angle, integral, asked = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(len(parts)):
        asked[:2] = 5.0 * (targets[k, :2] - angle[:2])
        asked[2] = targets[k, 2]
        error = asked - rate
        integral = np.clip(integral + STEP * error * into, -limit, limit)
        command = error * proportional + integral
        pwm[k] = _pwm(hover * (1.0 + 0.03 * np.sin(0.7 * k * STEP)) + shares @ command)
        rates[k] = rate
        moment = factors.T @ _thrust(1000.0 + parts[k] * (pwm[k] - 1000.0)) + moments[k]
        rate = rate + STEP * (gain * moment - damping * rate)
        angle = angle + STEP * rate
    return pwm, rates


def fly(
    vehicle: Vehicle,
    seed: int,
    *faults: Fault,
    seconds: float = 40.0,
    gust: float = 0.004,
    drift: float = 0.0,
    shift: tuple[float, float, float, float] | None = None,
    off: float = 0.02,
) -> Tables:
    """Fly with random sticks, a centre of gravity off the middle and coloured gusts of moment.

    Standard deviations in parts of a motor's full thrust: `gust` of moments correlated over 2 s, `drift` of a linear
    wander over the flight, `off` of lasting ones. `shift`: time [s] and sudden change about roll, pitch and yaw.
    """
    rng = np.random.default_rng(seed)
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in vehicle.motors])
    squares = np.sum(factors**2, axis=0)
    count = round(seconds / STEP)
    offset, wander = rng.normal(0.0, off, 3), rng.normal(0.0, drift, 3)
    t = STEP * np.arange(count)
    held = np.arange(count) // round(0.8 / STEP)
    targets = rng.normal(0.0, [0.15, 0.15, 0.5], (held[-1] + 1, 3))[held]
    keep = np.exp(-STEP / 2.0)
    moments = lfilter([np.sqrt(1.0 - keep**2)], [1.0, -keep], rng.normal(0.0, gust, (count, 3)), axis=0)
    moments += offset + np.outer(t / seconds, wander)
    if shift is not None:
        moments[t >= shift[0]] += shift[1:]
    parts = np.ones((count, len(factors)))
    for fault in faults:
        parts[(t >= fault.t) & (t < fault.until), fault.motor - 1] = fault.part
    pwm, rates = _rotate(factors, factors / np.maximum(squares, 1e-9) * squares / 2.0, parts, targets, moments)
    every, seen = round(OUTPUTS / STEP), slice(None, None, round(RATES / STEP))
    rates = rates[seen] + rng.normal(0.0, 0.003, rates[seen].shape)
    force = rng.normal([0.0, 0.0, -9.8], [0.1, 0.1, 0.0], rates.shape)
    outputs = {f"m{motor.number}": pwm[::every, k] for k, motor in enumerate(vehicle.motors)}
    return Tables(motors=timed(t[::every], **outputs), imu=inertial(t[seen], rates, force))


def remaining_thrust(tables: Tables, fault: Fault) -> float:
    """Return the true part of the thrust that is left: the PWM is cut, thrust follows by its curve."""
    pwm = tables.motors[f"m{fault.motor}"].loc[fault.t + 1.0 : fault.until].to_numpy()

    def thrust(values: np.ndarray) -> np.ndarray:
        command = np.clip((values - 1150.0) / 800.0, 0.0, 1.0)
        return 0.35 * command + 0.65 * command**2

    return float(np.sum(thrust(1000.0 + fault.part * (pwm - 1000.0)) * thrust(pwm)) / np.sum(thrust(pwm) ** 2))
