"""A craft's axis with a known frequency response, ArduCopter's controllers around it, and a flight with a chirp."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from simulation.copter_loop._kernels import AxisNumbers, ControllerNumbers, fly_axis

Floats = NDArray[np.float64]

#: Rates of controllers and physics, Hz.
LOOP_HZ, SUBSTEPS = 400.0, 5
GYRO_HZ = LOOP_HZ * SUBSTEPS


@dataclass(frozen=True, slots=True, kw_only=True)
class CraftAxis:
    """What turns mixer input into a body rate."""

    gain: float  #: rad/s^2 per unit of mixer input.
    damping: float = 1.0  #: 1/s.
    #: Of the motors, s.
    lag: float = 0.02
    delay: float = 0.003
    #: A flexible mode between motors and gyro; frequency 0 for none; its share of the acceleration.
    flex_hz: float = 0.0
    flex_damping: float = 0.05
    flex_share: float = 0.0

    @property
    def delay_steps(self) -> int:
        """Return the delay in steps of the physics."""
        return round(self.delay * GYRO_HZ)

    def response(self, hz: Floats) -> NDArray[np.complex128]:
        """Return mixer input to raw rate at the controller's samples: exactly that of the recursion, shape (n,)."""
        h = 1.0 / GYRO_HZ
        z = np.exp(2j * np.pi * np.asarray(hz, np.float64) * h)
        held = np.mean(z[:, None] ** -np.arange(1.0, SUBSTEPS + 1.0), axis=1) * z ** float(-self.delay_steps)
        if self.lag > 0.0:
            decay = math.exp(-h / self.lag)
            held = held * (1.0 - decay) / (1.0 - decay / z)
        push = self.gain * held
        moving = push * h / (1.0 - (1.0 - self.damping * h) / z)
        if self.flex_hz > 0.0:
            omega = 2.0 * np.pi * self.flex_hz
            # v = v/z + h (s push - 2 d w v/z - w^2 x/z), x = h v / (1 - 1/z)
            under = 1.0 - (1.0 - 2.0 * self.flex_damping * omega * h) / z + (omega * h) ** 2 / z / (1.0 - 1.0 / z)
            moving = moving + h * self.flex_share * push / under
        return np.asarray(moving)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopGains:
    """ArduCopter's parameters of one axis (ATC_RAT_*, ATC_ANG_*_P, INS_GYRO_FILTER); filters in Hz."""

    P: float
    I: float  # noqa: E741 -- the field's letter
    D: float
    FF: float = 0.0
    FLTT: float = 20.0
    FLTE: float = 0.0
    FLTD: float = 20.0
    IMAX: float = 0.5
    angle_P: float = 4.5  # noqa: N815 -- spelled as the parameter
    gyro_filter: float = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class LoopFlight:
    """Signals of a flight at the rate of the log, shape (N,)."""

    t: Floats
    output: Floats
    measured: Floats
    feedback: Floats
    chirp: Floats
    target: Floats
    angle: Floats
    wanted: Floats


def fly_chirp(
    axis: CraftAxis,
    gains: LoopGains,
    *,
    seed: int,
    magnitude: float = 0.05,
    band: tuple[float, float] = (0.5, 40.0),
    seconds: float = 20.0,
    gust: float = 0.3,
    noise: float = 0.01,
    log_hz: float = 100.0,
    excitation: Floats | None = None,
) -> LoopFlight:
    """Fly a chirp at the mixer as mode SYSTEMID does, from hover.

    Parameters
    ----------
    gust : float
        Standard deviation of the disturbing acceleration, rad/s^2, coloured by a pole at 1 Hz.
    noise : float
        Standard deviation of the raw gyro's noise at 2 kHz, rad/s.
    excitation : ndarray, shape (N,), optional
        Mixer input at every loop instead of the chirp.
    """
    rng = np.random.default_rng(seed)
    chirp = _chirp(magnitude, band, seconds) if excitation is None else excitation
    n = len(chirp)
    pole = math.exp(-2.0 * math.pi / GYRO_HZ)
    disturbance = lfilter([math.sqrt(1.0 - pole**2)], [1.0, -pole], rng.normal(0.0, gust, n * SUBSTEPS))
    ohm = math.tan(math.pi * gains.gyro_filter / GYRO_HZ)
    c = 1.0 + math.sqrt(2.0) * ohm + ohm * ohm
    b = ohm * ohm / c
    controller = ControllerNumbers(
        p=gains.P,
        i=gains.I,
        d=gains.D,
        ff=gains.FF,
        angle_p=gains.angle_P,
        alpha_target=_alpha(gains.FLTT),
        alpha_error=_alpha(gains.FLTE),
        alpha_derivative=_alpha(gains.FLTD),
        imax=gains.IMAX,
        limit=1.0,
        b0=b,
        b1=2.0 * b,
        b2=b,
        a1=2.0 * (ohm * ohm - 1.0) / c,
        a2=(1.0 - math.sqrt(2.0) * ohm + ohm * ohm) / c,
    )
    numbers = AxisNumbers(
        gain=axis.gain,
        damping=axis.damping,
        lag=axis.lag,
        delay_steps=axis.delay_steps,
        flex_omega=2.0 * math.pi * axis.flex_hz,
        flex_damping=axis.flex_damping,
        flex_share=axis.flex_share,
    )
    wanted = np.zeros(n)
    noises = rng.normal(0.0, noise, n * SUBSTEPS)
    output, measured, feedback, target, angle = fly_axis(
        numbers, controller, 1.0 / GYRO_HZ, SUBSTEPS, chirp, wanted, disturbance, noises
    )
    rows = slice(None, None, round(LOOP_HZ / log_hz))
    t = np.arange(n)[rows] / LOOP_HZ
    return LoopFlight(
        t, output[rows], measured[rows], feedback[rows], chirp[rows], target[rows], angle[rows], wanted[rows]
    )


def random_axis(rng: np.random.Generator) -> tuple[CraftAxis, LoopGains]:
    """Draw a craft and gains that it flies with: nano to heavy, slow and fast motors, some with a flexible mode."""
    lag = float(np.exp(rng.uniform(np.log(0.008), np.log(0.06))))
    delay = float(rng.uniform(0.0, 0.008))
    flexible = rng.random() < 0.3
    axis = CraftAxis(
        gain=float(np.exp(rng.uniform(np.log(60.0), np.log(900.0)))),
        damping=float(rng.uniform(0.0, 4.0)),
        lag=lag,
        delay=delay,
        flex_hz=float(rng.uniform(18.0, 40.0)) if flexible else 0.0,
        flex_damping=float(rng.uniform(0.03, 0.1)),
        flex_share=float(rng.uniform(-0.15, 0.15)) if flexible else 0.0,
    )
    gyro_filter = float(rng.choice([20.0, 30.0, 40.0, 60.0]))
    # A crossover that lag, delay and filter allow, by what pilots fly: from timid to bold.
    limit = 1.0 / (2.0 * math.pi * (lag + delay + 0.0025 + 0.22 / gyro_filter))
    crossover = 2.0 * math.pi * limit * float(rng.uniform(0.35, 0.8))
    p = crossover / axis.gain
    return axis, LoopGains(
        P=p, I=p * float(rng.uniform(0.5, 1.0)), D=p * float(rng.uniform(0.01, 0.03)), gyro_filter=gyro_filter
    )


def _alpha(cutoff: float) -> float:
    """Return the step of a first-order low-pass at the loop rate; 1 for none."""
    dt = 1.0 / LOOP_HZ
    return 1.0 if cutoff <= 0.0 else dt / (dt + 1.0 / (2.0 * math.pi * cutoff))


def _chirp(magnitude: float, band: tuple[float, float], seconds: float) -> Floats:
    """Return the chirp of mode SYSTEMID at every loop: two cycles at the lowest frequency, then a sweep, faded."""
    low, high = band
    hold, fade_in, fade_out = 2.0 / low, 3.0, 1.0
    total = hold + seconds
    t = np.arange(round((total + fade_out) * LOOP_HZ)) / LOOP_HZ
    frequency = low * (high / low) ** np.clip((t - hold) / seconds, 0.0, 1.0)
    phase = 2.0 * np.pi * np.cumsum(frequency) / LOOP_HZ
    window = np.where(t < fade_in, 0.5 - 0.5 * np.cos(np.pi * t / fade_in), 1.0)
    left = np.clip((t[-1] - t) / fade_out, 0.0, 1.0)
    return np.asarray(magnitude * window * (0.5 - 0.5 * np.cos(np.pi * left)) * np.sin(phase))
