"""Missions: the steps that the autopilot flies, and the reference planned from them."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from simulation._kernels import DISARMED, FLYING, IDLE, LANDING
from simulation.errors import ParameterError

#: Default period of position control, s; attitude control runs five times, physics ten times per tick.
TICK: Final = 0.0125

#: Speed of a landing, m/s.
DESCENT = 0.5

#: Longest mission, s.
LONGEST: Final = 3600.0

#: What a chirp can be added to, in the order of ArduPilot's SID_AXIS 10 to 13 (at the mixer).
CHIRP_AXES: Final = ("roll", "pitch", "yaw", "throttle")


@dataclass(frozen=True, slots=True)
class Wait:
    """Hold the position for `seconds`."""

    seconds: float


@dataclass(frozen=True, slots=True)
class GoTo:
    """Fly straight to a point and stop there."""

    #: From the place of take-off, m.
    north: float
    east: float
    up: float
    speed: float = 3.0  #: Largest speed on the way, m/s.


@dataclass(frozen=True, slots=True)
class Turn:
    """Turn on the spot to `heading_deg` [degrees clockwise from north]."""

    heading_deg: float


@dataclass(frozen=True, slots=True)
class FlownChirp:
    """Stay level, hold height and heading while a chirp is added at the mixer: SYSTEMID mode.

    The first frequency is held for two periods, then the frequency grows exponentially.
    """

    axis: str  #: One of `CHIRP_AXES`.
    magnitude: float  #: Of the sine, as a fraction of the mixer's range.
    start_hz: float = 0.3
    stop_hz: float = 12.0
    seconds: float = 24.0  #: Length of the sweep after the first two periods.
    fade: float = 1.5  #: Time over which the sine grows at the start and shrinks at the end, s.
    placed: bool = False  #: Whether position is held meanwhile, which SYSTEMID does not do.

    @property
    def hold(self) -> float:
        """Time at the first frequency, s."""
        return 2.0 / self.start_hz

    @property
    def duration(self) -> float:
        """Total time, s."""
        return self.hold + self.seconds

    def frequency(self, t: np.ndarray) -> np.ndarray:
        """Return the frequency [Hz] at times [s] from the start of the chirp."""
        growth = math.log(self.stop_hz / self.start_hz) / self.seconds
        frequency: np.ndarray = self.start_hz * np.exp(growth * np.clip(t - self.hold, 0.0, self.seconds))
        return frequency

    def signal(self, t: np.ndarray) -> np.ndarray:
        """Return the chirp at times [s] from its start; zero outside it."""
        growth = math.log(self.stop_hz / self.start_hz) / self.seconds
        swept = np.clip(t - self.hold, 0.0, self.seconds)
        turns = self.start_hz * (np.minimum(t, self.hold) + np.expm1(growth * swept) / growth)
        window = np.clip(np.minimum(t, self.duration - t) / self.fade, 0.0, 1.0)
        window = 0.5 - 0.5 * np.cos(np.pi * window)
        signal: np.ndarray = self.magnitude * window * np.sin(2.0 * np.pi * turns)
        return signal


Step = Wait | GoTo | Turn | FlownChirp


@dataclass(frozen=True, slots=True, kw_only=True)
class Mission:
    """Wait on the ground, arm, take off, fly the steps, land where the last one ended."""

    takeoff: float  #: Height of the first hover, m.
    steps: tuple[Step, ...]
    heading_deg: float = 0.0  #: Heading on the ground, held in flight until a `Turn`.
    #: Time on the ground before arming and between arming and take-off, s.
    disarmed: float = 6.0
    armed: float = 2.0
    acceleration: float = 1.2  #: Largest acceleration of the reference, m/s^2.

    def __post_init__(self) -> None:
        if not 1.0 <= self.takeoff <= 120.0:
            raise ParameterError(f"take-off height {self.takeoff:g} m must lie between 1 and 120 m")
        for step in self.steps:
            if isinstance(step, GoTo) and not (1.0 <= step.up <= 500.0 and 0.1 <= step.speed <= 20.0):
                raise ParameterError(f"{step}: fly between 1 and 500 m above the ground, at 0.1 to 20 m/s")
            if isinstance(step, GoTo) and not math.hypot(step.north, step.east) <= 20e3:
                raise ParameterError(f"{step}: fly within 20 km of the take-off, where the ground is flat enough")
            if isinstance(step, Wait) and not 0.0 <= step.seconds <= 600.0:
                raise ParameterError(f"{step}: wait between 0 and 600 s")

    def reference(self, tick: float = TICK) -> "Reference":
        """Plan the mission for position control every `tick` [s].

        Legs are straight, from rest to rest, with the minimum-jerk quintic within the limits of speed and acceleration.
        The landing descends for longer than the height takes, so that the craft reaches the ground.
        """
        planner = _Planner(math.radians(self.heading_deg), tick)
        planner.hold(self.disarmed, DISARMED)
        planner.hold(self.armed, IDLE)
        takeoff = planner.now
        planner.leg(np.array([0.0, 0.0, -self.takeoff]), 1.5, self.acceleration)
        planner.hold(2.0, FLYING)
        items: list[tuple[float, str]] = []
        chirps: list[tuple[float, FlownChirp]] = []
        for step in self.steps:
            if isinstance(step, Wait):
                items.append((planner.now, f"hold {step.seconds:g} s"))
                planner.hold(step.seconds, FLYING)
            elif isinstance(step, GoTo):
                items.append((planner.now, f"go to {step.north:g} {step.east:g} {step.up:g} m"))
                planner.leg(np.array([step.north, step.east, -step.up]), step.speed, self.acceleration)
            elif isinstance(step, FlownChirp):
                items.append((planner.now, f"chirp on {step.axis}"))
                chirps.append((planner.now, step))
                planner.hold(step.duration, FLYING)
            else:
                items.append((planner.now, f"turn to {step.heading_deg:g} deg"))
                planner.turn(math.radians(step.heading_deg))
        land = planner.now
        planner.sink()
        return Reference(
            phase=np.concatenate(planner.phases),
            samples=np.concatenate(planner.samples),
            arm=self.disarmed,
            takeoff=takeoff,
            land=land,
            items=tuple(items),
            chirps=tuple(chirps),
            tick=tick,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """A planned mission."""

    phase: np.ndarray  #: shape (M,): DISARMED, IDLE, FLYING or LANDING at each tick.
    samples: np.ndarray  #: shape (M, 10): Position [m], velocity [m/s], acceleration [m/s^2] in NED, and yaw [rad].
    #: Times of arming, take-off and the start of landing, s.
    arm: float
    takeoff: float
    land: float
    items: tuple[tuple[float, str], ...]  #: Start [s] and name of each step.
    chirps: tuple[tuple[float, FlownChirp], ...]  #: Start [s] and chirp.
    tick: float  #: s.

    def tick_at(self, t: np.ndarray) -> np.ndarray:
        """Return the row of `samples` in force at times [s]."""
        return np.minimum((t / self.tick + 1e-9).astype(np.int64), len(self.samples) - 1)

    def excitation(self) -> np.ndarray:
        """Return the chirps on roll, pitch, yaw and throttle at each attitude-control step; shape (5 M, 4)."""
        added = np.zeros((5 * len(self.phase), 4))
        t = np.arange(len(added)) * (self.tick / 5.0)
        for start, chirp in self.chirps:
            during = (t >= start) & (t <= start + chirp.duration)
            added[during, CHIRP_AXES.index(chirp.axis)] = chirp.signal(t[during] - start)
        return added

    def level(self) -> np.ndarray:
        """Return at each tick whether a chirp is flown without position control, shape (M,)."""
        t = np.arange(len(self.phase)) * self.tick
        level = np.zeros(t.shape, dtype=bool)
        for start, chirp in self.chirps:
            if not chirp.placed:
                level |= (t >= start) & (t <= start + chirp.duration)
        return level


class _Planner:
    """Builds a reference of consecutive segments, each sampled at ticks."""

    def __init__(self, yaw: float, tick: float) -> None:
        self.tick = tick
        self.position = np.zeros(3)
        self.yaw = yaw
        self.phases: list[np.ndarray] = []
        self.samples: list[np.ndarray] = []

    @property
    def now(self) -> float:
        return sum(len(phase) for phase in self.phases) * self.tick

    def ticks(self, seconds: float) -> int:
        """Return the whole ticks that cover a time; ParameterError if the mission becomes too long."""
        if not self.now + seconds <= LONGEST:
            raise ParameterError(
                f"the mission would take {self.now + seconds:.0f} s, and {LONGEST:.0f} s are the most: "
                "nearer points, more speed or shorter waits"
            )
        return max(math.ceil(seconds / self.tick), 1)

    def add(self, phase: int, samples: np.ndarray) -> None:
        self.phases.append(np.full(len(samples), phase, dtype=np.int64))
        self.samples.append(samples)

    def still(self, n: int) -> np.ndarray:
        samples = np.zeros((n, 10))
        samples[:, 0:3] = self.position
        samples[:, 9] = self.yaw
        return samples

    def hold(self, seconds: float, phase: int) -> None:
        self.ticks(seconds)
        self.add(phase, self.still(round(seconds / self.tick)))

    def leg(self, target: np.ndarray, speed: float, acceleration: float) -> None:
        offset = target - self.position
        distance = math.sqrt(float((offset * offset).sum()))
        # Peaks of the quintic: speed 15/8 d/T, acceleration 10/sqrt(3) d/T^2.
        seconds = max(1.875 * distance / speed, math.sqrt(10.0 / math.sqrt(3.0) * distance / acceleration))
        n = self.ticks(seconds)
        T = n * self.tick
        s = np.arange(n) / n
        samples = self.still(n)
        samples[:, 0:3] += np.outer(s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), offset)
        samples[:, 3:6] = np.outer(30.0 * s * s * (1.0 - s) * (1.0 - s) / T, offset)
        samples[:, 6:9] = np.outer(60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / T**2, offset)
        self.add(FLYING, samples)
        self.position = target

    def turn(self, yaw: float) -> None:
        change = math.remainder(yaw - self.yaw, 2.0 * math.pi)
        n = self.ticks(1.875 * abs(change) / 0.5)  # at 0.5 rad/s at most
        s = np.arange(n) / n
        samples = self.still(n)
        samples[:, 9] += change * s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
        self.add(FLYING, samples)
        self.yaw += change

    def sink(self) -> None:
        n = round((-self.position[2] / DESCENT + 6.0) / self.tick)  # longer than the height takes
        samples = self.still(n)
        samples[:, 2] += DESCENT * self.tick * np.arange(n)
        samples[:, 5] = DESCENT
        self.add(LANDING, samples)
