"""Measurements of a thrust stand by PWM and voltage, and the fits of `sysid.bench.stand` to them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from core.parameter import Parameter
from logparse import Finding, Severity
from sysid.bench.table import NOISE
from sysid.records.experiment import Floats

#: Voltages closer than this are one, V: what a pack sags by along a sweep is part of the test, not another test.
APART = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Coefficients:
    """Coefficients of one motor at one voltage (algorithm 2), in the air of the stand."""

    motor: str
    voltage: float | None  #: V; None where all voltages stand together.
    #: k [N s^2] and b [N m s^2].
    thrust: Parameter
    torque: Parameter


@dataclass(frozen=True, slots=True, kw_only=True)
class Trim:
    """Hover of one motor at one voltage (algorithm 1), under a weight of the craft."""

    motor: str
    voltage: float | None
    weight: float  #: N.
    pwm: float  #: us.
    thrust: float  #: N.
    #: rad/s and A where measured.
    speed: float | None
    current: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class NoTrim:
    """Why a motor cannot carry its share of a weight [N]."""

    motor: str
    voltage: float | None
    weight: float
    reason: str


@dataclass(frozen=True, slots=True)
class CommandCurve:
    """Thrust over the autopilot's command, common to the motors: k and e of `sysid.records.thrust_curve`."""

    full_thrust: Parameter  #: N at full command and `voltage`, in sea-level air.
    expo: Parameter  #: MOT_THST_EXPO that makes thrust linear in what the autopilot asks for.
    voltage: float  #: V.


@dataclass(frozen=True, slots=True)
class Level:
    """Measurements at one PWM: voltage (M,) and columns thrust, torque, speed, current (M, 4)."""

    pwm: float
    voltage: Floats
    readings: Floats


def voltages_tested(rows: pd.DataFrame) -> tuple[float, ...]:
    """Find the voltages of the test: of each sweep over PWM the median, those close together once."""
    parts = []
    for _, motor in rows.groupby("motor", sort=False):
        pwm, voltage = motor["pwm"].to_numpy(), motor["voltage"].to_numpy()
        if not np.isfinite(voltage).all():
            return ()
        # A sweep ends where PWM falls back by more than half of the range.
        cuts = np.flatnonzero(np.diff(pwm) < -0.5 * np.ptp(pwm)) + 1
        parts += [float(np.median(part)) for part in np.split(voltage, cuts) if len(part) > 2]
    groups: list[list[float]] = []
    for volts in sorted(parts):
        if groups and volts - groups[-1][-1] < APART:
            groups[-1].append(volts)
        else:
            groups.append([volts])
    return tuple(float(np.mean(group)) for group in groups)


def at_voltage(level: Level, voltage: float | None) -> Floats:
    """Evaluate thrust, torque, speed and current on straight lines over voltage."""
    volts = level.voltage
    if voltage is None or not np.isfinite(volts).all() or np.ptp(volts) < APART:
        return np.asarray(np.mean(level.readings, axis=0))
    rows = np.column_stack([np.ones_like(volts), volts - voltage])
    return np.asarray(np.linalg.lstsq(rows, level.readings, rcond=None)[0][0])


def least_squares(rows: Floats, y: Floats) -> tuple[Floats, Floats]:
    """Fit and covariance for white residuals."""
    values = np.linalg.lstsq(rows, y, rcond=None)[0]
    left = y - rows @ values
    variance = float(left @ left) / max(len(y) - rows.shape[1], 1)
    return np.asarray(values, dtype=np.float64), np.asarray(variance * np.linalg.inv(rows.T @ rows), dtype=np.float64)


def through_origin(speed: pd.Series[float], force: pd.Series[float], unit: str) -> Parameter:
    """Fit ``force = coefficient speed^2``."""
    w, y = np.asarray(speed, dtype=np.float64), np.asarray(force, dtype=np.float64)
    known = np.isfinite(w) & np.isfinite(y) & (w > 0.0)
    if np.count_nonzero(known) < 3:
        if np.isfinite(w).any() and not np.nanmax(w) > 0.0:
            return Parameter(None, None, unit, "the rotor never turned")
        missing = "rotor speed" if not np.isfinite(w).any() else "thrust" if unit == "N s^2" else "torque"
        return Parameter(None, None, unit, f"{missing} was not measured")
    values, covariance = least_squares(w[known, None] ** 2, y[known])
    if not values[0] > 0.0:
        return Parameter(None, None, unit, "the fit is not positive: check the sign and the speeds")
    return Parameter(float(values[0]), float(np.sqrt(covariance[0, 0])), unit)


def weak_motors(levels: Mapping[str, tuple[Level, ...]]) -> list[Finding]:
    """Name motors that give less thrust than the others at the same PWM."""
    if len(levels) < 2:
        return []
    grid = np.linspace(
        max(found[0].pwm for found in levels.values()), min(found[-1].pwm for found in levels.values()), 20
    )
    curves = {
        motor: np.interp(grid, [each.pwm for each in found], [float(each.readings[:, 0].mean()) for each in found])
        for motor, found in levels.items()
    }
    usual = np.median(np.array(list(curves.values())), axis=0)
    strong = usual > max(NOISE, 0.2) * usual.max()
    findings = []
    for motor, curve in curves.items():
        ratio = float(np.median(curve[strong] / usual[strong])) if strong.any() else 1.0
        if ratio < 0.9:
            findings.append(
                Finding(
                    "uneven-motor",
                    Severity.WARNING,
                    f"motor {motor} gives {100.0 * (1.0 - ratio):.0f} % less thrust on the stand than the others at "
                    "the same PWM",
                    "check propeller, bearings and ESC calibration",
                    {"motor": motor, "ratio": ratio},
                )
            )
    return findings
