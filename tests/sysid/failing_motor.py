"""Flights in which one motor loses thrust at a known time: rotation of a rigid body under a rate controller."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from logparse import Tables, Vehicle
from logparse.frames import motor_table

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


def _thrust(pwm: np.ndarray) -> np.ndarray:
    command = np.clip((pwm - 1000.0 - 1000.0 * SPIN_MIN) / (1000.0 * (SPIN_MAX - SPIN_MIN)), 0.0, 1.0)
    return (1.0 - EXPO) * command + EXPO * command**2


def _pwm(thrust: np.ndarray) -> np.ndarray:
    thrust = np.clip(thrust, 0.0, 1.0)
    command = (EXPO - 1.0 + np.sqrt((1.0 - EXPO) ** 2 + 4.0 * EXPO * thrust)) / (2.0 * EXPO)
    return np.round(1000.0 + 1000.0 * (SPIN_MIN + command * (SPIN_MAX - SPIN_MIN)))


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

    Parameters
    ----------
    gust : float
        Standard deviation of the disturbing moments, in parts of a motor's full thrust; correlated over 2 s.
    drift : float
        How much the balance of the moments wanders linearly over the flight, same unit.
    shift : tuple, optional
        Time [s] and sudden change of roll, pitch and yaw moment, as when a payload drops.
    off : float
        Standard deviation of lasting moments, as of a centre of gravity to one side.
    """
    rng = np.random.default_rng(seed)
    factors = np.array([[motor.roll, motor.pitch, motor.yaw] for motor in vehicle.motors])
    mixer = factors / np.maximum(np.sum(factors**2, axis=0), 1e-9)
    count = round(seconds / STEP)
    gain, damping = np.array([60.0, 60.0, 8.0]), np.array([0.3, 0.3, 0.2])
    offset = rng.normal(0.0, off, 3)
    wander = rng.normal(0.0, 1.0, 3) * drift
    rate, angle, integral, disturbance = (np.zeros(3) for _ in range(4))
    target = np.zeros(3)
    outputs, rates = [], []
    keep = np.exp(-STEP / 2.0)
    hover = 0.35
    for k in range(count):
        t = k * STEP
        if k % round(0.8 / STEP) == 0:
            target = rng.normal(0.0, [0.15, 0.15, 0.5])
        disturbance = keep * disturbance + np.sqrt(1.0 - keep**2) * rng.normal(0.0, gust, 3)
        asked = np.append(5.0 * (target[:2] - angle[:2]), target[2])
        error = asked - rate
        integral = np.clip(integral + STEP * error * [0.3, 0.3, 0.08], -0.4, 0.4)
        command = error * [0.1, 0.1, 0.25] + integral
        wanted = hover * (1.0 + 0.03 * np.sin(0.7 * t)) + mixer @ (command * np.sum(factors**2, axis=0) / 2.0)
        pwm = _pwm(wanted)
        real = pwm.copy()
        for fault in faults:
            if fault.t <= t < fault.until:
                real[fault.motor - 1] = 1000.0 + fault.part * (pwm[fault.motor - 1] - 1000.0)
        moment = factors.T @ _thrust(real) + offset + wander * t / seconds + disturbance
        if shift is not None and t >= shift[0]:
            moment = moment + shift[1:]
        if k % round(OUTPUTS / STEP) == 0:
            outputs.append((t, *pwm))
        if k % round(RATES / STEP) == 0:
            rates.append((t, *(rate + rng.normal(0.0, 0.003, 3)), *rng.normal(0.0, 0.1, 2), -9.8))
        rate = rate + STEP * (gain * moment - damping * rate)
        angle = angle + STEP * rate
    motors = pd.DataFrame(outputs, columns=["t", *(f"m{motor.number}" for motor in vehicle.motors)]).set_index("t")
    imu = pd.DataFrame(rates, columns=["t", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]).set_index(
        "t"
    )
    return Tables(motors=motors, imu=imu)


def remaining_thrust(tables: Tables, fault: Fault) -> float:
    """Return the true part of the thrust that is left: the PWM is cut, thrust follows by its curve."""
    pwm = tables.motors[f"m{fault.motor}"].loc[fault.t + 1.0 : fault.until].to_numpy()

    def thrust(values: np.ndarray) -> np.ndarray:
        command = np.clip((values - 1150.0) / 800.0, 0.0, 1.0)
        return 0.35 * command + 0.65 * command**2

    return float(np.sum(thrust(1000.0 + fault.part * (pwm - 1000.0)) * thrust(pwm)) / np.sum(thrust(pwm) ** 2))
