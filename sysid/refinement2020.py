"""Parameters from instants of flight after Refinement 2020 (Silesian University of Technology, Series Transport).

At each instant the equations of motion are linear in the parameters. Translation, with the accelerometer's specific
force f and T = k s for each rotor (`sysid.thrust_curve`), FRD::

    f_x = -(C/m) |v_x| v_x      f_y = -(C/m) |v_y| v_y      f_z = -(k/m) sum_i s_i - (C/m) |v_z| v_z

gives (k/m, C/m); then rotation, divided by the arm l, with x_i, y_i the motors' unit arms and c_i = -1 for clockwise::

    (Jx/l) (p' - q r) + (Jz/l) q r = -k sum_i y_i s_i             (Jx = Jy, as the paper takes them)
    (Jx/l) (q' + p r) - (Jz/l) p r =  k sum_i x_i s_i
    (Jz/l)  r'                     =  (b/l) sum_i c_i s_i

gives (Jx/l, Jz/l, b/l), all over m. The paper solves these small systems instant by instant, drops degenerate ones and
takes the mean. That mean is what `Refinement2020Model.instants` holds. It is biased where the regressors are noisy:
differentiated rates multiply the unknown inertia, and noise there makes it come out too small; the median is quoted
beside it. `stacked` holds what should be used: all instants at once, angular acceleration as the dependent variable,
Huber weights against outliers, standard errors for coloured residuals. The paper takes motors to be identical and the
centre of gravity to be in their middle; where they are not, thrust and the other moments turn the craft too, so that
the stacked regression has them beside each axis's own moment.

The translational equations are homogeneous in (m, C, k): motion gives k/m and C/m only, and inertia and torque over m
likewise. Jz and b enter the third equation as their ratio; Jz by itself shows only in products of rates. Air at rest is
assumed, as in the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from logparse import Finding, MissingDataError, Severity
from sysid.experiment import Experiment, ExperimentError, Floats, require_alike
from sysid.motor_geometry import MotorGeometry, motor_geometry
from sysid.motor_signals import motor_signals, too_slow, unexplained
from sysid.thrust_curve import Law, column, lagged, reference_voltage, rotor_speeds
from sysid.thrust_regression import (
    DETERMINED,
    air_sigma_of,
    covariance_of,
    mass_unknown,
    require_specific_force,
    unknown_air,
    vehicle_of,
)

#: Condition number of an instant's system, columns scaled to their usual size over the flight, above which it is
#: degenerate.
DEGENERATE = 10.0

#: Fewest instants that make a mean; the paper asks for three with different control inputs.
FEWEST = 3

#: Huber's constant: 95 % efficiency for normal residuals.
HUBER = 1.345

#: How far residuals are taken to be correlated, s. Differences of noisy rates have hardly any power where the craft
#: moves, which a short (tapered) autocovariance does not resolve.
CORRELATED = 2.0

#: Longest lag of motors looked for, s.
LONGEST_LAG = 0.2

#: Names, in order.
PARAMETERS = ("k", "C", "Jx", "Jy", "Jz", "b", "b/Jz")


@dataclass(frozen=True, slots=True)
class InstantMean:
    """A parameter as the paper finds it.

    Attributes
    ----------
    mean, spread, median : float or None
        Over the instants kept; None when too few are left.
    used, dropped : int
        Instants.
    reason : str
    """

    mean: float | None
    spread: float | None
    median: float | None
    used: int
    dropped: int
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Give numbers for JSON."""
        return {name: getattr(self, name) for name in self.__slots__}


@dataclass(frozen=True, slots=True)
class StackedEstimate:
    """A parameter from all instants at once.

    Attributes
    ----------
    value, sigma : float or None
        None when not determined.
    interval : tuple of 2 float, or None
        95 % confidence interval.
    reason : str
    """

    value: float | None
    sigma: float | None
    interval: tuple[float, float] | None
    reason: str = ""

    def to_dict(self) -> dict[str, Any]:
        """Give numbers for JSON."""
        return {
            "value": self.value,
            "sigma": self.sigma,
            "interval": None if self.interval is None else list(self.interval),
            "reason": self.reason,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class Refinement2020Model:
    """Both ways side by side; every number per unit of mass, and J and b over the arm besides.

    Attributes
    ----------
    name : str
    law : Law
    instants : mapping of str to InstantMean
        By the names of `PARAMETERS`: ``k`` k/m, ``C`` C/m [1/m], ``Jx`` and ``Jz`` J/(m l) [m], ``b`` b/(m l),
        ``b/Jz``.
    stacked : mapping of str to StackedEstimate
        The same, with ``Jy`` by itself.
    mass : float or None
        As given, kg.
    reference_voltage : float or None
    time_constant : float
        Lag of the motors in use, s.
    training : tuple of str
    findings : tuple of Finding
    """

    name: str
    law: Law
    instants: Mapping[str, InstantMean]
    stacked: Mapping[str, StackedEstimate]
    mass: float | None
    reference_voltage: float | None
    time_constant: float
    training: tuple[str, ...]
    findings: tuple[Finding, ...]

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter."""
        per = "" if self.law is Law.COMMAND else " per (rad/s)^2"
        thrust = self.law.specific_unit
        torque = "m/s^2 at full command" if self.law is Law.COMMAND else "N s^2/kg"
        return {
            "k": thrust,
            "C": "1/m",
            **dict.fromkeys(("Jx", "Jy", "Jz"), "m"),
            "b": torque,
            "b/Jz": "rad/s^2" + (per or " at full command"),
        }

    def to_dict(self) -> dict[str, Any]:
        """Give the model as numbers and text for JSON."""
        return {
            "kind": "refinement2020",
            "name": self.name,
            "law": str(self.law),
            "units": self.units,
            "instants": {name: value.to_dict() for name, value in self.instants.items()},
            "stacked": {name: value.to_dict() for name, value in self.stacked.items()},
            "mass": self.mass,
            "reference_voltage": self.reference_voltage,
            "time_constant": self.time_constant,
            "training": list(self.training),
            "findings": [
                {"id": f.id, "severity": str(f.severity), "reason": f.reason, "advice": f.advice} for f in self.findings
            ],
        }


def fit_refinement2020(
    experiments: Sequence[Experiment],
    mass: float | None = None,
    *,
    time_constant: float | None = 0.0,
    law: Law | None = None,
) -> Refinement2020Model:
    """Refine the parameters from instants of flight, both as the paper does and stacked.

    Parameters
    ----------
    experiments : sequence of Experiment
        PWM inputs, with context; 50 Hz or more for rotation (slower records alias it).
    mass : float, optional
        kg; not used for the estimates, which are per unit of mass.
    time_constant : float or None
        Lag of the motors behind the signal, s; 0 as in the paper, whose signals are rotor speeds. None finds the one
        with which roll and pitch moments explain the angular acceleration best (gyro filters included).
    law : Law, optional
        By default rotor speeds where every record has them.

    Raises
    ------
    MissingDataError
        Without accelerometer, rates, velocity or the frame's geometry.
    ExperimentError
        When the records differ in kind.
    """
    records = require_alike(experiments)
    require_specific_force(records, mass)
    vehicle, findings = vehicle_of(records[0])
    voltage = reference_voltage(records)
    findings += unknown_air(records, voltage)
    geometry = motor_geometry(records[0])
    if law is None:
        law = Law.SPEED if all(rotor_speeds(record) is not None for record in records) else Law.COMMAND
    signals = [motor_signals(record, law, vehicle, voltage, vehicle.thrust_expo) for record in records]
    rotation = all(each.fast for each in signals)

    def motion_at(lag: float) -> list[_Motion]:
        return [
            _Motion.of(record, geometry, lagged(each.signals, lag, record.dt), each.rates)
            for record, each in zip(records, signals, strict=True)
        ]

    if time_constant is None:
        time_constant = _best_lag(motion_at) if rotation else 0.0
    motion = motion_at(time_constant)
    air = air_sigma_of(records)
    stacked = _stacked(motion, air)
    instants = _instants(motion)
    if not rotation:
        findings.append(too_slow("Refinement 2020", signals[0].source))
        why = "motor signals are logged too slowly for rotation"
        stacked |= {name: StackedEstimate(None, None, None, why) for name in PARAMETERS[2:]}
        instants |= {name: InstantMean(None, None, None, 0, 0, why) for name in PARAMETERS[2:]}
    if mass is None:
        findings.append(mass_unknown())
    findings += _remarks(stacked)
    return Refinement2020Model(
        name=f"Refinement 2020, thrust by {law}",
        law=law,
        instants=instants,
        stacked=stacked,
        mass=mass,
        reference_voltage=voltage,
        time_constant=time_constant,
        training=tuple(record.name for record in records),
        findings=tuple(findings),
    )


@dataclass(frozen=True, slots=True)
class _Motion:
    """What the equations read, averaged over the span of each finite difference: all (M,), or (M, 3).

    `force` specific force, `speed` body velocity, `rates`, `acceleration` angular, `lift` sum of s; `roll`, `pitch`,
    `yaw` sums of s times unit levers (for a positive moment).
    """

    force: Floats
    speed: Floats
    rates: Floats
    acceleration: Floats
    lift: Floats
    roll: Floats
    pitch: Floats
    yaw: Floats
    dt: float

    @classmethod
    def of(cls, record: Experiment, geometry: MotorGeometry, signals: Floats, rates: Floats) -> _Motion:
        force = np.column_stack([column(record, f"f_{axis}") for axis in "xyz"])
        roll, pitch, yaw = (column(record, name) for name in ("roll", "pitch", "yaw"))
        north, east, down = (column(record, name) for name in ("v_n", "v_e", "v_d"))
        for label, values in {"angular rates": rates, "velocity": north, "attitude": roll}.items():
            if not np.isfinite(values).all():
                raise MissingDataError(
                    f"{record.name}: {label} not known, which Refinement 2020 needs; log IMU and GPS"
                )
        if len(record.t) < 2 * FEWEST + 2:
            raise ExperimentError(f"{record.name}: {len(record.t)} samples are too few")
        ahead = np.cos(yaw) * north + np.sin(yaw) * east
        right = np.cos(yaw) * east - np.sin(yaw) * north
        sunk = np.cos(pitch) * down + np.sin(pitch) * ahead
        speed = np.column_stack(
            [
                np.cos(pitch) * ahead - np.sin(pitch) * down,
                np.cos(roll) * right + np.sin(roll) * sunk,
                np.cos(roll) * sunk - np.sin(roll) * right,
            ]
        )
        return cls(
            force=_span(force),
            speed=_span(speed),
            rates=_span(rates),
            acceleration=(rates[2:] - rates[:-2]) / (2.0 * record.dt),
            lift=_span(signals.sum(axis=1)),
            roll=_span(-(signals @ geometry.right)),
            pitch=_span(signals @ geometry.forward),
            yaw=_span(-(signals @ geometry.spin)),
            dt=record.dt,
        )


def _span(values: Floats) -> Floats:
    """Mean over the two steps of a central difference (Simpson), so that both sides of an equation see the same."""
    return np.asarray((values[:-2] + 4.0 * values[1:-1] + values[2:]) / 6.0)


def _products(motion: _Motion) -> tuple[Floats, Floats, Floats]:
    p, q, r = motion.rates.T
    return q * r, p * r, p * q


def _instants(motion: Sequence[_Motion]) -> dict[str, InstantMean]:
    """Solve the paper's systems (22) and (24) at every instant."""
    force = np.concatenate([m.force for m in motion])
    speed = np.concatenate([m.speed for m in motion])
    lift = np.concatenate([m.lift for m in motion])
    drag = -np.abs(speed) * speed
    thrust = np.column_stack([np.zeros_like(lift), np.zeros_like(lift), -lift])
    first, kept = _solve_each(np.stack([thrust, drag], axis=2), force)
    result = {
        name: _mean(first[:, k], kept, "the craft hardly moves through the air" if name == "C" else "it hardly lifts")
        for k, name in enumerate(("k", "C"))
    }
    # Thrust is known at every instant with the speed at rest too: only drag needs motion.
    lifting = lift > 0.1 * np.median(lift)
    alone = np.where(lifting, -force[:, 2] / np.where(lifting, lift, 1.0), np.nan)
    if result["k"].mean is None:
        result["k"] = _mean(alone, lifting, "it hardly lifts")
    k = result["k"].mean
    if k is None:
        return result | {name: _mean(alone, np.zeros(len(alone), bool), "thrust is not") for name in ("Jx", "Jz", "b")}
    accel = np.concatenate([m.acceleration for m in motion])
    qr, pr, _ = (np.concatenate(parts) for parts in zip(*[_products(m) for m in motion], strict=True))
    roll, pitch, yaw = (np.concatenate([getattr(m, name) for m in motion]) for name in ("roll", "pitch", "yaw"))
    zero = np.zeros_like(qr)
    jx = np.column_stack([accel[:, 0] - qr, accel[:, 1] + pr, zero])
    jz = np.column_stack([qr, -pr, accel[:, 2]])
    b = np.column_stack([zero, zero, -yaw])
    aim = np.column_stack([k * roll, k * pitch, zero])
    second, kept = _solve_each(np.stack([jx, jz, b], axis=2), aim)
    why = "the craft hardly turns about two axes at once"
    result |= {name: _mean(second[:, j], kept, why) for j, name in enumerate(("Jx", "Jz", "b"))}
    moving = np.abs(yaw) > np.median(np.abs(yaw))
    ratio = np.where(moving, accel[:, 2] / np.where(moving, yaw, 1.0), np.nan)
    result["b/Jz"] = _mean(ratio, moving, "the craft hardly yaws")
    return result


def _solve_each(matrices: Floats, aims: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Least squares at each instant: (M, 3, q) and (M, 3) to (M, q), and which instants are not degenerate."""
    usual = np.sqrt(np.mean(matrices**2, axis=(0, 1)))
    if not (usual > 0.0).all():
        return np.full((len(aims), matrices.shape[2]), np.nan), np.zeros(len(aims), dtype=bool)
    scaled = matrices / usual
    singular = np.linalg.svd(scaled, compute_uv=False)
    kept = (singular[:, 0] < DEGENERATE * singular[:, -1]) & (singular[:, -1] > 1.0 / DEGENERATE)
    solved = np.full((len(aims), matrices.shape[2]), np.nan)
    inverse = np.linalg.pinv(scaled[kept])
    solved[kept] = np.einsum("mij,mj->mi", inverse, aims[kept]) / usual
    return solved, kept


def _mean(values: Floats, kept: NDArray[np.bool_], reason: str) -> InstantMean:
    used = values[kept]
    if len(used) < FEWEST:
        return InstantMean(
            None, None, None, len(used), len(values) - len(used), f"every instant is degenerate: {reason}"
        )
    return InstantMean(
        float(used.mean()), float(used.std(ddof=1)), float(np.median(used)), len(used), len(values) - len(used)
    )


def _stacked(motion: Sequence[_Motion], air: float) -> dict[str, StackedEstimate]:
    lags = max(round(CORRELATED / motion[0].dt), 2)
    translation = [
        np.vstack(
            [
                np.column_stack([-m.lift, -np.abs(m.speed[:, 2]) * m.speed[:, 2]]),
                np.column_stack([np.zeros_like(m.lift), -np.abs(m.speed[:, 0]) * m.speed[:, 0]]),
                np.column_stack([np.zeros_like(m.lift), -np.abs(m.speed[:, 1]) * m.speed[:, 1]]),
            ]
        )
        for m in motion
    ]
    forces = [np.concatenate([m.force[:, 2], m.force[:, 0], m.force[:, 1]]) for m in motion]
    values, covariance, _ = _robust(translation, forces, lags)
    k, k_sigma = float(values[0]), float(np.sqrt(covariance[0, 0]))
    drag, drag_sigma = float(values[1]), float(np.sqrt(covariance[1, 1]))
    result = {
        "k": _judge(k, float(np.hypot(k_sigma, air * k)), "thrust hardly varies"),
        "C": _judge(drag, float(np.hypot(drag_sigma, air * drag)), "the craft is too slow for drag"),
    }
    gains = []
    patterns = ("roll", "pitch", "yaw", "lift")
    for axis, moment in enumerate(patterns[:3]):
        others = [name for name in patterns if name != moment]
        rows = [
            np.column_stack([getattr(m, moment), _products(m)[axis], *(getattr(m, other) for other in others)])
            for m in motion
        ]
        gains.append(_robust(rows, [m.acceleration[:, axis] for m in motion], lags))
    inertia = []
    whys = [
        unexplained(part, f"angular acceleration in {axis}") for axis, (*_, part) in zip(patterns, gains, strict=False)
    ]
    for name, (gain, spread, _), why in zip(("Jx", "Jy"), gains, whys, strict=False):
        relative = float(np.sqrt(spread[0, 0]) / abs(gain[0])) if gain[0] != 0.0 else np.inf
        value = k / float(gain[0]) if gain[0] != 0.0 else np.nan
        inertia.append((value, relative))
        # Density enters k and the gain alike, so that inertia over mass does not feel it.
        sigma = abs(value) * float(np.hypot(relative, k_sigma / k)) if k > 0.0 else np.inf
        result[name] = _judge(value, sigma, f"the craft hardly {'rolls' if name == 'Jx' else 'pitches'}", why)
    torque, torque_spread = float(gains[2][0][0]), float(np.sqrt(gains[2][1][0, 0]))
    result["b/Jz"] = _judge(torque, float(np.hypot(torque_spread, air * torque)), "the craft hardly yaws", whys[2])
    result["Jz"] = _yaw_inertia(gains, inertia)
    if result["Jx"].value is None or result["Jy"].value is None:
        result["Jz"] = StackedEstimate(None, None, None, "roll and pitch inertia are not determined")
    jz = result["Jz"]
    if jz.value is not None and jz.sigma is not None and result["b/Jz"].value is not None:
        relative = float(np.hypot(jz.sigma / jz.value, np.hypot(torque_spread / torque, air)))
        result["b"] = _judge(jz.value * torque, jz.value * torque * relative, "yaw inertia is not")
    else:
        result["b"] = StackedEstimate(
            None, None, None, "yaw torque shows only over yaw inertia (b/Jz), and yaw inertia is not determined"
        )
    return {name: result[name] for name in PARAMETERS}


def _best_lag(motion_at: Callable[[float], list[_Motion]]) -> float:
    """Find the lag with which roll and pitch moments explain most of the angular acceleration."""

    def left(lag: float) -> float:
        motion = motion_at(lag)
        total = 0.0
        for axis, moment in enumerate(("roll", "pitch")):
            rows = np.concatenate([getattr(m, moment) for m in motion])
            aim = np.concatenate([m.acceleration[:, axis] for m in motion])
            power = float(rows @ rows)
            total += float(aim @ aim) - (float(rows @ aim) ** 2 / power if power > 0.0 else 0.0)
        return total

    return float(minimize_scalar(left, bounds=(0.0, LONGEST_LAG), method="bounded", options={"xatol": 1e-4}).x)


def _yaw_inertia(
    gains: Sequence[tuple[Floats, Floats, float]], inertia: Sequence[tuple[float, float]]
) -> StackedEstimate:
    """Find Jz from the products of rates: (Jy - Jz)/Jx of the roll and (Jz - Jx)/Jy of the pitch equation."""
    (jx, x_relative), (jy, y_relative) = inertia
    from_roll, from_pitch = float(gains[0][0][1]), float(gains[1][0][1])
    guesses = np.array([jy - jx * from_roll, jx + jy * from_pitch])
    spreads = np.array(
        [
            np.hypot(jx * np.sqrt(gains[0][1][1, 1]), np.hypot(jy * y_relative, from_roll * jx * x_relative)),
            np.hypot(jy * np.sqrt(gains[1][1][1, 1]), np.hypot(jx * x_relative, from_pitch * jy * y_relative)),
        ]
    )
    if not (np.isfinite(guesses).all() and np.isfinite(spreads).all() and (spreads > 0.0).all()):
        return StackedEstimate(None, None, None, "roll and pitch inertia are not determined")
    weights = 1.0 / spreads**2
    value, sigma = float(guesses @ weights / weights.sum()), float(1.0 / np.sqrt(weights.sum()))
    return _judge(
        value,
        sigma,
        "it shows by itself only in products of rates, and the craft hardly turns about two axes at once; "
        "a bifilar pendulum measures it",
    )


def _robust(rows: Sequence[Floats], aims: Sequence[Floats], lags: int) -> tuple[Floats, Floats, float]:
    """Least squares with Huber weights by reweighting; covariance for coloured residuals; part of power explained."""
    x, y = np.vstack(rows), np.concatenate(aims)
    size = np.linalg.norm(x, axis=0)
    size = np.where(size > 0.0, size, 1.0)
    weight = np.ones(len(y))
    values = np.zeros(x.shape[1])
    for _ in range(20):
        root = np.sqrt(weight)
        new = np.linalg.lstsq(x / size * root[:, None], y * root, rcond=1e-10)[0] / size
        residual = y - x @ new
        scale = 1.4826 * float(np.median(np.abs(residual)))
        done = bool(np.allclose(new, values, rtol=1e-8, atol=0.0))
        values = new
        if done or scale == 0.0:
            break
        weight = np.minimum(1.0, HUBER * scale / np.maximum(np.abs(residual), 1e-300))
    root = np.sqrt(weight)
    cuts = np.cumsum([len(aim) for aim in aims])[:-1]
    covariance = covariance_of(
        np.split(x * root[:, None], cuts), np.split((y - x @ values) * root, cuts), most_lags=lags
    )
    power = float(y @ y)
    explained = 1.0 - float(np.sum((y - x @ values) ** 2)) / power if power > 0.0 else 0.0
    return values, np.maximum(covariance, 0.0) * np.eye(len(values)), explained


def _judge(value: float, sigma: float, reason: str, why: str = "") -> StackedEstimate:
    if why:
        return StackedEstimate(None, None, None, why)
    if not np.isfinite(value) or not np.isfinite(sigma):
        return StackedEstimate(None, None, None, f"not determined: {reason}")
    if not value > 0.0:
        return StackedEstimate(None, None, None, f"the estimate is not positive: {reason}")
    if sigma > DETERMINED * value:
        return StackedEstimate(
            None, None, None, f"the standard error is {100.0 * sigma / value:.0f} % of the estimate: {reason}"
        )
    return StackedEstimate(value, sigma, (value - 1.96 * sigma, value + 1.96 * sigma))


def _remarks(stacked: Mapping[str, StackedEstimate]) -> list[Finding]:
    findings = [
        Finding(
            "air-at-rest-assumed",
            Severity.INFO,
            "Refinement 2020 takes the air to be at rest; wind goes into its drag coefficient (the rigid body "
            "estimates wind)",
        )
    ]
    missing = {name: value.reason for name, value in stacked.items() if value.value is None}
    if missing:
        findings.append(
            Finding(
                "refinement-undetermined",
                Severity.INFO,
                "Refinement 2020 does not determine "
                + "; ".join(f"{name} ({reason})" for name, reason in missing.items()),
                "fly roll, pitch and yaw excitation at speed, record at 50 Hz",
                {"undetermined": len(missing)},
            )
        )
    return findings
