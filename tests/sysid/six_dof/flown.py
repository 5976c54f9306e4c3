"""A quadrotor flown in closed loop by an independent simulator: quaternions, SI quantities, Runge-Kutta at 1 kHz."""

from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numba import njit

from logparse import Motor, Vehicle
from sysid.records.experiment import Experiment

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
def _slope(state, wind, mass, arm, inertia, thrust, torque, rotor_inertia, drag, quadratic, hover, angles, spins, cmd):
    q, v, w, speed = state[6:10], state[3:6], state[10:13], state[13:17]
    out = np.empty(17)
    out[:3] = v
    a, b, c, d = q
    rotation = np.array(
        [
            [1 - 2 * (c * c + d * d), 2 * (b * c - a * d), 2 * (b * d + a * c)],
            [2 * (b * c + a * d), 1 - 2 * (b * b + d * d), 2 * (c * d - a * b)],
            [2 * (b * d - a * c), 2 * (c * d + a * b), 1 - 2 * (b * b + c * c)],
        ]
    )
    air = rotation.T @ (v - wind)
    force = -drag * (speed.mean() / hover) * air - quadratic * np.sqrt((air**2).sum()) * air
    lift = thrust * speed**2
    force[2] -= lift.sum() / mass
    out[3:6] = rotation @ force
    out[5] += 9.80665
    turn = (cmd - speed) / 0.03
    momentum = rotor_inertia * (spins * speed).sum()
    moment = np.array(
        [
            arm * (-np.sin(angles) * lift).sum(),
            arm * (np.cos(angles) * lift).sum(),
            torque * (-spins * speed**2).sum() - rotor_inertia * (spins * turn).sum(),
        ]
    )
    whole = inertia * w
    whole[2] += momentum
    moment -= np.array(
        [w[1] * whole[2] - w[2] * whole[1], w[2] * whole[0] - w[0] * whole[2], w[0] * whole[1] - w[1] * whole[0]]
    )
    out[10:13] = moment / inertia
    x, y, z = w
    out[6] = 0.5 * (-b * x - c * y - d * z)
    out[7] = 0.5 * (a * x + c * z - d * y)
    out[8] = 0.5 * (a * y - b * z + d * x)
    out[9] = 0.5 * (a * z + b * y - c * x)
    out[13:17] = turn
    return out


@njit(cache=True)
def _fly(
    n, every, goals, gusts, pushes, mass, arm, inertia, thrust, torque, rotor, drag, quadratic, hover, angles, spins
):
    state = np.zeros(17)
    state[6] = 1.0
    state[13:17] = hover
    h = 0.001
    out = np.empty((n // every, 17))
    commands = np.empty((n // every, 4))
    cmd = np.full(4, hover)
    for k in range(n):
        goal = goals[k // every]
        if k % 4 == 0:
            a, b, c, d = state[6:10]
            wanted = 1.2 * (goal[:3] - state[:3]) - 1.6 * state[3:6]
            wanted[:2] = np.minimum(np.maximum(wanted[:2], -6.0), 6.0)
            yaw = np.arctan2(2 * (b * c + a * d), 1 - 2 * (c * c + d * d))
            forward = np.cos(yaw) * wanted[0] + np.sin(yaw) * wanted[1]
            right = -np.sin(yaw) * wanted[0] + np.cos(yaw) * wanted[1]
            roll = np.arctan2(2 * (a * b + c * d), 1 - 2 * (b * b + c * c))
            pitch = np.arcsin(2 * (a * c - d * b))
            rate = np.array([8 * (right / 9.8 - roll), 8 * (-forward / 9.8 - pitch), 2.0 * (goal[3] - yaw)])
            gain = np.array([18.0, 18.0, 6.0]) * inertia
            moment = gain * (rate - state[10:13]) + pushes[k // every] * inertia
            lift = mass * (9.80665 - wanted[2])
            for j in range(4):
                square = lift / 4 / thrust
                square += moment[0] * -np.sin(angles[j]) / (2 * arm * thrust)
                square += moment[1] * np.cos(angles[j]) / (2 * arm * thrust)
                square += moment[2] * -spins[j] / (4 * torque)
                cmd[j] = np.sqrt(min(max(square, (0.3 * hover) ** 2), (1.6 * hover) ** 2))
        if k % every == 0:
            out[k // every] = state
            commands[k // every] = cmd
        wind = gusts[k // every]
        craft = (wind, mass, arm, inertia, thrust, torque, rotor, drag, quadratic, hover, angles, spins, cmd)
        k1 = _slope(state, *craft)
        k2 = _slope(state + 0.5 * h * k1, *craft)
        k3 = _slope(state + 0.5 * h * k2, *craft)
        k4 = _slope(state + h * k3, *craft)
        state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        state[6:10] /= np.sqrt((state[6:10] ** 2).sum())
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
    states, commands = _fly(
        n * every, every, goals, gusts, pushes, MASS, ARM, INERTIA, THRUST, TORQUE, ROTOR_INERTIA, ROTOR_DRAG,
        QUADRATIC, HOVER, ANGLES, SPINS,
    )  # fmt: skip
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
    context = pd.DataFrame(
        {f"v_{axis}": velocity[:, k] for k, axis in enumerate("ned")}
        | {f"w_{axis}": rates[:, k] for k, axis in enumerate("xyz")}
        | {f"q_{part}": flown.quaternion[:, k] for k, part in enumerate("wxyz")},
        index=flown.t,
    )
    return Experiment.from_arrays(
        flown.t,
        speeds,
        position * np.array([1.0, 1.0, -1.0]),
        name=name,
        input_names=[f"m{k + 1}" for k in range(4)],
        output_names=["x", "y", "z"],
        units={f"m{k + 1}": "rad/s" for k in range(4)},
        context=context,
        vehicle=Vehicle(motors=MOTORS),
    )
