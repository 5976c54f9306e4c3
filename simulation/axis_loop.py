"""Axes with known frequency responses (motor lag, delay, filters, a flexible mode) in ArduCopter's controllers.

Not a flight: each axis of the craft for itself, shaken by chirps, sticks and gusts, and the log that ArduPilot would
have written of it. Its truth is a formula (`AxisPlant.response`), which firmware's never is.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.signal import lfilter

from logparse.craft.frames import motor_table
from logparse.dataflash.writer import MessageTable, write_dataflash
from simulation._kernels import fly_axis
from simulation._parameters import AxisParameters, AxisSignals
from simulation.flight_log import message
from sysid.loops.controller import AXES, AngleController, GyroPath, LoopSettings, RateController

Floats = NDArray[np.float64]

#: Rate of the controllers, Hz, and steps of the physics in one of theirs.
LOOP_HZ = 400.0
_SUBSTEPS = 12
#: Rate of the physics and of the gyro's filter, Hz.
GYRO_HZ = LOOP_HZ * _SUBSTEPS

#: Corner of disturbances, Hz.
GUST_HZ = 1.0

#: Where the chirp of a SID_AXIS is added; others are added to the rate target.
_POINTS = {
    **dict.fromkeys(range(10, 14), "mixer"),
    **dict.fromkeys((14, 15), "position"),
    **dict.fromkeys(range(16, 20), "velocity"),
}
#: Fields of `LoopGains` that are parameters of the rate controller.
TERMS = ("P", "I", "D", "FF", "FLTT", "FLTE", "FLTD", "IMAX")

_SYSTEMID, _STABILIZE = 25, 0
_LETTERS = {"roll": "R", "pitch": "P", "yaw": "Y", "vertical": "A"}
#: Time since boot at the start of the runs, s.
_BOOT = 10.0
#: Mean thrust of the craft in parts of full.
HOVER = 0.35
#: Parameters with which a motor's thrust is linear in its PWM.
LINEAR: Mapping[str, float] = {
    "MOT_PWM_MIN": 1000.0,
    "MOT_PWM_MAX": 2000.0,
    "MOT_SPIN_MIN": 0.1,
    "MOT_SPIN_MAX": 1.0,
    "MOT_SPIN_ARM": 0.05,
    "MOT_THST_EXPO": 0.0,
    "FRAME_CLASS": 1.0,
    "FRAME_TYPE": 1.0,
    **{f"SERVO{k}_FUNCTION": 32.0 + k for k in range(1, 5)},
}


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
class Shaking:
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
    gust: float = 0.0  #: Standard deviation of disturbing accelerations, rad/s^2 (or m/s^2), below `GUST_HZ`.
    noise: float = 0.0  #: Standard deviation of the sensor's noise after its filter, rad/s (or m/s^2).
    gyro_noise: float = 0.0  #: The same before the filter, at every step of the physics.


@dataclass(frozen=True, slots=True, eq=False)
class AxisRun:
    """Signals of one axis at the loop's rate, shape (N,); see `fly_axis`."""

    excitation: Shaking
    chirp: Floats
    chirp_hz: Floats
    elapsed: Floats
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


def run_axis(plant: AxisPlant, gains: LoopGains, excitation: Shaking, seed: int) -> AxisRun:
    """Fly one axis of known response; every number comes from the seed."""
    rng = np.random.default_rng(seed)
    n = round(excitation.duration * LOOP_HZ)
    t = np.arange(n) / LOOP_HZ
    chirp, frequency, elapsed = _chirp(t, excitation)
    stick = _sticks(rng, n, excitation.stick, smooth=plant.integrates)
    added_to = _POINTS.get(excitation.sid_axis, "rate")
    added = {point: chirp if point == added_to else np.zeros(n) for point in ("rate", "mixer", "position", "velocity")}
    pole = np.exp(-2.0 * np.pi * GUST_HZ / GYRO_HZ)
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
    numbers = AxisParameters(**dataclasses.asdict(plant), **dataclasses.asdict(gains))
    flown = fly_axis(numbers, signals, 1.0 / LOOP_HZ)
    return AxisRun(excitation, chirp, frequency, elapsed, t, *flown)


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


def settings_of(plant: AxisPlant, gains: LoopGains, axis: str = "roll") -> LoopSettings:
    """Return the loop's settings as a log of the flight has them."""
    return LoopSettings(
        axis=axis,
        controller=RateController(**{name: getattr(gains, name) for name in TERMS}),
        angle=AngleController(P=gains.angle_P, late=1.0 / LOOP_HZ),
        gyro=GyroPath(plant.filter_hz, GYRO_HZ),
    )


def gains_of(settings: LoopSettings) -> LoopGains:
    """Return the gains with which a craft flies settings, as tuned."""
    return LoopGains(**{name: getattr(settings.controller, name) for name in TERMS}, angle_P=settings.angle.P)


def true_loop(plant: AxisPlant, gains: LoopGains, hz: Floats) -> NDArray[np.complex128]:
    """Return the response at frequencies [Hz] of the loop broken at the mixer, shape (n,)."""
    return plant.response(hz) * settings_of(plant, gains).feedback(hz)


def _chirp(t: Floats, excitation: Shaking) -> tuple[Floats, Floats, Floats]:
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


def write_rate_log(
    path: Path,
    axes: Mapping[str, AxisRun],
    *,
    rate: float = 400.0,
    filter_hz: float = 20.0,
    parameters: Mapping[str, float] | None = None,
    motors: Mapping[str, float] | None = None,
    gains: Mapping[str, LoopGains] | None = None,
) -> None:
    """Write RATE, SIDD, SIDS, ATT, MODE and PARM of axes that were run over the same time."""
    gains = gains or {}
    runs = _Runs(axes)
    flown = {"INS_GYRO_FILTER": filter_hz, "FRAME_CLASS": 1.0, "FRAME_TYPE": 1.0} | _loop_parameters(gains)
    flown |= (dict(LINEAR) if motors is not None else {}) | dict(parameters or {})
    tables = [
        message("MSG", [1.0], {"Message": ["ArduCopter V4.7.0-dev"]}),
        message("PARM", np.ones(len(flown)), {"Name": list(flown), "Value": list(map(float, flown.values()))}),
        _modes(axes),
        *(_motors(runs, **motors) if motors is not None else [_rates(runs, rate)]),
        _attitude(runs),
        *_chirps(runs, rate),
        *(_pid(runs, axis, one, rate) for axis, one in gains.items()),
    ]
    if gains:
        # Height and vibration of a craft that rises by 5 m after a twentieth of its time and stays.
        t = runs.t(10.0)
        tables.append(message("BARO", t, {"Alt": np.clip(t - _BOOT - 0.05 * (runs.seconds), 0.0, 5.0)}))
        tables.append(message("VIBE", t, dict.fromkeys(("VibeX", "VibeY", "VibeZ"), 2.0)))
    write_dataflash(path, tables)


class _Runs:
    """Signals of axes that were run over the same time, at any rate; axes that are missing stand still."""

    def __init__(self, axes: Mapping[str, AxisRun]):
        self.axes = axes
        self._t = next(iter(axes.values())).t
        self.seconds = float(self._t[-1])

    def t(self, rate: float) -> Floats:
        """Return the times of rows on the boot clock."""
        return self._t[_rows(rate)] + _BOOT

    def __call__(self, axis: str, signal: str, rate: float = LOOP_HZ) -> Floats:
        run = self.axes.get(axis)
        values: Floats = np.zeros(len(self._t)) if run is None else getattr(run, signal)
        return values[_rows(rate)]


def _rows(rate: float) -> slice:
    return slice(None, None, max(round(LOOP_HZ / rate), 1))


def _loop_parameters(gains: Mapping[str, LoopGains]) -> dict[str, float]:
    values = {"SCHED_LOOP_RATE": LOOP_HZ} if gains else {}
    for axis, one in gains.items():
        values |= {f"ATC_RAT_{AXES[axis]}_{name}": float(getattr(one, name)) for name in TERMS}
        values[f"ATC_ANG_{AXES[axis]}_P"] = one.angle_P
    return values


def _rates(runs: _Runs, rate: float) -> MessageTable:
    columns = {}
    for axis, letter in _LETTERS.items():
        scale, trim = (1.0, HOVER) if axis == "vertical" else (np.degrees(1.0), 0.0)
        columns[f"{letter}Des"] = scale * runs(axis, "asked", rate)
        columns[letter] = scale * runs(axis, "measured", rate)
        columns[f"{letter}Out"] = runs(axis, "output", rate) + (trim if axis in runs.axes else 0.0)
    return message("RATE", runs.t(rate), columns)


def _pid(runs: _Runs, axis: str, gains: LoopGains, rate: float) -> MessageTable:
    signals = ("feedback", "target", "measured", "integral", "derivative")
    feedback, target, measured, integral, derivative = (runs(axis, signal, rate) for signal in signals)
    forward = gains.FF * target
    columns = {"Tar": target, "Act": measured, "P": feedback - integral - derivative - forward}
    columns |= {"I": integral, "D": derivative, "FF": forward, "Flags": np.zeros(len(target))}
    return message(f"PID{_LETTERS[axis]}", runs.t(rate), columns)


def _modes(axes: Mapping[str, AxisRun]) -> MessageTable:
    rows = [(_BOOT, _STABILIZE)]
    for run in axes.values():
        if run.excitation.chirp[2]:
            start = _BOOT + run.excitation.chirp_start
            rows += [(start, _SYSTEMID), (start + run.excitation.chirp_seconds, _STABILIZE)]
    rows.sort()
    modes = [mode for _, mode in rows]
    return message("MODE", [t for t, _ in rows], {"Mode": modes, "ModeNum": modes, "Rsn": 1})


def _attitude(runs: _Runs) -> MessageTable:
    columns = {}
    for axis in ("roll", "pitch", "yaw"):
        columns[f"Des{axis.title()}"] = np.degrees(runs(axis, "stick", 100.0))
        columns[axis.title()] = np.degrees(runs(axis, "attitude", 100.0))
    return message("ATT", runs.t(100.0), columns)


def _chirps(runs: _Runs, rate: float) -> list[MessageTable]:
    chirped = [run for run in runs.axes.values() if run.excitation.chirp[2]]
    if not chirped:
        return []
    chirped.sort(key=lambda run: run.excitation.chirp_start)
    gyro = {f"G{letter}": np.degrees(runs(axis, "unfiltered")) for letter, axis in zip("xyz", AXES, strict=True)}
    parts = []
    for run in chirped:
        scale = 1.0 if run.excitation.sid_axis >= 10 else np.degrees(1.0)
        columns = {"t": run.t + _BOOT + 2e-4, "Time": run.elapsed, "Targ": scale * run.chirp, "F": run.chirp_hz}
        part = pd.DataFrame(columns | gyro | dict.fromkeys(("Ax", "Ay", "Az"), 0.0))
        parts.append(part[_rows(rate)].dropna(subset="Time"))
    data = pd.concat(parts)
    shaken = [run.excitation for run in chirped]
    settings = {
        "Ax": [one.sid_axis for one in shaken],
        "Mag": [one.chirp[2] for one in shaken],
        "FSt": [one.chirp[0] for one in shaken],
        "FSp": [one.chirp[1] for one in shaken],
        "TFin": 1.0,
        "TC": [2.0 / one.chirp[0] for one in shaken],
        "TR": [one.chirp_seconds for one in shaken],
        "TFout": 1.0,
    }
    values = {name: data[name].to_numpy() for name in data.columns if name != "t"}
    return [
        message("SIDS", [_BOOT + one.chirp_start for one in shaken], settings),
        message("SIDD", data["t"], values),
    ]


def _motors(runs: _Runs, rcou: float = 0.0, imu: float = 0.0) -> list[MessageTable]:
    """Return what a quadcopter's motors got and its gyros felt, at rates [Hz] of which 0 leaves a message out."""
    motors = motor_table("quad", "x")
    asked = [
        HOVER
        + runs("vertical", "output")
        + motor.roll * runs("roll", "output")
        + motor.pitch * runs("pitch", "output")
        + motor.yaw * runs("yaw", "output")
        for motor in motors
    ]
    thrust = np.column_stack(asked)
    gyro = np.column_stack([runs(axis, "measured") for axis in AXES])
    tables = []
    if rcou:
        pwm = np.rint(1100.0 + 900.0 * np.clip(thrust[_rows(rcou)], 0.0, 1.0)).astype(np.uint16)
        tables.append(message("RCOU", runs.t(rcou), {f"C{k}": pwm[:, k - 1] for k in range(1, 5)}))
    if imu:
        columns = {f"Gyr{letter}": gyro[_rows(imu), k] for k, letter in enumerate("XYZ")}
        columns |= {"AccX": np.zeros(len(runs.t(imu))), "AccY": np.zeros(len(runs.t(imu)))}
        tables.append(message("IMU", runs.t(imu), columns | {"AccZ": -9.81 - runs("vertical", "measured", imu)}))
    if "vertical" in runs.axes:
        # The pilot's throttle and that of the controller.
        stick = np.rint(1500.0 + 50.0 * runs("vertical", "stick", 10.0)).astype(np.uint16)
        tables.append(message("CTUN", runs.t(10.0), {"ThO": HOVER + runs("vertical", "output", 10.0)}))
        tables.append(message("RCIN", runs.t(10.0), {"C3": stick}))
    return tables
