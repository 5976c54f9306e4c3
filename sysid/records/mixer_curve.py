"""Whether the curve in the parameters is the one by which the mixer made motor outputs of the controller's.

Both are logged. To first order a motor's thrust by the curve in the parameters departs from the mean of all as much as
the mixer's sum for it departs from the thrust asked. Where it departs by another factor, MOT_THST_EXPO, MOT_SPIN_MIN,
MOT_SPIN_MAX or the range of PWM in the log are not those flown with, and that factor makes torque of outputs. PX4
scales its allocation in ways of its own, so that there the factor is none of the parameters' fault.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pandas as pd

from core.cubic_spline import cubic_spline
from logparse import Finding, Severity, Tables, Vehicle
from sysid.records.arrays import Floats
from sysid.records.mixer import expectation, factors_of
from sysid.records.motor_scaling import curve, motor_commands

#: Name of the finding; its evidence ``slope`` is the factor.
MIXER_DIFFERS = "parameters-not-flown"

#: Departure of the factor from one that is a finding: firmware keeps 4 % (its limits of yaw, rounding).
DIFFERS = 0.06

#: Coherence (R^2) of outputs with the controller's below which nothing is said: noise would pass for a factor.
_COHERENT = 0.95

#: Fewest rows of outputs, and the time between the controller's rows beyond which nothing is interpolated, s.
_FEWEST, GAP = 100, 0.3

#: Commands nearer to the ends of a motor's range than this are left out: there the mixer gives what it can.
MARGIN = 0.02


def mixer_differs(tables: Tables, vehicle: Vehicle | None, start: float, stop: float) -> list[Finding]:
    """Compare the outputs' movement in roll and pitch with what the controller asked."""
    names = [f"m{motor.number}" for motor in vehicle.motors] if vehicle is not None else []
    if vehicle is None or not names or tables.motors is None or not tables.has("rates"):
        return []
    asked = list(tables.columns("rates", ["out_thrust", "out_roll", "out_pitch", "out_yaw"]))
    if not set(names) <= set(tables.motors) or any(column.notna().sum() < _FEWEST for column in asked):
        return []
    motors = tables.motors.loc[start:stop, names].dropna()
    t = motors.index.to_numpy(np.float64)
    outputs = np.column_stack([sampled_at(t, column.loc[start - 1.0 : stop + 1.0].dropna()) for column in asked])
    command = motor_commands(motors.to_numpy(np.float64), vehicle)
    inside = np.all((command > MARGIN) & (command < 1.0 - MARGIN), axis=1)
    inside &= np.isfinite(outputs).all(axis=1) & (outputs[:, 0] > MARGIN) & (np.abs(outputs) < 1.0).all(axis=1)
    if inside.sum() < _FEWEST:
        return []
    factors = factors_of(vehicle)
    to_axes = np.linalg.pinv(factors - factors.mean(axis=0))[:2].T
    given = curve(command[inside], vehicle.thrust_expo)
    wanted = expectation(outputs[inside], factors)
    slope = common_slope(*((part / part.mean(axis=1, keepdims=True)) @ to_axes for part in (wanted, given)))
    if slope is None or abs(slope - 1.0) < DIFFERS:
        return []
    more = f"{100.0 * abs(slope - 1.0):.0f} % {'more' if slope > 1.0 else 'less'}"
    if vehicle.autopilot == "PX4":
        severity, why, advice = Severity.INFO, "than the frame's geometry makes of them", ""
    else:
        severity, advice = Severity.WARNING, "check that the parameters are those of this flight"
        why = (
            "than the parameters say: MOT_THST_EXPO, MOT_SPIN_MIN, MOT_SPIN_MAX or the PWM range in the log are not "
            "those flown with"
        )
    reason = f"motor outputs follow the rate controller {more} {why}; effectiveness is corrected by it"
    return [Finding(MIXER_DIFFERS, severity, reason, advice, {"slope": slope})]


def common_slope(wanted: Floats, given: Floats) -> float | None:
    """Return the slope of what was given over what was wanted, of the axes that agree well enough to tell one.

    `wanted, given` (N, axes).
    """
    x, y = wanted - wanted.mean(axis=0), given - given.mean(axis=0)
    both, own, other = (np.sum(a * b, axis=0) for a, b in ((x, y), (x, x), (y, y)))
    with np.errstate(divide="ignore", invalid="ignore"):
        good = (both > 0.0) & (both**2 > _COHERENT * own * other)
    return float(both[good].sum() / own[good].sum()) if good.any() else None


def known_slope(findings: Iterable[Finding]) -> float:
    """Return the factor that a record's findings state; 1 where its parameters are those flown."""
    return next((float(f.evidence["slope"] or 1.0) for f in findings if f.id == MIXER_DIFFERS), 1.0)


def sampled_at(t: Floats, column: pd.Series) -> Floats:
    """Sample a column at given times by a cubic spline; NaN outside and where its samples lie apart."""
    at = column.index.to_numpy(np.float64)
    if len(at) < 4:
        return np.full(len(t), np.nan)
    after = np.clip(np.searchsorted(at, t), 1, len(at) - 1)
    known = (t >= at[0]) & (t <= at[-1]) & (at[after] - at[after - 1] < GAP)
    return np.where(known, cubic_spline(at, column.to_numpy(np.float64)[:, None], t)[:, 0], np.nan)
