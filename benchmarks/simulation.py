"""How fast the simulator flies: a long flight with sensors and log, and the fine step of Motion 2018."""

import dataclasses
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from simulation import CASES, elhesasy2024, fly, propagate, write_case
from simulation.mission import GoTo, Wait


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
    return [
        (f"{flown:.0f} s flight at 800 Hz, sensors and log", f"{logged:.2f} s", "-", "-", "3 s for 180 s"),
        ("60 s open loop, RK4 at 1e-4 s (600 000 steps), 100 commands a second", f"{fine:.2f} s", "-", "-", "1 s"),
    ]


def _cpu(work: Callable[[], object]) -> float:
    """CPU seconds of a call."""
    start = time.process_time()
    work()
    return time.process_time() - start
