"""Thrust per motor command from the accelerometer and the motor outputs of a flight.

A multirotor's accelerometer measures, along body z, thrust over mass: ``-f_z = sum_k T_k / m``. The autopilot maps
the thrust that it wants to PWM by a curve of its own (ArduPilot `AP_MotorsMulticopter`: MOT_PWM_MIN/MAX,
MOT_SPIN_MIN/MAX, MOT_THST_EXPO), and its inverse says which thrust a PWM stands for::

    c   = (pwm - pwm(spin_min)) / (pwm(spin_max) - pwm(spin_min))        command, 0 .. 1
    g   = (1 - e) c V + e (c V)^2                                        thrust command; V: voltage over reference
    T_k = k_k (rho / 1.225) g_k

so that k is the thrust of one motor at full command in sea-level air. Motion alone gives k / m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from logparse import Finding, MissingDataError, Severity, Vehicle
from sysid.covariance import autocovariance, coloured_information
from sysid.excitation import examine
from sysid.experiment import Experiment, ExperimentError, Floats, require_alike

#: Density to which coefficients refer, kg/m^3.
REFERENCE_DENSITY = 1.225

#: Averaging time, s: longer than the motor outputs' aliasing, shorter than manoeuvres.
BLOCK_SECONDS = 1.0

#: A coefficient with a larger relative standard error is not determined.
DETERMINED = 0.15

#: Relative standard uncertainty of the density when pressure or altitude is known: 10 K of 288 K, because nothing tells
#: the temperature of the air (barometers report that of the board). It is common to flights at one place and season.
AIR_SIGMA = 10.0 / 288.15

#: The same when sea-level air is assumed for want of any altitude: density lacks 18 % of sea level's at 2000 m, so that
#: the root mean square error for altitudes equally likely from 0 to 2000 m is 18 % over the root of three.
UNKNOWN_AIR_SIGMA = 0.11

#: Condition number of the motors' regressors above which differences between motors are not read.
SEPARABLE = 1e4

#: A motor that works this much more or less than the mean of all is worth a finding.
UNEVEN = 0.15

#: Vertical speed in body axes whose effect on thrust is worth a parameter, m/s.
CLIMBING = 0.2

_GRAVITY = 9.80665


@dataclass(frozen=True, slots=True)
class ThrustCoefficient:
    """Thrust of one motor at full command in sea-level air.

    Attributes
    ----------
    per_mass, sigma : float or None
        k/m and its standard error, m/s^2; None when not determined. The error includes that of the air's density
        (`ThrustModel.air_sigma`), which flights at the same place and the motors of a flight have in common.
    newton, newton_sigma : float or None
        k in N; None without a mass or when not determined.
    determined : bool
    reason : str
        Why not, empty when determined.
    """

    per_mass: float | None
    sigma: float | None
    newton: float | None
    newton_sigma: float | None
    determined: bool
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Give numbers for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True, kw_only=True)
class ThrustModel:
    """Thrust against command.

    Attributes
    ----------
    name : str
    common : ThrustCoefficient
        One coefficient for all motors.
    per_motor : mapping
        A coefficient for each motor by name.
    mass : float or None
        As given, kg.
    thrust_expo : float
        Curvature e of the thrust curve, as the autopilot has it.
    reference_density : float
        kg/m^3.
    reference_voltage : float or None
        V at which coefficients hold; None when voltage was not logged.
    damping : float or None
        Loss of thrust per mass with climbing speed along body z, 1/s; None when the flight hardly climbs.
    effort : mapping
        Mean thrust command of each motor over the mean of all motors.
    hover_command, hover_pwm : float
        Mean command and PWM that carry the weight in the air of the records.
    rmse : float
        Of one-second means of the specific force, m/s^2.
    condition : float
        Condition number of the motors' regressors, scaled.
    seconds : float
        Flight time used.
    training : tuple of str
    findings : tuple of Finding
    air_sigma : float
        Relative standard uncertainty of the air's density, common to all coefficients, included in each sigma.
    """

    name: str
    common: ThrustCoefficient
    per_motor: Mapping[str, ThrustCoefficient]
    mass: float | None
    thrust_expo: float
    reference_density: float
    reference_voltage: float | None
    damping: float | None
    effort: Mapping[str, float]
    hover_command: float
    hover_pwm: float
    rmse: float
    condition: float
    seconds: float
    training: tuple[str, ...]
    findings: tuple[Finding, ...]
    air_sigma: float = AIR_SIGMA

    def to_dict(self) -> dict[str, Any]:
        """Give the model as numbers and text for JSON."""
        plain = {
            name: getattr(self, name)
            for name in [
                "name",
                "mass",
                "thrust_expo",
                "reference_density",
                "reference_voltage",
                "damping",
                "hover_command",
                "hover_pwm",
                "rmse",
                "condition",
                "seconds",
                "air_sigma",
            ]
        }
        return {
            "kind": "thrust",
            **plain,
            "units": {"per_mass": "m/s^2 at full command", "newton": "N at full command"},
            "common": self.common.to_dict(),
            "effort": dict(self.effort),
            "per_motor": {name: value.to_dict() for name, value in self.per_motor.items()},
            "training": list(self.training),
            "findings": [
                {"id": f.id, "severity": str(f.severity), "reason": f.reason, "advice": f.advice} for f in self.findings
            ],
        }


def motor_commands(pwm: Floats, vehicle: Vehicle) -> Floats:
    """Invert the autopilot's output scaling: command c between idle and full spin, 0 to 1, not clipped.

    Parameters
    ----------
    pwm : ndarray
        us.
    vehicle : Vehicle
    """
    width = vehicle.pwm_max - vehicle.pwm_min
    idle = vehicle.pwm_min + vehicle.spin_min * width
    full = vehicle.pwm_min + vehicle.spin_max * width
    return np.asarray((pwm - idle) / (full - idle))


def fit_thrust(experiments: Sequence[Experiment], mass: float | None = None) -> ThrustModel:
    """Estimate thrust per command, common and per motor, from accelerometer and PWM.

    Parameters
    ----------
    experiments : sequence of Experiment
        With context (`f_z` at least); inputs are PWM in us.
    mass : float, optional
        kg; without it thrust is known per unit of mass only.

    Raises
    ------
    MissingDataError
        Without an accelerometer.
    ExperimentError
        When no motor moves or the records differ in kind.
    """
    records = require_alike(experiments)
    if mass is not None and not mass > 0.0:
        raise ExperimentError(f"mass must be positive, not {mass} kg")
    if any(record.context is None or not record.context["f_z"].notna().all() for record in records):
        raise MissingDataError(
            "no accelerometer in the record, so that thrust cannot be estimated; set LOG_BITMASK to include IMU"
        )
    findings = [f for f in examine(records).findings if f.id in ("constant-input", "saturated-input")]
    vehicle = records[0].vehicle
    if vehicle is None:
        vehicle = Vehicle()
        findings.append(
            Finding(
                "assumed-thrust-curve",
                Severity.WARNING,
                "the log does not tell the motors' PWM range and thrust curve; ArduPilot's defaults are assumed "
                f"({vehicle.pwm_min:.0f}-{vehicle.pwm_max:.0f} us, MOT_THST_EXPO {vehicle.thrust_expo})",
                "log parameters",
            )
        )
    voltages = np.concatenate([_column(record, "voltage") for record in records])
    reference = float(np.median(voltages)) if np.isfinite(voltages).all() else None
    findings += _unknown_air(records, reference)
    blocks = [_blocks(record, vehicle, reference) for record in records]
    usable = sum(len(block.force) for block in blocks)
    motors = records[0].input_names
    if usable < 2 * len(motors) + 4:
        raise ExperimentError(f"{usable} s of flight with all motors inside their range are too few to estimate thrust")
    climbing = float(np.sqrt(np.mean(np.concatenate([block.climb for block in blocks]) ** 2))) > CLIMBING
    nuisance = [block.climb[:, None] if climbing else np.zeros((len(block.force), 0)) for block in blocks]

    sums = [np.hstack([b.thrust.sum(axis=1, keepdims=True), x]) for b, x in zip(blocks, nuisance, strict=True)]
    together = _regress(sums, blocks)
    scatter = _scatter(sums, blocks)
    known = all(np.isfinite(_column(record, "density")).all() for record in records)
    air = AIR_SIGMA if known else float(np.hypot(UNKNOWN_AIR_SIGMA, AIR_SIGMA))
    apart = _regress([np.hstack([b.thrust, x]) for b, x in zip(blocks, nuisance, strict=True)], blocks)
    regressors = np.vstack([block.thrust for block in blocks])
    scaled = regressors / np.linalg.norm(regressors, axis=0)
    condition = float(np.linalg.cond(scaled)) ** 2
    flown = len(vehicle.motors)
    unlogged = f"only {len(motors)} of {flown} motors are logged" if len(motors) < flown else ""
    common = _coefficient(float(together.values[0]), max(float(together.sigma[0]), scatter), air, mass, unlogged)
    reason = f"the motors' commands are too alike (condition number {condition:.1e})" if condition > SEPARABLE else ""
    reason = unlogged or reason
    per_motor = {
        motor: _coefficient(float(apart.values[k]), float(apart.sigma[k]), air, mass, reason)
        for k, motor in enumerate(motors)
    }
    undetermined = [motor for motor, value in per_motor.items() if not value.determined]
    if unlogged:
        findings.append(
            Finding(
                "motors-not-logged",
                Severity.WARNING,
                f"{unlogged}; the others carry an unknown part of the weight, so that no thrust coefficient is "
                "determined",
                "log the outputs of all motors and all SERVOn_FUNCTION parameters",
                {"logged": len(motors), "motors": flown},
            )
        )
    elif undetermined:
        findings.append(
            Finding(
                "thrust-per-motor-undetermined",
                Severity.INFO,
                f"thrust of single motors is not determined for {', '.join(undetermined)}: vertical force shows only "
                f"the sum of motors that move together (condition number {condition:.1e}); the common coefficient is",
                "fly with strong roll, pitch and yaw excitation, or measure motors on a bench",
                {"undetermined": len(undetermined), "condition": condition},
            )
        )
    means = regressors.mean(axis=0)
    effort = {motor: float(part) for motor, part in zip(motors, means / means.mean(), strict=True)}
    findings += _uneven(effort)
    if mass is None:
        findings.append(
            Finding(
                "mass-unknown",
                Severity.INFO,
                "motion gives thrust per unit of mass only; the take-off mass gives newtons",
                "give the take-off mass (--mass)",
            )
        )
    expo, density = vehicle.thrust_expo, float(np.mean([block.density for block in blocks]))
    hover = _hover_command(_GRAVITY / (len(motors) * max(float(together.values[0]), 1e-9) * density), expo)
    width = vehicle.pwm_max - vehicle.pwm_min
    return ThrustModel(
        name="thrust per motor command, autopilot's thrust curve",
        common=common,
        per_motor=per_motor,
        mass=mass,
        thrust_expo=expo,
        reference_density=REFERENCE_DENSITY,
        reference_voltage=reference,
        damping=float(together.values[1]) if climbing else None,
        effort=effort,
        hover_command=hover,
        hover_pwm=vehicle.pwm_min + width * (vehicle.spin_min + hover * (vehicle.spin_max - vehicle.spin_min)),
        rmse=together.rmse,
        condition=condition,
        seconds=usable * BLOCK_SECONDS,
        training=tuple(record.name for record in records),
        findings=tuple(findings),
        air_sigma=air,
    )


@dataclass(frozen=True, slots=True)
class _Blocks:
    """One-second means: specific thrust (M,), thrust commands in sea-level air (M, motors), -climb (M,), density."""

    force: Floats
    thrust: Floats
    climb: Floats
    density: float


@dataclass(frozen=True, slots=True)
class _Regression:
    values: Floats
    sigma: Floats
    rmse: float


def _column(record: Experiment, name: str) -> Floats:
    assert record.context is not None
    return record.context[name].to_numpy(np.float64)


def _blocks(record: Experiment, vehicle: Vehicle, reference: float | None) -> _Blocks:
    command = motor_commands(record.u, vehicle)
    inside = np.all((command > 0.0) & (command < 1.0), axis=1) | (np.ptp(record.u, axis=0) == 0.0).any()
    command = np.clip(command, 0.0, 1.0)
    if reference is not None:
        command = command * (_column(record, "voltage") / reference)[:, None]
    density = _column(record, "density") / REFERENCE_DENSITY
    density = np.where(np.isfinite(density), density, 1.0)
    e = vehicle.thrust_expo
    thrust = density[:, None] * ((1.0 - e) * command + e * command**2)
    roll, pitch, yaw = (_column(record, name) for name in ("roll", "pitch", "yaw"))
    north, east, down = (_column(record, name) for name in ("v_n", "v_e", "v_d"))
    ahead = np.cos(yaw) * north + np.sin(yaw) * east
    right = np.cos(yaw) * east - np.sin(yaw) * north
    body_down = np.cos(roll) * (np.cos(pitch) * down + np.sin(pitch) * ahead) - np.sin(roll) * right
    climb = np.where(np.isfinite(body_down), body_down, 0.0)
    size = max(round(BLOCK_SECONDS / record.dt), 1)
    count = len(record.t) // size

    def mean(values: Floats) -> Floats:
        return np.asarray(values[: count * size].reshape(count, size, -1).mean(axis=1))

    keep = mean(inside.astype(np.float64))[:, 0] == 1.0
    return _Blocks(
        force=-mean(_column(record, "f_z"))[keep, 0],
        thrust=mean(thrust)[keep],
        climb=mean(climb)[keep, 0],
        density=float(density.mean()),
    )


def _regress(regressors: Sequence[Floats], blocks: Sequence[_Blocks]) -> _Regression:
    """Least squares with standard errors for coloured residuals."""
    x, y = np.vstack(regressors), np.concatenate([block.force for block in blocks])
    size = np.linalg.norm(x, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    values = np.linalg.lstsq(x / size, y, rcond=1e-12)[0] / size
    residuals = [block.force - rows @ values for block, rows in zip(blocks, regressors, strict=True)]
    freedom = max(len(y) - x.shape[1], 1)
    lags = max(min(10, min(len(r) for r in residuals) // 4), 1)
    colour = autocovariance(residuals, lags) * len(y) / freedom
    inverse = np.linalg.pinv((x / size).T @ (x / size), rcond=1e-14)
    middle = coloured_information([rows / size for rows in regressors], colour)
    sigma = np.sqrt(np.maximum(np.diag(inverse @ middle @ inverse), 0.0)) / size
    return _Regression(values, sigma, float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))))


def _scatter(regressors: Sequence[Floats], blocks: Sequence[_Blocks]) -> float:
    """Give the common coefficient's standard error from its scatter between records; 0 for a single one."""
    alone = [
        float(_regress([rows], [block]).values[0])
        for rows, block in zip(regressors, blocks, strict=True)
        if len(block.force) >= 2 * rows.shape[1] + 4
    ]
    return float(np.std(alone, ddof=1) / np.sqrt(len(alone))) if len(alone) > 1 else 0.0


def _coefficient(value: float, sigma: float, air: float, mass: float | None, reason: str) -> ThrustCoefficient:
    sigma = float(np.hypot(sigma, air * value))
    if not reason and not value > 0.0:
        reason = "the estimate is not positive"
    if not reason and sigma > DETERMINED * value:
        reason = f"the standard error is {100.0 * sigma / value:.0f} % of the estimate"
    if reason:
        return ThrustCoefficient(None, None, None, None, False, reason)
    newton = None if mass is None else (value * mass, sigma * mass)
    return ThrustCoefficient(value, sigma, newton and newton[0], newton and newton[1], True)


def _uneven(effort: Mapping[str, float]) -> list[Finding]:
    """Name the motors that work harder or less than the others, which shows even where single thrusts do not."""
    return [
        Finding(
            "uneven-motor",
            Severity.WARNING,
            f"motor {motor} works {100.0 * abs(part - 1.0):.0f} % {'harder' if part > 1.0 else 'less'} than the mean: "
            "a weak motor or propeller, an off-centre load, or motors tilted about their arms",
            "check motor, propeller and centre of gravity",
            {"motor": motor, "effort": part},
        )
        for motor, part in effort.items()
        if abs(part - 1.0) > UNEVEN
    ]


def _hover_command(thrust: float, expo: float) -> float:
    """Solve ``(1 - e) c + e c^2 = thrust`` for the command."""
    if abs(expo) < 1e-6:
        return thrust
    return float((expo - 1.0 + np.sqrt((1.0 - expo) ** 2 + 4.0 * expo * thrust)) / (2.0 * expo))


def _unknown_air(records: Sequence[Experiment], reference: float | None) -> list[Finding]:
    findings = []
    if not all(np.isfinite(_column(record, "density")).all() for record in records):
        findings.append(
            Finding(
                "density-unknown",
                Severity.WARNING,
                "with neither barometer nor altitude the density of the air is unknown; sea-level air is assumed, and "
                f"{100.0 * UNKNOWN_AIR_SIGMA:.0f} % are added to the uncertainty of thrust (at 2000 m it is 18 % off)",
                "log the barometer or GPS",
            )
        )
    if reference is None:
        findings.append(
            Finding(
                "voltage-unknown",
                Severity.WARNING,
                "without battery voltage the coefficient holds for the unknown voltage of these flights only",
                "log the battery (LOG_BITMASK, BATT_MONITOR)",
            )
        )
    return findings
