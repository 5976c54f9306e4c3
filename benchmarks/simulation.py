"""How fast the simulator flies: a long flight with sensors and log, and the fine step of Motion 2018."""

import dataclasses
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.optimize import fsolve

from simulation import CASES, elhesasy2024, fly, guntur2019, propagate, write_case
from simulation.mission import GoTo, Wait
from simulation.rotor import BladeElementRotor


def run() -> list[tuple[str, str, str, str, str]]:
    long = dataclasses.replace(
        CASES["octa04_bergen_gusty"].setup.mission,
        steps=tuple(step for k in range(6) for step in (GoTo(8.0 * (k % 2), 6.0, 8.0 + k % 3), Wait(14.0))),
    )
    case = CASES["octa04_bergen_gusty"]
    case = dataclasses.replace(case, setup=dataclasses.replace(case.setup, mission=long))
    flown = fly(case.setup).truth.index[-1]  # compiles
    with tempfile.TemporaryDirectory() as folder:
        logged = _cpu(lambda: write_case(case, Path(folder)))

    vehicle = elhesasy2024.octocopter()
    hover = np.full(8, vehicle.hover_speed(9.80665))
    start = np.concatenate(([0, 0, -20], np.zeros(3), [1, 0, 0, 0], np.zeros(3), hover)).astype(float)
    propagate(vehicle, start, lambda t, x: hover, 0.01, dt=1e-4)
    fine = _cpu(lambda: propagate(vehicle, start, lambda t, x: hover, 60.0, dt=1e-4, hold=100))
    ours, thesis = _blade_element()
    return [
        (f"{flown:.0f} s flight at 800 Hz, sensors and log", f"{logged:.2f} s", "-", "-", "3 s for 180 s"),
        ("60 s open loop, RK4 at 1e-4 s (600 000 steps), 100 commands a second", f"{fine:.2f} s", "-", "-", "1 s"),
        (
            "step of RK4 with four blade-element rotors",
            f"{1e6 * ours:.1f} us",
            f"{1e6 * thesis:.0f} us (fsolve)",
            f"{thesis / ours:.0f}x",
            "200x",
        ),
    ]


def _blade_element() -> tuple[float, float]:
    """CPU seconds of a step of Guntur 2019: ours, and with `fsolve` for each rotor and stage as the thesis has it."""
    motor = guntur2019.MOTORS[1]
    craft = guntur2019.quadcopter(motor, 0.5)
    speeds = np.full(4, craft.hover_speed(guntur2019.GRAVITY))
    start = np.concatenate((np.zeros(6), [1.0], np.zeros(6), speeds))
    propagate(craft, start, lambda t, x: speeds, 0.1, dt=0.01)
    ours = _cpu(lambda: propagate(craft, start, lambda t, x: speeds, 1000.0, dt=0.01, hold=100_000)) / 100_000

    rotor = craft.rotors[0].rotor
    assert isinstance(rotor, BladeElementRotor)
    blade = rotor.parameters
    speed = float(speeds[0])

    def residual(v: float) -> float:
        tip = speed * blade.radius
        lift = 0.25 * 1.225 * blade.lift * blade.radius
        thrust = lift * (-v * tip + 2 / 3 * tip**2 * (blade.theta0 + 0.75 * blade.theta1))
        return float(np.squeeze(2.0 * v * 1.225 * blade.area * np.sqrt(v**2) - thrust))

    def thesis() -> None:
        for _ in range(4 * 4):
            fsolve(residual, 0.1)

    return ours, min(_cpu(thesis) for _ in range(20))


def _cpu(work: Callable[[], object]) -> float:
    """CPU seconds of a call."""
    start = time.process_time()
    work()
    return time.process_time() - start
