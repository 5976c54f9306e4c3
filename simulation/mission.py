"""Missions: what the autopilot is told to do, and the reference that comes out of it."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from simulation._kernels import DISARMED, FLYING, IDLE, LANDING
from simulation.errors import ParameterError

#: Length of a position-control tick, s.
TICK: Final = 0.0125


@dataclass(frozen=True, slots=True)
class Wait:
    """Hold the position for `seconds`."""

    seconds: float


@dataclass(frozen=True, slots=True)
class GoTo:
    """Fly straight to a point and stop there.

    Attributes
    ----------
    north, east, up : float
        From the place of take-off, m.
    speed : float
        Largest speed on the way, m/s.
    """

    north: float
    east: float
    up: float
    speed: float = 3.0


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn on the spot to `heading_deg` [degrees clockwise from north]."""

    heading_deg: float


Step = Wait | GoTo | Turn


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """Stand, arm, take off, fly the steps, land where the last one ended.

    Attributes
    ----------
    takeoff : float
        Height of the first hover, m.
    steps : tuple of Wait, GoTo or Turn
    heading_deg : float
        Heading on the ground, held in flight unless turned.
    disarmed, armed : float
        Time on the ground before arming and between arming and take-off, s.
    acceleration : float
        Largest acceleration of the reference, m/s^2.
    """

    takeoff: float
    steps: tuple[Step, ...]
    heading_deg: float = 0.0
    disarmed: float = 6.0
    armed: float = 2.0
    acceleration: float = 1.2

    def __post_init__(self) -> None:
        if not 1.0 <= self.takeoff <= 120.0:
            raise ParameterError(f"take-off height {self.takeoff:g} m must lie between 1 and 120 m")
        for step in self.steps:
            if isinstance(step, GoTo) and not (1.0 <= step.up <= 500.0 and 0.1 <= step.speed <= 20.0):
                raise ParameterError(f"{step}: fly between 1 and 500 m above the ground, at 0.1 to 20 m/s")
            if isinstance(step, Wait) and not 0.0 <= step.seconds <= 600.0:
                raise ParameterError(f"{step}: wait between 0 and 600 s")

    def reference(self, descent: float = 0.5, after: float = 6.0) -> "Reference":
        """Plan the mission.

        Legs are straight, from rest to rest, with the quintic of least jerk, as slow as the limits of speed and
        acceleration ask. The landing sinks with `descent` [m/s] for `after` [s] longer than the height takes, so
        that the ground is met.
        """
        planner = _Planner(math.radians(self.heading_deg))
        planner.hold(self.disarmed, DISARMED)
        planner.hold(self.armed, IDLE)
        takeoff = planner.ticks
        planner.leg(np.array([0.0, 0.0, -self.takeoff]), 1.5, self.acceleration)
        planner.hold(2.0, FLYING)
        items: list[tuple[float, str]] = []
        for step in self.steps:
            if isinstance(step, Wait):
                items.append((planner.ticks * TICK, f"hold {step.seconds:g} s"))
                planner.hold(step.seconds, FLYING)
            elif isinstance(step, GoTo):
                items.append((planner.ticks * TICK, f"go to {step.north:g} {step.east:g} {step.up:g} m"))
                planner.leg(np.array([step.north, step.east, -step.up]), step.speed, self.acceleration)
            else:
                items.append((planner.ticks * TICK, f"turn to {step.heading_deg:g} deg"))
                planner.turn(math.radians(step.heading_deg))
        land = planner.ticks
        planner.sink(descent, after)
        phase = np.concatenate(planner.phases)
        samples = np.concatenate(planner.samples)
        return Reference(
            phase=phase,
            samples=samples,
            arm=self.disarmed,
            takeoff=takeoff * TICK,
            land=land * TICK,
            items=tuple(items),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A planned mission.

    Attributes
    ----------
    phase : ndarray of int, shape (M,)
        DISARMED, IDLE, FLYING or LANDING at each tick of `TICK`.
    samples : ndarray, shape (M, 10)
        Position [m], velocity [m/s], acceleration [m/s^2] in NED, and yaw [rad].
    arm, takeoff, land : float
        Times of arming, take-off and the start of landing, s.
    items : tuple of (float, str)
        Start [s] and name of each step.
    """

    phase: np.ndarray
    samples: np.ndarray
    arm: float
    takeoff: float
    land: float
    items: tuple[tuple[float, str], ...]


class _Planner:
    """Strings segments together, each sampled at ticks."""

    def __init__(self, yaw: float) -> None:
        self.position = np.zeros(3)
        self.yaw = yaw
        self.phases: list[np.ndarray] = []
        self.samples: list[np.ndarray] = []

    @property
    def ticks(self) -> int:
        return sum(len(phase) for phase in self.phases)

    def add(self, phase: int, samples: np.ndarray) -> None:
        self.phases.append(np.full(len(samples), phase, dtype=np.int64))
        self.samples.append(samples)

    def still(self, n: int) -> np.ndarray:
        samples = np.zeros((n, 10))
        samples[:, 0:3] = self.position
        samples[:, 9] = self.yaw
        return samples

    def hold(self, seconds: float, phase: int) -> None:
        self.add(phase, self.still(round(seconds / TICK)))

    def leg(self, target: np.ndarray, speed: float, acceleration: float) -> None:
        offset = target - self.position
        distance = math.sqrt(float((offset * offset).sum()))
        # Peaks of the quintic: speed 15/8 d/T, acceleration 10/sqrt(3) d/T^2.
        seconds = max(1.875 * distance / speed, math.sqrt(10.0 / math.sqrt(3.0) * distance / acceleration))
        n = max(math.ceil(seconds / TICK), 1)
        T = n * TICK
        s = np.arange(n) / n
        samples = self.still(n)
        samples[:, 0:3] += np.outer(s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), offset)
        samples[:, 3:6] = np.outer(30.0 * s * s * (1.0 - s) * (1.0 - s) / T, offset)
        samples[:, 6:9] = np.outer(60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / T**2, offset)
        self.add(FLYING, samples)
        self.position = target

    def turn(self, yaw: float, rate: float = 0.5) -> None:
        change = math.remainder(yaw - self.yaw, 2.0 * math.pi)
        n = max(math.ceil(1.875 * abs(change) / rate / TICK), 1)
        s = np.arange(n) / n
        samples = self.still(n)
        samples[:, 9] += change * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
        self.add(FLYING, samples)
        self.yaw += change

    def sink(self, speed: float, after: float) -> None:
        n = round((-self.position[2] / speed + after) / TICK)
        samples = self.still(n)
        samples[:, 2] += speed * TICK * np.arange(n)
        samples[:, 5] = speed
        self.add(LANDING, samples)
