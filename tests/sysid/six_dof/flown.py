"""A quadrotor flown in closed loop by an independent simulator: quaternions, SI quantities, Runge-Kutta at 1 kHz."""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from logparse import Motor, Vehicle
from sysid.records.experiment import Experiment
from tests.sysid.craft_flights import of_craft

MASS, ARM = 1.2, 0.22
INERTIA = np.array([0.011, 0.014, 0.023])
THRUST, TORQUE, ROTOR_INERTIA = 1.1e-5, 1.8e-7, 4e-5
ROTOR_DRAG = np.array([0.25, 0.30, 0.35])  # 1/s at hover
QUADRATIC = np.array([0.02, 0.03, 0.04])  # 1/m
MOTOR_LAG = 0.03
GRAVITY = 9.80665
HOVER = np.sqrt(MASS * GRAVITY / 4 / THRUST)
ANGLES = np.radians([45.0, -135.0, -45.0, 135.0])
SPINS = np.array([-1.0, -1.0, 1.0, 1.0])

MOTORS = tuple(
    Motor(k + 1, None, float(ANGLES[k]), int(SPINS[k]), 0, float(-np.sin(ANGLES[k])), float(np.cos(ANGLES[k])), 0.0)
    for k in range(4)
)


@dataclass(frozen=True)
class Flown:
    t: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    quaternion: np.ndarray
    rates: np.ndarray
    speeds: np.ndarray
    commands: np.ndarray
    reference: np.ndarray


@njit(cache=True)
def _slope(out, state, wind, craft, drag, quadratic, cmd):
    """Write the derivative of a state to `out`. Of plain loops, which compile in a fifth of the time of arrays."""
    mass, arm, thrust, torque, rotor_inertia, hover = craft[:6]
    inertia, angles, spins = craft[6:9], craft[9:13], craft[13:17]
    a, b, c, d = state[6:10]
    x, y, z = state[10:13]
    rotation = (
        (1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)),
        (2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)),
        (2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)),
    )
    lift = momentum = roll = pitch = yaw = speeds = 0.0
    for j in range(4):
        speed = state[13 + j]
        out[13 + j] = (cmd[j] - speed) / 0.03
        push = thrust * speed**2
        lift += push
        speeds += speed
        momentum += rotor_inertia * spins[j] * speed
        roll -= np.sin(angles[j]) * push
        pitch += np.cos(angles[j]) * push
        yaw -= spins[j] * (torque * speed**2 + rotor_inertia * out[13 + j])
    v0, v1, v2 = state[3] - wind[0], state[4] - wind[1], state[5] - wind[2]
    air = (
        rotation[0][0] * v0 + rotation[1][0] * v1 + rotation[2][0] * v2,
        rotation[0][1] * v0 + rotation[1][1] * v1 + rotation[2][1] * v2,
        rotation[0][2] * v0 + rotation[1][2] * v1 + rotation[2][2] * v2,
    )
    fast, rotors = np.sqrt(air[0] ** 2 + air[1] ** 2 + air[2] ** 2), speeds / 4 / hover
    f0 = -(drag[0] * rotors + quadratic[0] * fast) * air[0]
    f1 = -(drag[1] * rotors + quadratic[1] * fast) * air[1]
    f2 = -(drag[2] * rotors + quadratic[2] * fast) * air[2] - lift / mass
    for k in range(3):
        out[k] = state[3 + k]
        out[3 + k] = rotation[k][0] * f0 + rotation[k][1] * f1 + rotation[k][2] * f2
    out[5] += 9.80665
    h0, h1, h2 = inertia[0] * x, inertia[1] * y, inertia[2] * z + momentum
    out[10] = (arm * roll - (y * h2 - z * h1)) / inertia[0]
    out[11] = (arm * pitch - (z * h0 - x * h2)) / inertia[1]
    out[12] = (yaw - (x * h1 - y * h0)) / inertia[2]
    out[6] = 0.5 * (-b * x - c * y - d * z)
    out[7] = 0.5 * (a * x + c * z - d * y)
    out[8] = 0.5 * (a * y - b * z + d * x)
    out[9] = 0.5 * (a * z + b * y - c * x)


@njit(cache=True)
def _fly(n, every, goals, gusts, pushes, craft, drag, quadratic):
    mass, arm, thrust, torque, _, hover = craft[:6]
    inertia, angles, spins = craft[6:9], craft[9:13], craft[13:17]
    state, between = np.zeros(17), np.empty(17)
    state[6] = 1.0
    state[13:17] = hover
    h = 0.001
    out = np.empty((n // every, 17))
    commands = np.empty((n // every, 4))
    slopes = np.empty((4, 17))
    cmd, moment, gain = np.full(4, hover), np.empty(3), (18.0, 18.0, 6.0)
    for k in range(n):
        goal = goals[k // every]
        if k % 4 == 0:
            a, b, c, d = state[6:10]
            forward_n = min(max(1.2 * (goal[0] - state[0]) - 1.6 * state[3], -6.0), 6.0)
            forward_e = min(max(1.2 * (goal[1] - state[1]) - 1.6 * state[4], -6.0), 6.0)
            yaw = np.arctan2(2 * (b * c + a * d), 1 - 2 * (c * c + d * d))
            forward = np.cos(yaw) * forward_n + np.sin(yaw) * forward_e
            right = -np.sin(yaw) * forward_n + np.cos(yaw) * forward_e
            roll = np.arctan2(2 * (a * b + c * d), 1 - 2 * (b * b + c * c))
            pitch = np.arcsin(2 * (a * c - d * b))
            rate = (8 * (right / 9.8 - roll), 8 * (-forward / 9.8 - pitch), 2.0 * (goal[3] - yaw))
            for j in range(3):
                moment[j] = inertia[j] * (gain[j] * (rate[j] - state[10 + j]) + pushes[k // every, j])
            lift = mass * (9.80665 - (1.2 * (goal[2] - state[2]) - 1.6 * state[5]))
            for j in range(4):
                square = lift / 4 / thrust
                square += moment[0] * -np.sin(angles[j]) / (2 * arm * thrust)
                square += moment[1] * np.cos(angles[j]) / (2 * arm * thrust)
                square += moment[2] * -spins[j] / (4 * torque)
                cmd[j] = np.sqrt(min(max(square, (0.3 * hover) ** 2), (1.6 * hover) ** 2))
        if k % every == 0:
            for j in range(17):
                out[k // every, j] = state[j]
            for j in range(4):
                commands[k // every, j] = cmd[j]
        for stage in range(4):
            step = (0.0, 0.5 * h, 0.5 * h, h)[stage]
            for j in range(17):
                between[j] = state[j] + step * slopes[stage - 1, j] if stage else state[j]
            _slope(slopes[stage], between, gusts[k // every], craft, drag, quadratic, cmd)
        for j in range(17):
            state[j] += h / 6 * (slopes[0, j] + 2 * slopes[1, j] + 2 * slopes[2, j] + slopes[3, j])
        size = np.sqrt(state[6] ** 2 + state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
        for j in range(6, 10):
            state[j] /= size
    return out, commands


def fly(seconds: float, seed: int, rate: int = 100, wind=(0.0, 0.0), gust: float = 0.0, shake: float = 20.0) -> Flown:
    """Fly from goal to goal; `shake` adds a known-to-nobody excitation of the moments, rad/s^2."""
    rng = np.random.default_rng(seed)
    n = int(seconds * rate)
    corners = rng.uniform([-6, -6, -3, -1], [6, 6, 3, 1], (int(seconds // 3) + 1, 4))
    goals = np.repeat(corners, 3 * rate, axis=0)[:n]
    keep = np.exp(-1.0 / (2.0 * rate))
    walk = np.zeros((n, 3))
    noise = rng.standard_normal((n, 3)) * gust * np.sqrt(1 - keep**2)
    for k in range(1, n):
        walk[k] = keep * walk[k - 1] + noise[k]
    gusts = walk + np.pad(np.broadcast_to(wind, (n, 2)), ((0, 0), (0, 1)))
    pushes = np.repeat(rng.standard_normal((n // 8 + 1, 3)), 8, axis=0)[:n] * np.array([1.0, 1.0, 0.3]) * shake
    every = 1000 // rate
    craft = np.r_[MASS, ARM, THRUST, TORQUE, ROTOR_INERTIA, HOVER, INERTIA, ANGLES, SPINS]
    states, commands = _fly(n * every, every, goals, gusts, pushes, craft, ROTOR_DRAG, QUADRATIC)
    return Flown(
        t=np.arange(n) / rate,
        position=states[:, :3],
        velocity=states[:, 3:6],
        quaternion=states[:, 6:10],
        rates=states[:, 10:13],
        speeds=states[:, 13:],
        commands=commands,
        reference=goals,
    )


def commanded(flown: Flown, name: str, seed: int = 0, drift: float = 0.0, charge: float = 1.0) -> Experiment:
    """Measure a flight by its commands, which grow as the battery runs down: thrust drifts by `drift`, 1/s.

    A battery of another `charge` gives so many times the thrust of the same commands.
    """
    measured = experiment(flown, name, seed)
    middle = 0.5 * (flown.t[0] + flown.t[-1])
    commands = (flown.commands / (2.0 * HOVER)) ** 2 / charge / (1.0 + drift * (flown.t - middle))[:, None]
    return replace(measured, u=commands, units={f"m{k + 1}": "1" for k in range(4)})


def experiment(flown: Flown, name: str, seed: int = 0, noise: float = 1.0, delays=(0, 0, 0, 0)) -> Experiment:
    """Measure a flight: rotor speeds (telemetry late by `delays` samples), motion with noise of motion capture."""
    rng = np.random.default_rng(seed + 1000)
    n = len(flown.t)
    rows = [np.maximum(np.arange(n) - late, 0) for late in delays]
    speeds = np.column_stack([flown.speeds[row, k] for k, row in enumerate(rows)])
    speeds = speeds + noise * 2.0 * rng.standard_normal(speeds.shape)
    position = flown.position + noise * 5e-4 * rng.standard_normal((n, 3))
    velocity = flown.velocity + noise * 5e-3 * rng.standard_normal((n, 3))
    rates = flown.rates + noise * 5e-3 * rng.standard_normal((n, 3))
    context = {f"v_{axis}": velocity[:, k] for k, axis in enumerate("ned")}
    context |= {f"w_{axis}": rates[:, k] for k, axis in enumerate("xyz")}
    context |= {f"q_{part}": flown.quaternion[:, k] for k, part in enumerate("wxyz")}
    units = {f"m{k + 1}": "rad/s" for k in range(4)}
    up = position * np.array([1.0, 1.0, -1.0])
    return of_craft(flown.t, speeds, up, context, Vehicle(motors=MOTORS), name, units=units)
