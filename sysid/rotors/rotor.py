"""Rotor model from flight: which logged signal explains thrust, by which curve, how fast, and which motor is weak.

Thrust over mass is what the accelerometer measures along body z. Where ESCs report rotor speeds, ``T = k w^2``
(Kim 2017 eq. 13); otherwise the PWM stands for thrust by the autopilot's curve (`sysid.records.thrust_curve`). Both
are tried where both are logged, because not every ESC reports a rotor speed: ArduPilot's simulator reports a number
proportional to the command. The curvature of the thrust curve (MOT_THST_EXPO) and the motors' lag come from the same
flights when commands vary enough.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from core.parameter import Parameter
from core.quantity import number, uncertain
from core.summary import Summarised, listed
from logparse import Finding, Severity, Vehicle
from sysid.records.excitation import examine
from sysid.records.experiment import Experiment, ExperimentError, Floats, require_alike
from sysid.records.motor_scaling import motor_commands
from sysid.records.thrust_curve import Law, column, lagged, rotor_speeds, thrust_signals
from sysid.rotors.thrust_record import ThrustCoefficient
from sysid.rotors.thrust_regression import (
    SEPARABLE,
    Blocks,
    Regression,
    blocks_of,
    body_down,
    coefficients,
    condition_of,
    conditions_of,
    covariance_of,
    fit_blocks,
    mass_unknown,
    regress,
    require_all_motors,
    require_specific_force,
)

#: ESC speeds must leave this many times the command's residual, or more, to be no rotor speeds.
WORSE = 1.2

#: Commands must vary by this much (standard deviation over mean) before the ratio says anything.
VARYING = 0.03

#: Difference from the autopilot's curvature that is worth a curve of its own (and three standard errors): climb and
#: gusts bend the identified one by less.
OTHER_CURVE = 0.1

#: Rates at which the lag can be seen at all, Hz, and the longest lag looked for, s.
LAG_RATE, LONGEST_LAG = 20.0, 0.5

#: Lags with which the search begins, beside none.
_LAGS_TRIED = 8


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class RotorModel(Summarised):
    """Thrust of the rotors against what is logged of them."""

    name: str
    law: Law  #: Signal that explains thrust best: rotor speed or command.
    common: ThrustCoefficient  #: For all motors; per mass in `Law.specific_unit`.
    per_motor: Mapping[str, ThrustCoefficient]
    thrust_expo: float  #: Curvature in use: the autopilot's, unless the flights clearly show another.
    expo: Parameter  #: Curvature as identified.
    time_constant: Parameter  #: First-order lag from signal to thrust, s, with every delay of the log's in it.
    damping: (
        float | None
    )  #: Loss of thrust per mass with climbing speed along body z, 1/s; None when the flight hardly climbs.
    mass: float | None  #: kg.
    reference_voltage: float | None  #: V at which coefficients hold.
    rmse: Mapping[str, float]  #: Of one-second means of specific force by law tried, m/s^2.
    training: tuple[str, ...]
    findings: tuple[Finding, ...]

    def summary(self) -> Mapping[str, str]:
        """Return the few facts by which a reader knows this result."""
        return {
            "name": self.name,
            "thrust over mass of one motor": uncertain(self.common.per_mass, self.common.sigma),
            "thrust curve": str(self.expo),
            "motor lag": str(self.time_constant),
            "training": listed(self.training),
            "findings": listed(dict.fromkeys(finding.id for finding in self.findings)) or "none",
        }


def fit_rotor(experiments: Experiment | Sequence[Experiment], mass: float | None = None) -> RotorModel:
    """Identify the rotors from accelerometer, motor outputs, ESC speeds, voltage and density.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        Inputs are PWM in us; with context. Sampled at 20 Hz or more, the lag is looked for too.
    mass : float, optional
        kg; without it thrust is known per unit of mass only.

    Raises
    ------
    MissingDataError
        Without an accelerometer.
    ExperimentError
        When no motor moves, too little of the flight is usable, or the records differ in kind.
    """
    records = require_alike(experiments)
    require_specific_force(records, mass)
    findings = [f for f in examine(records).findings if f.id == "motors-at-limits"]
    vehicle, voltage, unknown = conditions_of(records)
    require_all_motors(records[0], vehicle)
    findings += unknown
    motors = records[0].input_names
    # Thrust by command is linear in the curvature: between a straight line and a parabola nothing is averaged anew.
    ends = [[blocks_of(record, vehicle, voltage, Law.COMMAND, expo) for record in records] for expo in (0.0, 1.0)]

    def bent(expo: float) -> list[Blocks]:
        return [
            replace(line, thrust=line.thrust + expo * (parabola.thrust - line.thrust))
            for line, parabola in zip(*ends, strict=True)
        ]

    tried = {Law.COMMAND: bent(vehicle.thrust_expo)}
    usable = sum(len(block.force) for block in tried[Law.COMMAND])
    if usable < 2 * len(motors) + 4:
        raise ExperimentError(f"{usable} s of flight with all motors inside their range are too few for a rotor model")
    if all(rotor_speeds(record) is not None for record in records):
        tried[Law.SPEED] = [blocks_of(record, vehicle, voltage, Law.SPEED) for record in records]
    rmse = {law: _fit(blocks).rmse for law, blocks in tried.items()}
    law, more = _choose(records, vehicle, rmse)
    findings += more
    thrust_expo, expo = vehicle.thrust_expo, Parameter(None, None, "1", "thrust follows rotor speed")
    if law is Law.COMMAND:
        expo = _curvature(bent, vehicle.thrust_expo)
        other = _other_curve(expo, vehicle)
        if other and expo.value is not None:
            thrust_expo = expo.value
            findings += other
    blocks = bent(thrust_expo) if law is Law.COMMAND else tried[law]
    fit = fit_blocks(blocks, motors, mass)
    lag = _lag(records, vehicle, voltage, law, thrust_expo)
    if mass is None:
        findings.append(mass_unknown())
    return RotorModel(
        name=f"rotors, thrust by {law}",
        law=law,
        common=fit.common,
        per_motor=fit.per_motor,
        thrust_expo=thrust_expo,
        expo=expo,
        time_constant=lag,
        damping=float(fit.together.values[1]) if len(fit.together.values) > 1 else None,
        mass=mass,
        reference_voltage=voltage,
        rmse={str(each): value for each, value in rmse.items()},
        training=tuple(record.name for record in records),
        findings=tuple(findings),
    )


def _rows(block: Blocks, apart: bool) -> Floats:
    thrust = block.thrust if apart else block.thrust.sum(axis=1, keepdims=True)
    return np.hstack([thrust, block.climb[:, None]])


def _fit(blocks: Sequence[Blocks], apart: bool = False) -> Regression:
    return regress([_rows(block, apart) for block in blocks], [block.force for block in blocks])


def _choose(records: Sequence[Experiment], vehicle: Vehicle, rmse: Mapping[Law, float]) -> tuple[Law, list[Finding]]:
    """Choose the law that explains thrust; report when what ESCs call a speed is none."""
    if Law.SPEED not in rmse:
        return Law.COMMAND, []
    commands = np.vstack([motor_commands(record.u, vehicle) for record in records])
    speeds = np.vstack([np.asarray(rotor_speeds(record)) for record in records])
    flying = (commands > 0.05) & (commands < 1.0) & (speeds > 0.0)
    ratio = speeds[flying] / commands[flying]
    varying = bool(np.std(commands[flying]) > VARYING * np.mean(commands[flying]))
    proportional = varying and bool(np.std(ratio) < 0.02 * np.mean(ratio))
    worse = rmse[Law.SPEED] / rmse[Law.COMMAND]
    if not proportional and worse <= WORSE:
        return Law.SPEED, []
    why = (
        "it is proportional to the motor command"
        if proportional
        else f"its square leaves {worse:.1f} times the residual of thrust that the command leaves"
    )
    return Law.COMMAND, [
        Finding(
            "not-logged",
            Severity.WARNING,
            f"what the ESCs report as speed is not taken for the rotors': {why}; thrust is modelled from PWM instead",
            "check motor pole count and ESC telemetry (a simulator's ESC reports the command)",
            {"residual_ratio": worse, "proportional": proportional},
        )
    ]


def _curvature(blocks_at: Callable[[float], list[Blocks]], start: float) -> Parameter:
    """Find the curvature by variable projection, with its standard error from the full linearisation."""
    # Unlike motors would bend a common curve: each has its own thrust where signals tell them apart.
    apart = condition_of(blocks_at(start)) < SEPARABLE

    def loss(expo: float) -> float:
        return _fit(blocks_at(expo), apart).rmse

    found = scipy.optimize.minimize_scalar(loss, bounds=(-0.5, 1.5), method="bounded", options={"xatol": 1e-4})
    expo, step = float(found.x), 1e-3
    blocks = blocks_at(expo)
    values = _fit(blocks, apart).values
    above, below = blocks_at(expo + step), blocks_at(expo - step)
    regressors, residuals = [], []
    for block, up, down in zip(blocks, above, below, strict=True):
        rows = _rows(block, apart)
        slope = (_rows(up, apart) - _rows(down, apart)) @ values / (2.0 * step)
        regressors.append(np.hstack([rows, slope[:, None]]))
        residuals.append(block.force - rows @ values)
    sigma = float(np.sqrt(max(covariance_of(regressors, residuals)[-1, -1], 0.0)))
    if not np.isfinite(sigma) or sigma > 0.15 or not -0.45 < expo < 1.45:
        told = f"the standard error is {sigma:.2f}" if np.isfinite(sigma) and sigma < 10.0 else "thrust hardly varies"
        return Parameter(None, None, "1", f"{told}, so that the autopilot's curve ({start:g}) is used")
    return Parameter(expo, sigma, "1")


def _other_curve(found: Parameter, vehicle: Vehicle) -> list[Finding]:
    """Report when thrust clearly follows another curve than the one that the autopilot inverts."""
    if found.value is None or found.sigma is None:
        return []
    expo, sigma = found.value, found.sigma
    off, told = expo - vehicle.thrust_expo, f"{vehicle.thrust_expo:g}"
    if abs(off) < max(3.0 * sigma, OTHER_CURVE):
        return []
    return [
        Finding(
            "thrust-differs",
            Severity.INFO,
            f"thrust follows a curve of MOT_THST_EXPO {expo:.2f} ± {sigma:.2f}; the autopilot inverts {told}, "
            "so that its loops are stiffer at one end of the throttle than at the other",
            "measure the curve on a thrust stand, and set MOT_THST_EXPO",
            {"expo": expo, "sigma": sigma, "set": vehicle.thrust_expo},
        )
    ]


def _lag(records: Sequence[Experiment], vehicle: Vehicle, voltage: float | None, law: Law, expo: float) -> Parameter:
    """Find the first-order lag from signal to specific force."""
    if records[0].rate < LAG_RATE:
        return Parameter(
            None, None, "s", f"records at {records[0].rate:.3g} Hz do not show it; {LAG_RATE:g} Hz or more would"
        )
    signals = [thrust_signals(r, law, vehicle, voltage, expo).sum(axis=1, keepdims=True) for r in records]
    forces = [-column(record, "f_z") for record in records]
    climbs = [body_down(record)[:, None] for record in records]
    dt = records[0].dt

    def rows_at(tau: float) -> list[Floats]:
        return [np.hstack([lagged(s, tau, dt), c]) for s, c in zip(signals, climbs, strict=True)]

    def left_over(tau: float) -> float:
        rows = rows_at(tau)
        values = coefficients(rows, forces)
        return sum(float(np.sum((f - r @ values) ** 2)) for f, r in zip(forces, rows, strict=True))

    # A flight may have two lags that are each better than those about it: the best of a few is gone on from.
    tried = np.concatenate([[1e-4], np.geomspace(0.01, LONGEST_LAG, _LAGS_TRIED)])
    best = int(np.argmin([left_over(each) for each in tried]))
    around = tried[max(best - 1, 0)], tried[min(best + 1, _LAGS_TRIED)]
    tau = float(scipy.optimize.minimize_scalar(left_over, bounds=around, method="bounded", options={"xatol": 1e-5}).x)
    rows = rows_at(tau)
    values, step = coefficients(rows, forces), max(1e-3, 0.01 * tau)
    above, below = rows_at(tau + step), rows_at(max(tau - step, 0.0))
    width = tau + step - max(tau - step, 0.0)
    full = [np.hstack([r, (a - b) @ values[:, None] / width]) for r, a, b in zip(rows, above, below, strict=True)]
    left = [f - r @ values for f, r in zip(forces, rows, strict=True)]
    sigma = float(np.sqrt(max(covariance_of(full, left, round(1.0 / dt))[2, 2], 0.0)))
    if not np.isfinite(sigma) or sigma > 0.5 * tau or tau > 0.98 * LONGEST_LAG:
        most = f"below {number(tau + 2.0 * sigma, 2)} s" if np.isfinite(sigma) and sigma < LONGEST_LAG else "unknown"
        return Parameter(None, None, "s", f"the flights do not show it ({most})")
    return Parameter(tau, sigma, "s")
