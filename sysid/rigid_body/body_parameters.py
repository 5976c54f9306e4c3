"""What flights determine of a rigid body's parameters: each with its standard error, or why it is not determined."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from logparse import Finding, Severity, Vehicle
from sysid.records.experiment import Experiment, Floats
from sysid.records.motor_signals import ENOUGH, MOTOR_OUTPUTS
from sysid.records.thrust_curve import REFERENCE_DENSITY
from sysid.rigid_body.body_motion import SHARED, THETA, BodyMotion
from sysid.rigid_body.filter_error import FilterErrorFit, Prior
from sysid.rigid_body.model import ROTATION_UNITS, TRANSLATION_UNITS
from sysid.rigid_body.model_record import BodyParameter
from sysid.rigid_body.rotation import (
    COHERENT,
    LAG_SIGMA,
    STILL,
    UNDAMPED,
    AxisFit,
    RotationFit,
    centre_of_gravity,
)
from sysid.rigid_body.systematic import EXPO, usual_speed
from sysid.rotors.thrust_regression import air_sigma_of

#: Largest standard error of what is called determined: a part of the estimate; absolute where zero is a proper value.
RELATIVE = {"thrust": 0.15, "roll_gain": 0.2, "pitch_gain": 0.2, "yaw_gain": 0.2}
ABSOLUTE = {
    "thrust_expo": 0.05,
    "climb_loss": 0.02,
    "tilt_x": 0.004,
    "tilt_y": 0.004,
    "motor_lag": 0.015,
    "roll_damping": 1.0,
    "pitch_damping": 1.0,
    "yaw_damping": 1.0,
    "yaw_lead": 0.01,
    "torque_lag": 0.01,
    "torque_delay": 0.01,
    "cg_x": 0.03,
    "cg_y": 0.03,
}
_DRAG_RELATIVE = 0.25

#: Part of a gain by which one lag and straight lines between samples misrepresent motors, filters and staircases of
#: commands; the scatter of stretches, which all share it, does not show it. Torque about yaw goes with thrust only
#: nearly: on ArduPilot's simulator, where it goes with command times thrust, gains come out 3 % off.
GAIN_FLOOR = {"roll": 0.01, "pitch": 0.01, "yaw": 0.03}

#: The same for damping, 1/s: a millisecond of lag that is not of first order damps a swing of 3 Hz by 0.3 1/s; yaw
#: swings more slowly.
DAMPING_FLOOR = {"roll": 0.3, "pitch": 0.3, "yaw": 0.15}

#: What to fly so that a parameter can be had.
ADVICE = {
    "thrust": "fly longer, or in one place so that gusts do not hide thrust",
    "thrust_expo": "climb and descend with vigour, or fly with different loads or at different altitudes",
    "drag_linear": "fly back and forth at several speeds along this axis",
    "drag_quadratic": "fly back and forth at several speeds, the highest included, along this axis",
    "climb_loss": "climb fast and descend fast",
    "tilt": "turn in the wind, so that wind and a leaning thrust can be told apart",
    "motor_lag": "log motor outputs faster, and move the throttle briskly",
}


def judge_parameters(
    fine: FilterErrorFit,
    prior: Prior,
    records: Sequence[Experiment],
    vehicle: Vehicle,
    voltage: float | None,
    turning: RotationFit | None,
) -> tuple[dict[str, BodyParameter], Floats, tuple[str, ...]]:
    """Judge every parameter; return them with the covariance, and the names, of those that were estimated."""
    result: dict[str, BodyParameter] = {}
    # Thrust that begins at another command than MOT_SPIN_MIN says bends the curve just as another MOT_THST_EXPO, and no
    # flight tells which of the two is wrong: at full command either may be true, and the error covers half the way.
    known = fine.covariance[:SHARED, :SHARED] + np.outer(fine.halfway, fine.halfway)
    sigma = np.sqrt(np.maximum(np.diag(known), 0.0))
    unlogged = len(records[0].input_names) < len(vehicle.motors)
    # Thrust and drag go with the density of the air.
    in_air = shared_air(records) * np.array([name == "thrust" or name.startswith("drag") for name in THETA])
    beyond = np.hypot(np.sqrt(fine.transfer), in_air * fine.values[:SHARED])
    for k, name in enumerate(THETA):
        value, reason = float(fine.values[k]), ""
        if name == "thrust" and unlogged:
            reason = f"only {len(records[0].input_names)} of {len(vehicle.motors)} motors are logged"
        else:
            reason = _doubt(name, value, float(np.hypot(sigma[k], beyond[k])))
            if name == "thrust_expo":
                reason = _contradiction(fine, vehicle) or reason
            if not reason and name not in ("motor_lag", "climb_loss") and value in (prior.low[k], prior.high[k]):
                reason = f"the estimate ran into its limit of {value:g}"
        result[name] = BodyParameter.of(name, TRANSLATION_UNITS[name], value, float(sigma[k]), reason, float(beyond[k]))
    size = len(THETA) + len(ROTATION_UNITS)
    covariance = np.zeros((size, size))
    covariance[:SHARED, :SHARED] = known
    if turning is not None:
        numbers = _rotational(turning, records, vehicle, voltage, fine)
    else:
        why = "the log does not tell which motor sits where" if not vehicle.motors else "the flight is too short"
        numbers = dict.fromkeys(ROTATION_UNITS, _Stated(0.0, np.inf, "not all motors are logged" if unlogged else why))
    for k, (name, unit) in enumerate(ROTATION_UNITS.items(), start=SHARED):
        value, spread, reason, other = numbers[name]
        doubt = reason or _doubt(name, value, float(np.hypot(spread, other)))
        result[name] = BodyParameter.of(name, unit, value, spread, doubt, other)
        covariance[k, k] = spread**2 if np.isfinite(spread) else 0.0
        if turning is not None and name.endswith("_gain"):
            # A steeper curve at the command flown makes a gain smaller by as much.
            with_curve = value * turning.per_expo * fine.covariance[EXPO, :SHARED]
            covariance[k, :SHARED] = covariance[:SHARED, k] = with_curve
    if turning is not None:
        result["motor_lag"] = held_against_torque(result["motor_lag"], turning)
    return result, covariance, (*THETA, *ROTATION_UNITS)


class _Stated(NamedTuple):
    value: float
    sigma: float
    reason: str = ""  #: Why it is not determined, whatever its standard error.
    transfer: float = 0.0


def _rotational(
    turning: RotationFit, records: Sequence[Experiment], vehicle: Vehicle, voltage: float | None, fine: FilterErrorFit
) -> dict[str, _Stated]:
    """Name what turns the craft, with all that makes it err."""
    expo, expo_sigma = float(fine.values[EXPO]), float(np.sqrt(max(fine.covariance[EXPO, EXPO], 0.0)))
    air, stated = shared_air(records), dict[str, _Stated]()
    for axis, fit in turning.axes.items():
        error = gain_error(axis, fit, turning.rate, turning.per_expo * expo_sigma)
        reason = rotation_doubt(axis, fit, turning.source) or _doubt(f"{axis}_gain", fit.gain, error)
        stated[f"{axis}_gain"] = _Stated(fit.gain, error, reason, air * abs(fit.gain))
        stated[f"{axis}_damping"] = _Stated(fit.damping, _damping_sigma(axis, fit), reason)
    # Both are found together for roll and pitch; what is not coherent blurs them.
    swung = max(turning.axes[axis].coherent for axis in ("roll", "pitch"))
    reason = "" if swung >= COHERENT else "neither roll nor pitch has a determined gain"
    stated["torque_lag"] = _Stated(turning.lag, turning.lag_sigma, reason)
    stated["torque_delay"] = _Stated(turning.delay, turning.lag_sigma, reason)
    yaw = turning.axes["yaw"]
    stated["yaw_lead"] = _Stated(yaw.lead, yaw.lead_sigma, stated["yaw_gain"].reason)
    constant = constant_motors(records)
    why = f"the output of {', '.join(constant)} is constant: its thrust, which the offset rests on, is not known"
    places = centre_of_gravity(records, vehicle, voltage, expo, expo_sigma)
    for name, (value, spread) in zip(("cg_x", "cg_y"), places, strict=True):
        stated[name] = _Stated(value, spread, why if constant else "")
    return stated


def _contradiction(fine: FilterErrorFit, vehicle: Vehicle) -> str:
    """Explain how the curvature contradicts the parameters, if beyond use."""
    value, own, halfway = fine.values[EXPO], float(np.sqrt(max(fine.covariance[EXPO, EXPO], 0.0))), fine.halfway[EXPO]
    if not halfway or not _doubt("thrust_expo", value, float(np.hypot(own, halfway))):
        return ""
    return (
        f"between the ends of the commands thrust rises as with {value:.2f} ± {own:.2f} instead of "
        f"{vehicle.thrust_expo:.2f}: MOT_THST_EXPO or MOT_SPIN_MIN is not as set, and no flight tells which"
    )


def other_curve(fine: FilterErrorFit, vehicle: Vehicle) -> list[Finding]:
    """Report when thrust clearly follows another curve than the parameters say."""
    reason = _contradiction(fine, vehicle)
    if not reason:
        return []
    return [
        Finding(
            "thrust-differs",
            Severity.WARNING,
            f"{reason}; thrust and gains of the rigid body go by the flight, what other methods say of full "
            "command does not",
            "measure the curve and where thrust begins on a thrust stand, and set MOT_THST_EXPO and MOT_SPIN_MIN",
            {"expo": float(fine.values[EXPO]), "set": vehicle.thrust_expo},
        )
    ]


def thrust_over(
    name: str,
    parameters: Mapping[str, BodyParameter],
    covariance: Floats,
    estimated: Sequence[str],
) -> float:
    """Compute the relative standard error of thrust over a gain, which share the curve; infinite where unknown."""
    if name not in ("roll_gain", "pitch_gain"):
        return float("inf")
    thrust, gain = parameters["thrust"], parameters[name]
    if thrust.value is None or gain.value is None or thrust.sigma is None or gain.sigma is None:
        return float("inf")
    one, other = thrust.sigma / thrust.value, gain.sigma / gain.value
    shared = float(covariance[list(estimated).index("thrust"), list(estimated).index(name)])
    return float(np.sqrt(max(one**2 + other**2 - 2.0 * shared / (thrust.value * gain.value), 0.0)))


def held_against_torque(lag: BodyParameter, turning: RotationFit) -> BodyParameter:
    """Doubt a lag of thrust beyond that of the same motors' torque, in which gyro filters are besides."""
    most = max(turning.lag + turning.delay, 0.0)
    if lag.value is None or lag.sigma is None or lag.value - most < 2.0 * float(np.hypot(lag.sigma, LAG_SIGMA)):
        return lag
    reason = (
        f"thrust would follow its command by {lag.value:.2g} s, the same motors' torque follows within {most:.2g} s: "
        "gusts or slow rows feign it; log motor outputs faster"
    )
    return lag.refused(reason)


def shared_air(records: Sequence[Experiment]) -> float:
    """Relative standard error that the density of the air makes in thrust and gains alike: it averages over flights."""
    return float(air_sigma_of(records) / np.sqrt(len(records)))


def constant_motors(records: Sequence[Experiment]) -> list[str]:
    """Motors whose output stands still in any of the flights."""
    still = [np.ptp(record.u, axis=0) == 0.0 for record in records]
    return [name for j, name in enumerate(records[0].input_names) if any(part[j] for part in still)]


def _damping_sigma(axis: str, fit: AxisFit) -> float:
    return float(np.hypot(fit.damping_sigma, DAMPING_FLOOR[axis]))


def gain_error(axis: str, fit: AxisFit, rate: float, bent: float) -> float:
    """Return the standard error of a gain from so many rows a second, a part `bent` by the thrust curve."""
    # Noise in the command makes the gain too small by up to what is not coherent. Slow rows fold the answer of roll and
    # pitch to noise into the band, and the noise with it: what goes together biases by the root of its part.
    left = max(1.0 - fit.coherent, 0.0)
    noisy = left if axis == "yaw" or rate >= ENOUGH else float(np.sqrt(left))
    return float(np.linalg.norm([fit.gain_sigma, *(part * fit.gain for part in (noisy, GAIN_FLOOR[axis], bent))]))


def rotation_doubt(axis: str, fit: AxisFit, source: str) -> str:
    """Explain why the effectiveness about an axis is not believed; empty when it is."""
    if fit.coherent < COHERENT:
        return _incoherent(axis, fit.coherent, fit.moved, source)
    if fit.damping < -UNDAMPED * _damping_sigma(axis, fit):
        return (
            f"{axis} would be driven by its own rate ({fit.damping:.3g} 1/s): with {fit.moved:.2g} rad/s the answer "
            "of the controller to noise is seen, not the craft's to the controller; fly sticks or SYSTEMID on it"
        )
    return ""


def _incoherent(axis: str, coherent: float, moved: float, source: str) -> str:
    text = f"the {source} explain only {100.0 * max(coherent, 0.0):.0f} % of the angular acceleration in {axis}"
    log = "log RATE and " if source == MOTOR_OUTPUTS else ""
    if moved < STILL:
        return f"{text}: the axis was hardly moved ({moved:.2g} rad/s); {log}fly sticks or SYSTEMID on it"
    why = "outputs and rates do not belong together"
    if source == MOTOR_OUTPUTS:
        why = "outputs are logged too slowly, or do not reach the motors"
    advice = f"{log}check the motors' order, their outputs and the logs' times"
    return f"{text}, although the axis moved ({moved:.2g} rad/s): {why}; {advice}"


def _doubt(name: str, value: float, sigma: float) -> str:
    """Why a parameter is not determined; empty when it is."""
    group = name.rsplit("_", 1)[0] if name.startswith(("drag", "tilt")) else name
    advice = f"; {ADVICE[group]}" if group in ADVICE else ""
    if not np.isfinite(sigma):
        return f"the flight does not tell it{advice}"
    if name in ABSOLUTE:
        limit = ABSOLUTE[name]
        return "" if sigma <= limit else f"the standard error of {sigma:.2g} exceeds {limit:g}{advice}"
    limit = RELATIVE.get(name, _DRAG_RELATIVE)
    if value > 0.0 and sigma <= limit * value:
        return ""
    if value < 1e-6 or sigma > value:
        return f"the estimate does not differ from zero (standard error {sigma:.2g}){advice}"
    return f"the standard error is {100.0 * sigma / value:.0f} % of the estimate{advice}"


def in_si(
    parameter: BodyParameter, all_of_them: Mapping[str, BodyParameter], mass: float | None, over_thrust: float
) -> BodyParameter:
    """Add what the mass turns a parameter into."""
    name, value, sigma = parameter.name, parameter.value, parameter.sigma
    if mass is None or value is None or sigma is None:
        return parameter
    factor, unit = 0.0, ""
    if name == "thrust":
        factor, unit = mass, "N at full command"
    elif name.startswith("drag_linear"):
        factor, unit = mass, "N s/m"
    elif name.startswith("drag_quadratic"):
        factor, unit = 2.0 * mass / REFERENCE_DENSITY, "m^2 (drag coefficient times area)"
    elif name == "climb_loss":
        factor, unit = mass, "N s^2/m^2"
    if unit:
        return replace(parameter, si_value=factor * value, si_sigma=factor * sigma, si_unit=unit)
    thrust = all_of_them["thrust"]
    if name in ("roll_gain", "pitch_gain") and thrust.value is not None and thrust.sigma is not None:
        over_arm = mass * thrust.value / value
        return replace(parameter, si_value=over_arm, si_sigma=over_arm * over_thrust, si_unit="kg m (inertia over arm)")
    return parameter


def undetermined(parameters: Mapping[str, BodyParameter]) -> list[Finding]:
    """Return a finding that names what is not determined, if anything."""
    missing = [p for p in parameters.values() if not p.determined]
    if not missing:
        return []
    return [
        Finding(
            "not-determined",
            Severity.INFO,
            "not determined: " + "; ".join(f"{p.name} ({p.reason})" for p in missing),
            "",
            {"parameters": ", ".join(p.name for p in missing)},
        )
    ]


def drag_apart(
    parameters: Mapping[str, BodyParameter], motions: Sequence[BodyMotion], fine: FilterErrorFit, covariance: Floats
) -> list[Finding]:
    """Return the whole drag at the speed flown where its linear and quadratic parts cannot be told apart.

    Shapes: `covariance` (p, p).
    """
    findings = []
    for place, axis in enumerate("xyz"):
        names = (f"drag_linear_{axis}", f"drag_quadratic_{axis}")
        if all(parameters[name].determined for name in names):
            continue
        speed = usual_speed(motions, place)
        weights = np.zeros(len(covariance))
        weights[[THETA.index(name) for name in names]] = speed, speed**2
        drag = float(weights[:SHARED] @ fine.values[:SHARED])
        sigma = float(np.sqrt(max(float(weights @ covariance @ weights), 0.0)))
        if speed > 0.5 and sigma < _DRAG_RELATIVE * drag:
            findings.append(
                Finding(
                    "not-determined",
                    Severity.INFO,
                    f"linear and quadratic drag along {axis} cannot be told apart, but together they slow the craft "
                    f"by {drag:.3g} +- {sigma:.1g} m/s^2 at {speed:.1f} m/s",
                    ADVICE["drag_quadratic"],
                    {"axis": axis, "speed": speed, "drag": drag, "sigma": sigma},
                )
            )
    return findings
