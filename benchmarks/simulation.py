"""How fast the simulator flies: a long flight with sensors and log, and the fine step of Motion 2018."""

import dataclasses
import tempfile
from pathlib import Path

import numpy as np
from scipy.optimize import fsolve

from benchmarks._measure import Row, cpu, row
from simulation import FLIGHTS, guntur2019, motion2018, propagate, write_sample_logs
from simulation.mission import GoTo, Wait
from simulation.rotor import BladeElementRotor
from simulation.sample_logs import fly_sample, write_flight


def run() -> list[Row]:
    sample = FLIGHTS["octa04_bergen_gusty"]
    steps = tuple(step for k in range(6) for step in (GoTo(8.0 * (k % 2), 6.0, 8.0 + k % 3), Wait(17.0)))
    mission = dataclasses.replace(sample.setup.mission, steps=steps)
    sample = dataclasses.replace(sample, setup=dataclasses.replace(sample.setup, mission=mission, step=1e-3))
    flown = fly_sample(sample).truth.index[-1]  # compiles
    with tempfile.TemporaryDirectory() as folder:
        write_flight(sample, Path(folder))
        logged = cpu(lambda: write_flight(sample, Path(folder)), 3)
        every = cpu(lambda: write_sample_logs(folder))
    euler = _euler()
    there, flight = _spatial()
    ours, thesis = _blade_element()
    return [
        row(f"{flown:.0f} s octocopter mission at 1 kHz, sensors and log", f"{logged:.2f} s", goal="< 3 s"),
        row(
            "60 s of Motion 2018, Euler at 1e-4 s (600 000 steps), autopilot at 100 Hz", f"{euler:.2f} s", goal="< 1 s"
        ),
        row(f"Motion 2018, spatial flight until arrival ({flight:.1f} s)", f"{there:.2f} s"),
        row("all of sample_logs/", f"{every:.1f} s", goal="< 20 s"),
        (
            "step of RK4 with four blade-element rotors",
            f"{1e6 * ours:.1f} us",
            f"{1e6 * thesis:.0f} us (fsolve)",
            f"{thesis / ours:.0f}x",
            "> 200",
        ),
    ]


def _euler() -> float:
    """CPU seconds of a minute about a point, the autopilot never told that it has arrived."""
    craft = motion2018.quadcopter()
    start = craft.state(np.full(4, 300.0), position=(5.0, 16.0, -3.0))
    autopilot = motion2018.Autopilot(craft, np.array([48.0, 81.0, -35.0]), 5.0, motion2018.Gains())

    def flight() -> None:
        propagate(craft, start, autopilot, 60.0, dt=1e-4, hold=100, every=10, method="euler", wind=(-0.5, 0.0, 0.0))

    return cpu(flight, 3)


def _spatial() -> tuple[float, float]:
    """CPU seconds of the paper's spatial flight, and how long it takes in the air."""
    flown = motion2018.fly_to_point(motion2018.SPATIAL)
    return cpu(lambda: motion2018.fly_to_point(motion2018.SPATIAL)), float(flown.index[-1])


def _blade_element() -> tuple[float, float]:
    """CPU seconds of a step of Guntur 2019: ours, and with `fsolve` for each rotor and stage as the thesis has it.

    Alternating, because the machine is shared: the best of twenty of either.
    """
    motor = guntur2019.MOTORS[1]
    craft = guntur2019.quadcopter(motor, 0.5)
    speeds = np.full(4, craft.hover_speed(guntur2019.GRAVITY))
    start = craft.state(speeds)
    propagate(craft, start, lambda t, x: speeds, 0.1, dt=0.01)

    def steps() -> None:
        propagate(craft, start, lambda t, x: speeds, 100.0, dt=0.01, hold=10_000)

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

    pairs = [(cpu(steps) / 10_000, cpu(thesis)) for _ in range(20)]
    return min(ours for ours, _ in pairs), min(peer for _, peer in pairs)
