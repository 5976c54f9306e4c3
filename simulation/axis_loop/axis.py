"""One axis: a plant with a known frequency response, ArduCopter's controllers, and what shakes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from simulation.axis_loop._kernels import AxisConstants, AxisSignals, fly_axis

Floats = NDArray[np.float64]

#: Rate of the controllers, Hz, and steps of the physics in one of theirs.
LOOP_HZ = 400.0
_SUBSTEPS = 12

#: Where the chirp of a SID_AXIS is added; others are added to the rate target.
_POINTS = {
    **dict.fromkeys(range(10, 14), "mixer"),
    **dict.fromkeys((14, 15), "position"),
    **dict.fromkeys(range(16, 20), "velocity"),
}
#: Rate of the physics and of the gyro's filter, Hz.
GYRO_HZ = LOOP_HZ * _SUBSTEPS


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
    filter_hz: float = 20.0  #: Corner of the second-order low-pass of the sensor (INS_GYRO_FILTER); 0: none.
    integrates: bool = True

    @property
    def total_delay(self) -> float:
        """Return the delay with that of the hold, s."""
        return self.delay_steps / GYRO_HZ + 0.5 / LOOP_HZ

    @property
    def delay_steps(self) -> int:
        """Return the delay in steps of the physics."""
        return round(self.delay * GYRO_HZ)

    def response(self, hz: Floats) -> NDArray[np.complex128]:
        """Return the frequency response from logged output to logged measurement, shape (n,).

        Exactly that of the recursion which `fly_axis` computes, whose steps count as the time of their end.
        """
        hz = np.asarray(hz, dtype=np.float64)
        h = 1.0 / GYRO_HZ
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
class LoopGains:
    """ArduCopter's parameters of one axis (ATC_RAT_*, ATC_ANG_*_P); filters in Hz, 0 for none."""

    P: float
    I: float  # noqa: E741 -- the field's letter
    D: float
    FF: float = 0.0
    FLTT: float = 20.0
    FLTE: float = 0.0
    FLTD: float = 20.0
    IMAX: float = 0.5
    angle_P: float = 4.5  # noqa: N815 -- spelled as the parameter
    limit: float = 1.0  #: Largest output.
    position_P: float = 0.0  # noqa: N815 -- spelled as PSC_POSXY_P; of a craft that holds its place, 1/s
    velocity_P: float = 0.0  # noqa: N815 -- spelled as PSC_VELXY_P; 0: nothing holds its place

    @classmethod
    def crossing_at(cls, plant: AxisPlant, hz: float) -> LoopGains:
        """Choose gains with which the rate loop of a plant crosses unity at about `hz`."""
        p = 1.0 / float(np.abs(plant.response(np.array([hz]))[0]))
        return cls(P=p, I=p, D=0.02 * p) if plant.integrates else cls(P=0.3 * p, I=6.0 * p, D=0.0, angle_P=0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Excitation:
    """What shakes an axis."""

    duration: float  #: s.
    #: Start and stop frequency, Hz, and magnitude; magnitude 0: none. The chirp lasts from `chirp_start` on for
    #: `chirp_seconds`, faded in and out over `chirp_fades`, and sweeps after two cycles at its start frequency.
    chirp: tuple[float, float, float] = (0.5, 40.0, 0.0)
    chirp_start: float = 0.0
    chirp_seconds: float = 20.0
    chirp_fades: tuple[float, float] = (1.0, 1.0)
    #: 10 to 13: at the mixer; 14 and 15: on the place that is held [m]; 16 to 19: on the velocity [m/s]; others: on the
    #: rate target.
    sid_axis: int = 10
    stick: float = 0.0  #: Standard deviation of random sticks, rad (or m/s^2), held for 0.4 to 2.5 s each.
    #: Standard deviation of disturbing accelerations, rad/s^2 (or m/s^2), first-order with `gust_hz`.
    gust: float = 0.0
    gust_hz: float = 1.0
    noise: float = 0.0  #: Standard deviation of the sensor's noise after its filter, rad/s (or m/s^2).
    gyro_noise: float = 0.0  #: The same before the filter, at every step of the physics.


@dataclass(frozen=True, slots=True, eq=False)
class AxisRun:
    """Signals of one axis at the loop's rate, shape (N,); see `fly_axis`."""

    t: Floats
    output: Floats
    feedback: Floats
    integral: Floats
    derivative: Floats
    measured: Floats
    unfiltered: Floats  #: Before the sensor's filter, mean over the loop before.
    asked: Floats  #: Rate target before its filter; `target` is behind it.
    target: Floats
    attitude: Floats
    stick: Floats
    chirp: Floats
    chirp_hz: Floats
    elapsed: Floats
    excitation: Excitation


def run_axis(plant: AxisPlant, gains: LoopGains, excitation: Excitation, seed: int) -> AxisRun:
    """Fly one axis of known response; every number comes from the seed.

    Parameters
    ----------
    plant : AxisPlant
        The axis, from mixer to rate.
    gains : LoopGains
        ArduCopter's controllers.
    excitation : Excitation
        Sticks, chirp, gusts and noise.
    seed : int
        Of all random numbers.
    """
    rng = np.random.default_rng(seed)
    n = round(excitation.duration * LOOP_HZ)
    t = np.arange(n) / LOOP_HZ
    chirp, frequency, elapsed = _chirp(t, excitation)
    stick = _sticks(rng, n, excitation.stick, smooth=plant.integrates)
    added_to = _POINTS.get(excitation.sid_axis, "rate")
    added = {point: chirp if point == added_to else np.zeros(n) for point in ("rate", "mixer", "position", "velocity")}
    pole = np.exp(-2.0 * np.pi * excitation.gust_hz / GYRO_HZ)
    gust = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], rng.normal(0.0, excitation.gust, n * _SUBSTEPS))
    signals = AxisSignals(
        stick=stick,
        position_chirp=added["position"],
        velocity_chirp=added["velocity"],
        rate_chirp=added["rate"],
        mixer_chirp=added["mixer"],
        noise=rng.normal(0.0, excitation.noise, n),
        gyro_noise=rng.normal(0.0, excitation.gyro_noise, (n, _SUBSTEPS)),
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
        p=gains.P,
        i=gains.I,
        d=gains.D,
        ff=gains.FF,
        angle_p=gains.angle_P,
        alpha_target=_alpha(gains.FLTT),
        alpha_error=_alpha(gains.FLTE),
        alpha_derivative=_alpha(gains.FLTD),
        imax=gains.IMAX,
        limit=gains.limit,
        position_p=gains.position_P,
        velocity_p=gains.velocity_P,
    )
    return AxisRun(t, *fly_axis(constants, signals, 1.0 / LOOP_HZ), chirp, frequency, elapsed, excitation)


def random_axis(rng: np.random.Generator) -> tuple[AxisPlant, LoopGains]:
    """Draw a craft and gains that it flies with: nano to heavy, slow and fast motors, some with a flexible mode."""
    lag = float(np.exp(rng.uniform(np.log(0.008), np.log(0.06))))
    delay = float(rng.uniform(0.0, 0.008))
    flexible = rng.random() < 0.3
    plant = AxisPlant(
        gain=float(np.exp(rng.uniform(np.log(60.0), np.log(900.0)))),
        damping=float(rng.uniform(0.0, 4.0)),
        lag=lag,
        delay=delay,
        flex_hz=float(rng.uniform(18.0, 40.0)) if flexible else 0.0,
        flex_damping=float(rng.uniform(0.03, 0.1)),
        flex_share=float(rng.uniform(-0.15, 0.15)) if flexible else 0.0,
        filter_hz=float(rng.choice([20.0, 30.0, 40.0, 60.0])),
    )
    # A crossover that lag, delay and filter allow, by what pilots fly: from timid to bold.
    limit = 1.0 / (lag + delay + 0.0025 + 0.22 / plant.filter_hz)
    p = limit * float(rng.uniform(0.35, 0.8)) / plant.gain
    return plant, LoopGains(P=p, I=p * float(rng.uniform(0.5, 1.0)), D=p * float(rng.uniform(0.01, 0.03)))


def _alpha(cutoff: float) -> float:
    """Return the step of a first-order low-pass at the loop rate; 1 for none."""
    dt = 1.0 / LOOP_HZ
    return 1.0 if cutoff <= 0.0 else dt / (dt + 1.0 / (2.0 * np.pi * cutoff))


def _chirp(t: Floats, excitation: Excitation) -> tuple[Floats, Floats, Floats]:
    """Return the chirp, its frequency [Hz] and its clock [s; NaN outside], as ModeSystemId makes them."""
    low, high, magnitude = excitation.chirp
    elapsed = t - excitation.chirp_start
    during = (elapsed >= 0.0) & (elapsed <= excitation.chirp_seconds) & (magnitude != 0.0)
    hold = min(2.0 / low, 0.4 * excitation.chirp_seconds)
    sweep = np.clip(elapsed - hold, 0.0, None) / (excitation.chirp_seconds - hold)
    frequency = low * (high / low) ** np.clip(sweep, 0.0, 1.0)
    phase = 2.0 * np.pi * np.cumsum(np.where(during, frequency, 0.0)) / LOOP_HZ
    ends = (elapsed, excitation.chirp_seconds - elapsed)
    faded = [np.clip(time / fade, 0.0, 1.0) for time, fade in zip(ends, excitation.chirp_fades, strict=True)]
    window = 0.5 - 0.5 * np.cos(np.pi * np.minimum(*faded))
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
