"""Regression of one-second means of specific thrust on what the motors do, with standard errors that hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core.findings import info, warning
from core.parameter import Parameter
from core.robust import robust_sigma
from logparse import Finding, MissingDataError, Vehicle
from sysid.records.excitation import examine
from sysid.records.experiment import Experiment, ExperimentError, Floats
from sysid.records.motor_scaling import motor_commands
from sysid.records.thrust_curve import Law, body_velocity, column, reference_voltage, relative_density, thrust_signals
from sysid.rotors.thrust_record import ThrustCoefficient
from sysid.statistics.covariance import autocovariance, coloured_information, wander

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

#: Thrust per mass at the same commands that changes by this part within a flight, and so many times its scatter, is
#: worth a finding; and the shortest time on either side, s. Wind leans craft and changes it by less.
CHANGED, CHANGED_SIGMAS, CHANGED_SECONDS = 0.12, 6.0, 10.0

#: What names such a flight.
THRUST_CHANGED = "thrust-changed-in-flight"


@dataclass(frozen=True, slots=True)
class Blocks:
    """One-second means: time (M,), specific thrust (M,), thrust signals in sea-level air (M, motors), -climb (M,)."""

    t: Floats
    force: Floats
    thrust: Floats
    climb: Floats
    density: float


@dataclass(frozen=True, slots=True)
class Regression:
    """Least-squares values with standard errors, and the residuals' root mean square."""

    values: Floats
    sigma: Floats
    rmse: float


def require_specific_force(records: Sequence[Experiment], mass: float | None) -> None:
    """Refuse records without an accelerometer, and masses that are none."""
    if mass is not None and not mass > 0.0:
        raise ExperimentError(f"mass must be positive, not {mass} kg")
    if any(not np.isfinite(column(record, "f_z")).all() for record in records):
        raise MissingDataError("no accelerometer in the record, so that thrust cannot be estimated; log the IMU")


def unlogged_motors(record: Experiment, vehicle: Vehicle) -> str:
    """Return how many motors of a craft are not among a record's inputs, in words; empty when all are."""
    logged, flown = len(record.input_names), len(vehicle.motors)
    return f"only {logged} of {flown} motors are logged" if logged < flown else ""


def require_all_motors(record: Experiment, vehicle: Vehicle) -> None:
    """Refuse records that lack motors."""
    if unlogged := unlogged_motors(record, vehicle):
        raise MissingDataError(
            f"{unlogged}; the others carry an unknown part of the weight: log the outputs of all motors"
        )


def blocks_of(record: Experiment, vehicle: Vehicle, voltage: float | None, law: Law = Law.COMMAND) -> Blocks:
    """Average a record over seconds in which every motor stays inside its range (or does not move at all)."""
    command = motor_commands(record.u, vehicle)
    inside = np.all((command > 0.0) & (command < 1.0), axis=1) | (np.ptp(record.u, axis=0) == 0.0).any()
    size = max(round(BLOCK_SECONDS / record.dt), 1)
    count = len(record.t) // size

    def mean(values: Floats) -> Floats:
        columns = values.reshape(len(values), -1)
        return np.asarray(columns[: count * size].reshape(count, size, columns.shape[1]).mean(axis=1))

    keep = mean(inside.astype(np.float64))[:, 0] == 1.0
    return Blocks(
        t=mean(record.t)[keep, 0],
        force=-mean(column(record, "f_z"))[keep, 0],
        thrust=mean(thrust_signals(record, law, vehicle, voltage))[keep],
        climb=mean(np.nan_to_num(body_velocity(record)[:, 2]))[keep, 0],
        density=float(relative_density(record).mean()),
    )


def unexplained_part(records: Sequence[Experiment], blocks: Sequence[Blocks]) -> float:
    """Return the part by which thrust errs on these flights, whichever method reads it off vertical motion.

    It wanders (`wandering_part`), and the air presses (`_pressed`).
    """
    return float(np.hypot(wandering_part(blocks), _pressed(records)))


def wandering_part(blocks: Sequence[Blocks]) -> float:
    """Return the part by which the mean of thrust wanders beside its commands.

    With the battery, the speed through the air and the wind, over half minutes, by several percent on real flights,
    which the scatter of a method does not show. 0 where the accelerometer's z is not known.
    """
    sums, forces = summed(blocks), [block.force for block in blocks]
    if sum(map(len, forces)) < 2 or not all(np.isfinite(force).all() for force in forces):
        return 0.0
    values = coefficients(sums, forces)
    left = np.concatenate([force - rows @ values for rows, force in zip(sums, forces, strict=True)])
    return wander(left) / max(abs(float(np.mean(np.concatenate(forces)))), 1e-9)


def summed(blocks: Sequence[Blocks]) -> list[Floats]:
    """Return the thrust signals of all motors together and, where flights climb, the climb; (M, 1 or 2) each."""
    climb = np.concatenate([block.climb for block in blocks])
    used = 2 if len(climb) and float(np.sqrt(np.mean(climb**2))) > 0.2 else 1
    return [np.column_stack([block.thrust.sum(axis=1), block.climb])[:, :used] for block in blocks]


def regress(regressors: Sequence[Floats], outputs: Sequence[Floats]) -> Regression:
    """Least squares with standard errors for coloured residuals.

    Shapes: `regressors` (N_r, q); `outputs` (N_r,).
    """
    values = coefficients(regressors, outputs)
    residuals = [force - rows @ values for force, rows in zip(outputs, regressors, strict=True)]
    sigma = np.sqrt(np.maximum(np.diag(covariance_of(regressors, residuals)), 0.0))
    return Regression(values, sigma, float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))))


def coefficients(regressors: Sequence[Floats], outputs: Sequence[Floats]) -> Floats:
    """Return the values of `regress` alone, (q,)."""
    x, size = scaled(np.vstack(regressors))
    return np.asarray(np.linalg.lstsq(x, np.concatenate(outputs), rcond=1e-12)[0] / size)


def scaled(columns: Floats) -> tuple[Floats, Floats]:
    """Columns of length 1, and their lengths; 1 of those that are zero."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    return columns / size, size


def covariance_of(regressors: Sequence[Floats], residuals: Sequence[Floats], most_lags: int = 10) -> Floats:
    """Covariance of least-squares values whose residuals are coloured, (q, q).

    Shapes: `regressors` (N_r, q); `residuals` (N_r,).
    """
    x, size = scaled(np.vstack(regressors))
    freedom = max(len(x) - x.shape[1], 1)
    lags = max(min(most_lags, min(len(r) for r in residuals) // 4), 1)
    colour = autocovariance(residuals, lags) * len(x) / freedom
    inverse = np.linalg.pinv(x.T @ x, rcond=1e-14)
    middle = coloured_information([rows / size for rows in regressors], colour)
    return np.asarray(inverse @ middle @ inverse / np.outer(size, size))


def _pressed(records: Sequence[Experiment]) -> float:
    """Part of the thrust by which the air presses along body z on craft that lean, which no method here counts.

    Drag along x and y over thrust is the tangent of the lean in steady wind; of such air that tangent comes along z,
    with a drag of its own. Climbing through still air is counted. 0 where the accelerometer's x and y are not known.
    """
    parts = []
    for record in records:
        size = max(round(BLOCK_SECONDS / record.dt), 1)
        count = len(record.t) // size
        x, y, z = (column(record, f"f_{axis}")[: count * size].reshape(count, size).mean(axis=1) for axis in "xyz")
        parts.append((x**2 + y**2) / np.maximum(z**2, 1.0))
    return float(np.nan_to_num(np.mean(np.concatenate(parts))))


def air_sigma_of(records: Sequence[Experiment]) -> float:
    """Relative standard uncertainty of the density of the air."""
    known = all(np.isfinite(column(record, "density")).all() for record in records)
    return AIR_SIGMA if known else float(np.hypot(UNKNOWN_AIR_SIGMA, AIR_SIGMA))


def coefficient(value: float, sigma: float, mass: float | None, part: float, reason: str = "") -> ThrustCoefficient:
    """Judge an estimate by its own scatter, but no better than the `part` that all methods share: or why not."""
    known = judged(value, max(sigma, part * value), reason=reason)
    if known.value is None or known.sigma is None:
        return ThrustCoefficient(None, None, None, None, False, known.reason)
    newton, newton_sigma = (None, None) if mass is None else (known.value * mass, known.sigma * mass)
    return ThrustCoefficient(known.value, known.sigma, newton, newton_sigma, True)


def judged(value: float, sigma: float, unit: str = "", hint: str = "", reason: str = "") -> Parameter:
    """Return a positive number if it is known well enough; else why not, with a hint at what the flight lacks."""
    if not reason:
        if not (np.isfinite(value) and np.isfinite(sigma)):
            reason = "not determined"
        elif not value > 0.0:
            reason = "the estimate is not positive"
        elif sigma > DETERMINED * value:
            reason = f"the standard error is {100.0 * sigma / value:.0f} % of the estimate"
        reason += f": {hint}" if reason and hint else ""
    return Parameter(None, None, unit, reason) if reason else Parameter(value, sigma, unit)


def changed_in_flight(blocks: Blocks, fitted: Floats) -> list[Finding]:
    """Name the second from which the same commands give another thrust per mass: a load dropped, or taken up.

    Shapes: `fitted` (M,).
    """
    known = (blocks.force > 0.0) & (fitted > 0.0)
    part, t, few = np.log(blocks.force[known] / fitted[known]), blocks.t[known], round(CHANGED_SECONDS / BLOCK_SECONDS)
    if len(part) < 2 * few:
        return []

    def left(k: int) -> float:
        return float(sum(np.abs(side - np.median(side)).sum() for side in (part[:k], part[k:])))

    # Each place takes as long as the flight: of a long one some are looked at, and then those about the best.
    every, last = max(len(part) // 300, 1), len(part) - few
    k = min(range(few, last + 1, every), key=left)
    k = min(range(max(k - every + 1, few), min(k + every, last + 1)), key=left)
    before, after = float(np.median(part[:k])), float(np.median(part[k:]))
    scatter = robust_sigma(np.concatenate([part[:k] - before, part[k:] - after]))
    change = float(np.expm1(after - before))
    if abs(change) < max(CHANGED, CHANGED_SIGMAS * scatter):
        return []
    return [
        warning(
            THRUST_CHANGED,
            f"from {t[k]:.0f} s on the same commands give {100.0 * abs(change):.0f} % "
            f"{'more' if change > 0.0 else 'less'} thrust per mass: a load was "
            f"{'dropped' if change > 0.0 else 'taken up'}, or motors changed; what is fitted to all is of neither part",
            "analyse the parts before and after by themselves, or fly one load",
            time=float(t[k]),
            change=change,
        )
    ]


def outputs_of(records: Sequence[Experiment], vehicle: Vehicle) -> list[Finding]:
    """Name motors whose output stands still or at a limit, and how many are not logged."""
    findings = [
        finding for finding in examine(records).findings if finding.id in ("constant-input", "motors-at-limits")
    ]
    if unlogged := unlogged_motors(records[0], vehicle):
        findings.append(
            warning(
                "not-logged",
                f"{unlogged}; the others carry an unknown part of the weight, so that neither thrust of a motor nor "
                "its effect on rotation is determined",
                "log the outputs of all motors and all SERVOn_FUNCTION parameters",
                logged=len(records[0].input_names),
                motors=len(vehicle.motors),
            )
        )
    return findings


def conditions_of(records: Sequence[Experiment]) -> tuple[Vehicle, float | None, list[Finding]]:
    """Return the craft, the voltage at which its coefficients hold, and what is not known of them and the air."""
    vehicle, assumed = vehicle_of(records[0])
    voltage = reference_voltage(records)
    return vehicle, voltage, [*assumed, *_unknown_air(records, voltage)]


def _unknown_air(records: Sequence[Experiment], voltage: float | None) -> list[Finding]:
    """Report when density or battery voltage are not known."""
    findings = []
    if not all(np.isfinite(column(record, "density")).all() for record in records):
        findings.append(
            warning(
                "conditions-assumed",
                "with neither barometer nor altitude the density of the air is unknown; sea-level air is assumed, and "
                f"{100.0 * UNKNOWN_AIR_SIGMA:.0f} % are added to the uncertainty of thrust (at 2000 m it is 18 % off)",
                "log the barometer or GPS",
            )
        )
    if voltage is None:
        findings.append(
            warning(
                "conditions-assumed",
                "without battery voltage the coefficient holds for the unknown voltage of these flights only",
                "set up the battery monitor and log it",
            )
        )
    return findings


def vehicle_of(record: Experiment) -> tuple[Vehicle, list[Finding]]:
    """Return the record's craft, or ArduPilot's defaults with a finding that says so."""
    if record.vehicle is not None:
        return record.vehicle, []
    vehicle = Vehicle()
    return vehicle, [
        warning(
            "frame-unknown",
            "the log does not tell the motors' PWM range and thrust curve; ArduPilot's defaults are assumed "
            f"({vehicle.pwm_min:.0f}-{vehicle.pwm_max:.0f} us, MOT_THST_EXPO {vehicle.thrust_expo})",
            "log parameters",
        )
    ]


def mass_unknown() -> Finding:
    """Report what is missing without a mass."""
    return info(
        "conditions-assumed",
        "motion gives forces per unit of mass only; the take-off mass gives newtons",
        "give the take-off mass (--mass)",
        what="mass",
    )
