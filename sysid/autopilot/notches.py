"""The gyro's harmonic notch from raw batches: what it should follow, what noise reaches the motors with it and without.

ArduPilot's notch (HarmonicNotchFilter) follows throttle as FREQ sqrt(throttle / REF), not below FM_RAT of it, or, from
FREQ on, the rotors' speeds that the ESCs report. Noise at the motors is the gyro's spectrum through notch, low-pass and
the rate controller: in each batch with the notch where it stood at that batch's throttle.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from core.parameter import Parameter
from core.quantity import number
from logparse import FlightLog
from sysid.autopilot.motor_lines import Batch, LineError, MotorLines, gyro_batches, motor_lines
from sysid.autopilot.values import AutopilotValue, ParameterFile, decided, refused
from sysid.loops.controller import AXES, GyroPath, RateController
from sysid.loops.evidence import LOWEST
from sysid.loops.filters import DigitalFilter, cascade
from sysid.loops.loop import RateLoop
from sysid.loops.parameter_file import typed
from sysid.loops.safety import Aim
from sysid.loops.settings import NOTCHES, Follows, notch_at, notch_frequency, read_settings

_PREFIX = "INS_HNTCH_"
NAMES = tuple(_PREFIX + name for name in ("ENABLE", "MODE", "REF", "FREQ", "BW", "ATT", "HMNCS", "FM_RAT"))
FILTERS = ("FLTD", "FLTT")

#: Attenuation, dB, that ArduPilot advises, and between which parts of the frequency the notch's least one lies.
_ATTENUATION, _LEAST_PART = 40.0, (0.5, 0.7)

#: Bandwidths over frequency, the last ArduPilot's advice: the narrowest whose noise is at most so many times the last's
#: over all throttles flown costs least phase.
_BANDWIDTHS, _AS_QUIET = (0.25, 1.0 / 3.0, 0.5), 1.1

#: Part of the frequency within which a notch that flew is right, and ESCs report the speed of the line.
_SAME = 0.02

#: Lowest frequency of what notches are for, Hz.
_VIBRATION = 30.0

#: Factor between noise foretold and measured at the mixer beyond which the filters are not those of the parameters.
_APART = 2.0

#: Part of the gain margin, dB, that another notch leaves at the least: where it was kept by the one that flew, less is.
_HALVED = 0.5

#: Factor of the filters that stay of which it is said what they would do.
_WIDER = 1.5

#: Frequencies at which phase is told where no loop is identified, Hz.
_PHASE_AT = (10.0, 20.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MotorNoise:
    """Noise in hover with one set of filters."""

    gyro: float  #: rad/s rms above 30 Hz behind the filters, as a batch would log it.
    mixer: Mapping[str, float]  #: rms of the controllers' outputs by axis.


@dataclass(frozen=True, slots=True, eq=False)
class NotchStudy:
    """Lines of the motors, and noise as flown and as proposed."""

    lines: MotorLines
    now: MotorNoise
    then: MotorNoise
    values: Mapping[str, float]  #: The notch proposed, by parameter.


def notch_values(
    log: FlightLog, study: NotchStudy, loops: Mapping[str, RateLoop], flown: Mapping[str, float]
) -> list[AutopilotValue]:
    """Return the notch that a flight's batches ask for, with what it does to noise and loops, and filters that stay."""
    lines, values = study.lines, study.values
    follows = f"motors' line in hover; goes with throttle to the {lines.exponent:.2f} ± {lines.exponent_sigma:.2f}"
    rms = {
        name: " ".join(f"{axis} {number(x, 2)}" for axis, x in noise.mixer.items() if axis != "yaw")
        for name, noise in (("now", study.now), ("then", study.then))
    }
    filters = _filters(log, study, loops, flown)
    if _flies_already(flown, values):
        why = f"what flew is right: {follows}, {lines.hz:.1f} ± {lines.sigma:.1f} Hz; noise at the mixer {rms['now']}"
        return [*refused(NAMES, ParameterFile.MOTOR_NOTCH, flown, why, right=True), *filters]
    hidden = _hidden(study, loops)
    if hidden is not None:
        return [*refused(NAMES, ParameterFile.MOTOR_NOTCH, flown, hidden), *filters]
    costs = _costs(study, loops)
    by_esc = values[_PREFIX + "MODE"] == Follows.ESC
    reasons = {
        "ENABLE": f"noise at the mixer in hover {rms['now']} as flown, {rms['then']} with it; it costs {costs}",
        "MODE": "rotor speeds as the ESCs report them" if by_esc else "throttle",
        "REF": "as ESC telemetry wants it" if by_esc else "throttle of hover",
        "FREQ": f"lowest that it follows the ESCs to; {lines.hz:.1f} Hz is the {follows}" if by_esc else follows,
        "BW": "a wider one would be hardly quieter at the throttles flown, and cost more phase",
        "ATT": "as ArduPilot advises",
        "HMNCS": "lines stand out at " + ", ".join(f"{k * lines.hz:.0f} Hz" for k in lines.harmonics),
        "FM_RAT": "down to FREQ" if by_esc else "down to the throttle of descents",
    }
    sigmas = {"FREQ": lines.sigma * values[_PREFIX + "FREQ"] / lines.hz, "BW": lines.sigma}
    parameters = {
        _PREFIX + name: Parameter(values[_PREFIX + name], sigmas.get(name), "Hz" if name in sigmas else "", why)
        for name, why in reasons.items()
    }
    return [*decided(parameters, ParameterFile.MOTOR_NOTCH, flown), *filters]


def _filters(
    log: FlightLog, study: NotchStudy, loops: Mapping[str, RateLoop], flown: Mapping[str, float]
) -> list[AutopilotValue]:
    """Return what wider low-pass filters would do: they stay, because a mode of the frame would be raised as well."""
    parameters = {**log.parameters_flown, **study.values}
    names = [("INS_GYRO_FILTER",), *(tuple(f"ATC_RAT_{axis}_{name}" for axis in ("RLL", "PIT")) for name in FILTERS)]
    result = []
    for group in names:
        now = [parameters.get(name, 0.0) for name in group]
        if not min(now) > 0.0:
            continue
        wider = parameters | {name: _WIDER * value for name, value in zip(group, now, strict=True)}
        noise = max(motor_noise(log, study.lines, wider, loops).mixer[axis] for axis in ("roll", "pitch"))
        why = (
            f"at {_WIDER * now[0]:.0f} Hz noise at the mixer would be {number(noise, 2)}, with the notch "
            f"{number(max(study.then.mixer['roll'], study.then.mixer['pitch']), 2)} as it is; that no mode of the "
            "frame rises with it only chirps show: rotorid tune"
        )
        file = ParameterFile.MOTOR_NOTCH if len(group) == 1 else ParameterFile.PID_FILTERS
        result += refused(group, file, flown, why)
    return result


def notch_study(log: FlightLog, loops: Mapping[str, RateLoop] | None = None) -> NotchStudy:
    """Find the motors' lines of a flight and compute its noise with the notch as flown and as proposed.

    LineError as `gyro_batches` and `motor_lines`, and where the filters that flew are not those of the parameters.
    """
    before, after, quantum = gyro_batches(log)
    lines = motor_lines(log, before, quantum)
    values = _proposed(log, lines)
    parameters = log.parameters_flown
    now, then = (motor_noise(log, lines, settings, loops) for settings in (parameters, {**parameters, **values}))
    measured = mixer_rms(log, lines.batches)
    comparisons = [(f"{axis} output", rms, now.mixer[axis]) for axis, rms in measured.items() if axis != "yaw"]
    behind = [batch for batch in after if batch.steady and abs(batch.throttle / lines.hover - 1.0) < _SAME]
    if behind:
        comparisons.append(("gyro behind the filters", gyro_rms(behind), now.gyro))
    for what, seen, foretold in comparisons:
        if not 1.0 / _APART < seen / foretold < _APART:
            raise LineError(
                f"{log.name}: the {what} has {number(seen, 2)} of noise, and {number(foretold, 2)} by the filters in "
                "the parameters: they did not fly, or the batches are of another gyro"
            )
    return NotchStudy(lines, now, then, values)


def _proposed(log: FlightLog, lines: MotorLines) -> dict[str, float]:
    """Return the notch for the lines of a flight."""
    flight, throttle = log.flight, log.tables.column("setpoints", "throttle")
    assert flight is not None
    assert throttle is not None  # the batches are of a flight with its throttle
    least = float(np.percentile(throttle.loc[flight.start : flight.stop].dropna(), 1.0))
    esc = _reported(log, lines)
    part = float(np.clip(np.sqrt(max(least, 0.0) / lines.hover), *_LEAST_PART))
    frequency = typed(part * lines.hz) if esc else typed(lines.hz)  # that of ESCs is the lowest that is followed
    values = {
        _PREFIX + "ENABLE": 1.0,
        _PREFIX + "MODE": float(Follows.ESC if esc else Follows.THROTTLE),
        _PREFIX + "REF": 1.0 if esc else typed(lines.hover),
        _PREFIX + "FREQ": frequency,
        _PREFIX + "BW": 0.0,
        _PREFIX + "ATT": _ATTENUATION,
        _PREFIX + "HMNCS": float(sum(1 << (k - 1) for k in lines.harmonics)),
        _PREFIX + "FM_RAT": 1.0 if esc else round(part, 2),
    }
    choices = [values | {_PREFIX + "BW": typed(width * frequency)} for width in _BANDWIDTHS]
    everywhere = replace(lines, batches=lines.steady)
    noise = [motor_noise(log, everywhere, {**log.parameters_flown, **choice}).mixer["roll"] for choice in choices]
    return next(choice for choice, loud in zip(choices, noise, strict=True) if loud <= _AS_QUIET * noise[-1])


def _reported(log: FlightLog, lines: MotorLines) -> bool:
    """Return whether ESC telemetry reports the speed that the line has."""
    if log.tables.esc is None:
        return False
    speeds = log.tables.esc.filter(regex=r"^w\d+$")
    during = [speeds.loc[batch.start : batch.stop].to_numpy(np.float64) for batch in lines.batches]
    values = np.concatenate([part[np.isfinite(part) & (part > 1.0)] for part in during]) / (2.0 * np.pi)
    return len(values) > 0 and abs(float(np.median(values)) / lines.hz - 1.0) < _SAME


def _flies_already(flown: Mapping[str, float], values: Mapping[str, float]) -> bool:
    """Return whether the notch as flown has the lines."""

    def get(name: str) -> float:
        return flown.get(_PREFIX + name, 0.0)

    wanted = {name: values[_PREFIX + name] for name in ("REF", "FREQ", "HMNCS")}
    lines = int(get("HMNCS")) & int(wanted["HMNCS"]) == int(wanted["HMNCS"])
    if get("MODE") > Follows.THROTTLE:  # follows the rotors themselves, from FREQ on
        there = 0.0 < get("FREQ") < (1.0 + _SAME) * wanted["FREQ"]
    else:
        there = abs(get("FREQ") / wanted["FREQ"] - 1.0) < _SAME and abs(get("REF") / wanted["REF"] - 1.0) < 2.0 * _SAME
        there = there and get("MODE") == values[_PREFIX + "MODE"]
    return get("ENABLE") == 1.0 and there and lines


def _path(parameters: Mapping[str, float], batch: Batch, lines: MotorLines) -> GyroPath:
    """Return the gyro's filters as they stood in a batch."""
    notches: list[DigitalFilter] = []
    for prefix in NOTCHES:
        values = {f"{prefix}{name}": 0.0 for name in ("BW", "ATT", "HMNCS", "REF", "MODE")} | dict(parameters)
        if values.get(f"{prefix}ENABLE", 0.0) <= 0.0 or not values.get(f"{prefix}FREQ", 0.0) > 0.0:
            continue
        turning = lines.hz * (batch.throttle / lines.hover) ** lines.exponent
        base = notch_frequency(values, prefix, batch.throttle, turning)
        notches += notch_at(values, prefix, batch.rate, base)
    return GyroPath(parameters["INS_GYRO_FILTER"], batch.rate, tuple(notches))


def _behind(loop: RateLoop, path: GyroPath) -> RateLoop:
    """Return a loop behind other filters of the gyro."""
    return loop.with_settings(replace(loop.flown, gyro=path))


def motor_noise(
    log: FlightLog, lines: MotorLines, parameters: Mapping[str, float], loops: Mapping[str, RateLoop] | None = None
) -> MotorNoise:
    """Send the batches of hover through filters and controllers, and around the loops where they are identified.

    A notch's lag raises the loop's peak, and with it what the gyro hears below the lines.
    """
    controllers = {axis: _controller(log, axis, parameters) for axis in AXES}
    gyro, mixer = [], []
    for batch in lines.batches:
        heard = batch.hz >= LOWEST
        hz, step = batch.hz[heard], batch.step
        through = _path(parameters, batch, lines).response(hz)
        # Rounding to the batch's quantum is white, and none of it passes the filters.
        power = np.maximum(batch.power[:, heard] - lines.quantum**2 / 6.0 / batch.rate, 0.0) * np.abs(through) ** 2
        for axis, loop in (loops or {}).items():
            flown, new = (_behind(loop, _path(values, batch, lines)) for values in (log.parameters_flown, parameters))
            rise = np.abs((1.0 + flown.response) / (1.0 + new.response))
            power[list(AXES).index(axis)] *= np.interp(hz, loop.hz, rise, left=1.0, right=1.0) ** 2
        high = hz >= _VIBRATION
        gyro.append(power[:, high].sum(axis=1).mean() * step + lines.quantum**2 / 12.0)
        gains = [np.abs(controller.error_response(hz)) ** 2 for controller in controllers.values()]
        mixer.append([float(axis @ gain) * step for axis, gain in zip(power, gains, strict=True)])
    by_axis = dict(zip(AXES, np.sqrt(np.mean(mixer, axis=0)).tolist(), strict=True))
    return MotorNoise(gyro=float(np.sqrt(np.mean(gyro))), mixer=by_axis)


def _controller(log: FlightLog, axis: str, parameters: Mapping[str, float]) -> RateController:
    """Return an axis' rate controller with filters of the parameters."""
    settings = read_settings(log, axis)
    own = {name: parameters.get(f"ATC_RAT_{AXES[axis]}_{name}", 0.0) for name in FILTERS}
    return settings.changed(**own).controller


def gyro_rms(batches: Sequence[Batch]) -> float:
    """Return the rms of the gyro above 30 Hz in batches, rad/s."""
    squares = [batch.power[:, batch.hz >= _VIBRATION].sum(axis=1).mean() * batch.step for batch in batches]
    return float(np.sqrt(np.mean(squares)))


def mixer_rms(log: FlightLog, batches: Sequence[Batch]) -> dict[str, float]:
    """Return the rms of the controllers' outputs during the batches, each about its mean; empty without RATE."""
    measured = {}
    for axis, column in (("roll", "out_roll"), ("pitch", "out_pitch"), ("yaw", "out_yaw")):
        output = log.tables.column("rates", column)
        if output is None:
            return {}
        parts = [output.loc[batch.start : batch.stop].to_numpy(np.float64) for batch in batches]
        squares = [np.var(part) for part in parts if len(part) > 20 and np.isfinite(part).all()]
        if squares:
            measured[axis] = float(np.sqrt(np.mean(squares)))
    return measured


def _margins_with(study: NotchStudy, loop: RateLoop) -> dict[str, float]:
    """Return the margins of a loop behind the notch that is proposed."""
    return _behind(loop, _proposed_path(study, loop.flown.gyro.low_pass)).best_margins


def _proposed_path(study: NotchStudy, low_pass: float = 0.0) -> GyroPath:
    """Return the gyro's filters with the notch that is proposed, as it stands in a batch of hover."""
    batch = study.lines.batches[len(study.lines.batches) // 2]
    return _path({**study.values, "INS_GYRO_FILTER": low_pass}, batch, study.lines)


def _hidden(study: NotchStudy, loops: Mapping[str, RateLoop]) -> str | None:
    """Report that a loop would be unstable with the proposed notch: the filters flown may hide a mode of the frame."""
    for axis, loop in loops.items():
        left, flown = _margins_with(study, loop), loop.margins
        if flown.gain_db.value is None or not flown.stable:
            continue
        if not left["stable"] or left["gain_db"] < _HALVED * flown.gain_db.value:
            margin = f"{left['gain_db']:.1f} dB of gain margin" if left["stable"] else "unstable"
            return (
                f"behind this notch {axis} would be left {margin} ({flown.gain_db.value:.1f} dB as flown): a mode of "
                "the frame that the notch that flew hides, or too little margin for another lag; tune first, or give a "
                "mode a notch of its own (INS_HNTC2_)"
            )
    return None


def _costs(study: NotchStudy, loops: Mapping[str, RateLoop]) -> str:
    """Return what the notch costs in phase, and the margin it leaves where the loop is identified."""
    costs, notches = [], _proposed_path(study).notches
    for axis, loop in loops.items():
        margins = loop.margins
        if margins.crossover_hz.value is None:
            continue
        left = _margins_with(study, loop)
        kept = {name: left[name] for name in ("phase_deg", "gain_db")}
        lost = -np.degrees(np.angle(cascade(notches, np.array([margins.crossover_hz.value]))[0]))
        costs.append(
            f"{lost:.0f} deg at {axis}'s crossover of {margins.crossover_hz.value:.1f} Hz, leaving "
            f"{left['phase_deg']:.0f} deg and {left['gain_db']:.1f} dB of "
            f"{margins.phase_deg.value or np.nan:.0f} deg and {margins.gain_db.value or np.nan:.1f} dB"
            + (", which is thin: tune with it" if Aim().lacking(kept) else "")
        )
    if costs:
        return "; ".join(costs)
    lags = -np.degrees(np.angle(cascade(notches, np.array(_PHASE_AT))))
    return " and ".join(f"{lag:.0f} deg at {hz:.0f} Hz" for lag, hz in zip(lags, _PHASE_AT, strict=True))
