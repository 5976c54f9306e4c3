"""One axis: a plant with a known frequency response, its controllers, and what shakes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from simulation.rate_loop._kernels import AxisConstants, AxisSignals, fly_axis

Floats = NDArray[np.float64]

#: Rate of the controllers, Hz, and steps of the physics in one of theirs.
LOOP_HZ = 400.0
_SUBSTEPS = 12


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisPlant:
    """What turns the controller's output into a rate (or, where it does not integrate, into an acceleration)."""

    gain: float  #: rad/s^2 (or m/s^2) per unit of the output.
    damping: float = 2.0  #: Of the rate, 1/s.
    lag: float = 0.0  #: Time constant of the motors, s; 0: none.
    delay: float = 0.0  #: From output to motors, s, beside the half period of the loop that holding the output costs.
    #: Frequency of a flexible mode, 0: none; its damping, and its part of the acceleration.
    flex_hz: float = 0.0
    flex_damping: float = 0.03
    flex_share: float = 0.0
    filter_hz: float = 20.0  #: Corner of the second-order low-pass of the sensor; 0: none.
    integrates: bool = True

    @property
    def total_delay(self) -> float:
        """Return the delay with that of the hold, s."""
        return self.delay_steps * _step() + 0.5 / LOOP_HZ

    @property
    def delay_steps(self) -> int:
        """Return the delay in steps of the physics."""
        return round(self.delay / _step())

    def response(self, hz: Floats) -> NDArray[np.complex128]:
        """Return the frequency response from logged output to logged measurement, shape (n,).

        Exactly that of the recursion which `fly_axis` computes, whose steps count as the time of their end.
        """
        hz = np.asarray(hz, dtype=np.float64)
        h = _step()
        z = np.exp(2j * np.pi * hz * h)
        held = np.mean(z[:, None] ** -np.arange(1.0, _SUBSTEPS + 1.0), axis=1)
        push = self.gain * held * z**-self.delay_steps
        if self.lag > 0.0:
            decay = np.exp(-h / self.lag)
            push = push * (1.0 - decay) * z / (z - decay) * 0.5 * (1.0 + 1.0 / z)
        fall = np.exp(-self.damping * h)
        through = (1.0 - fall) / self.damping if self.damping > 0.0 else h
        moving = push * z * through / (z - fall) if self.integrates else push
        if self.flex_hz > 0.0:
            omega = 2.0 * np.pi * self.flex_hz
            moving = moving + push * h * self.flex_share * z / _oscillator(z, h, omega, self.flex_damping)
        if self.filter_hz > 0.0:
            warp = (z - 1.0) / (z + 1.0) / np.tan(np.pi * self.filter_hz * h)
            moving = moving / (warp**2 + np.sqrt(2.0) * warp + 1.0)
        return np.asarray(moving)


def _oscillator(z: NDArray[np.complex128], h: float, omega: float, damping: float) -> NDArray[np.complex128]:
    """Return the denominator of a semi-implicit oscillator's velocity."""
    return np.asarray((z - 1.0 + 2.0 * damping * omega * h) + (h * omega) ** 2 * z / (z - 1.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisController:
    """Angle P over rate PID, with the filters of target and derivative, Hz."""

    p: float
    i: float
    d: float
    angle_p: float = 4.5
    target_hz: float = 20.0
    derivative_hz: float = 20.0
    limit: float = 0.5

    @classmethod
    def crossing_at(cls, plant: AxisPlant, hz: float) -> AxisController:
        """Choose gains with which the rate loop of a plant crosses unity at about `hz`."""
        p = 1.0 / float(np.abs(plant.response(np.array([hz]))[0]))
        return cls(p=p, i=p, d=0.02 * p) if plant.integrates else cls(p=0.3 * p, i=6.0 * p, d=0.0, angle_p=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """What shakes an axis."""

    duration: float  #: s.
    #: Start and stop frequency, Hz, and magnitude; magnitude 0: none. The chirp lasts from `chirp_start` on for
    #: `chirp_seconds`, faded in and out over a second, after two cycles at its start frequency.
    chirp: tuple[float, float, float] = (0.5, 40.0, 0.0)
    chirp_start: float = 0.0
    chirp_seconds: float = 20.0
    sid_axis: int = 10  #: 10 to 13: at the mixer; 7 to 9: on the rate target.
    stick: float = 0.0  #: Standard deviation of random sticks, rad (or m/s^2), held for 0.4 to 2.5 s each.
    #: Standard deviation of disturbing accelerations, rad/s^2 (or m/s^2), first-order with `gust_hz`.
    gust: float = 0.0
    gust_hz: float = 1.0
    noise: float = 0.0  #: Standard deviation of the sensor's noise after its filter, rad/s (or m/s^2).


@dataclass(frozen=True, slots=True, eq=False)
class AxisRun:
    """Signals of one axis at the loop's rate, shape (N,); see `fly_axis`."""

    t: Floats
    output: Floats
    measured: Floats
    target: Floats
    attitude: Floats
    stick: Floats
    chirp: Floats
    chirp_hz: Floats
    elapsed: Floats
    excitation: Excitation


def run_axis(plant: AxisPlant, controller: AxisController, excitation: Excitation, seed: int) -> AxisRun:
    """Fly one axis of known response; every number comes from the seed."""
    rng = np.random.default_rng(seed)
    n = round(excitation.duration * LOOP_HZ)
    t = np.arange(n) / LOOP_HZ
    chirp, frequency, elapsed = _chirp(t, excitation)
    stick = _sticks(rng, n, excitation.stick, smooth=plant.integrates)
    at_mixer = excitation.sid_axis >= 10
    pole = np.exp(-2.0 * np.pi * excitation.gust_hz * _step())
    gust = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.normal(0.0, excitation.gust, n * _SUBSTEPS))
    signals = AxisSignals(
        stick=stick,
        rate_chirp=np.zeros(n) if at_mixer else chirp,
        mixer_chirp=chirp if at_mixer else np.zeros(n),
        noise=rng.normal(0.0, excitation.noise, n),
        disturbance=gust.reshape(n, _SUBSTEPS),
    )
    constants = AxisConstants(
        gain=plant.gain,
        damping=plant.damping,
        lag=plant.lag,
        delay_steps=plant.delay_steps,
        flex_omega=2.0 * np.pi * plant.flex_hz,
        flex_damping=plant.flex_damping,
        flex_share=plant.flex_share,
        integrates=plant.integrates,
        filter_omega=2.0 * np.pi * plant.filter_hz,
        p=controller.p,
        i=controller.i,
        d=controller.d,
        angle_p=controller.angle_p,
        target_corner=2.0 * np.pi * controller.target_hz,
        derivative_corner=2.0 * np.pi * controller.derivative_hz,
        limit=controller.limit,
    )
    output, measured, target, attitude = fly_axis(constants, signals, 1.0 / LOOP_HZ)
    return AxisRun(t, output, measured, target, attitude, stick, chirp, frequency, elapsed, excitation)


def _step() -> float:
    return 1.0 / (LOOP_HZ * _SUBSTEPS)


def _chirp(t: Floats, excitation: Excitation) -> tuple[Floats, Floats, Floats]:
    """Return the chirp, its frequency [Hz] and its clock [s; NaN outside], as ModeSystemId makes them."""
    low, high, magnitude = excitation.chirp
    elapsed = t - excitation.chirp_start
    during = (elapsed >= 0.0) & (elapsed <= excitation.chirp_seconds) & (magnitude != 0.0)
    hold = min(2.0 / low, 0.4 * excitation.chirp_seconds)
    sweep = np.clip(elapsed - hold, 0.0, None) / (excitation.chirp_seconds - hold)
    frequency = low * (high / low) ** np.clip(sweep, 0.0, 1.0)
    phase = 2.0 * np.pi * np.cumsum(np.where(during, frequency, 0.0)) / LOOP_HZ
    fade = np.clip(np.minimum(elapsed, excitation.chirp_seconds - elapsed), 0.0, 1.0)
    window = 0.5 - 0.5 * np.cos(np.pi * fade)
    chirp = np.where(during, magnitude * window * np.sin(phase), 0.0)
    return chirp, np.where(during, frequency, 0.0), np.where(during, elapsed, np.nan)


def _sticks(rng: np.random.Generator, n: int, spread: float, *, smooth: bool) -> Floats:
    """Return random targets, each held for 0.4 to 2.5 s, passed through a second-order filter of 2 Hz."""
    levels = np.empty(n)
    k = 0
    while k < n:
        length = int(rng.uniform(0.4, 2.5) * LOOP_HZ)
        levels[k : k + length] = rng.normal(0.0, spread) if spread else 0.0
        k += length
    pole = np.exp(-2.0 * np.pi * (2.0 if smooth else 8.0) / LOOP_HZ)
    return np.asarray(lfilter([(1.0 - pole) ** 2], [1.0, -2.0 * pole, pole**2], levels))
