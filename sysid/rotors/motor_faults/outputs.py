"""Whether motor outputs are in the order in which the mixer asked for them.

The rate controller's outputs through the frame's factors say what each motor should be told; the logged motor outputs,
through the autopilot's thrust curve, what each was told. Outputs are written ten times a second while the controller
runs at 400 Hz, so that means of what was written alias: the controller's outputs are taken at the instants of the
motors' instead (cubic spline; in firmware nothing lies between the two). Where both are slow, means over half seconds
tell more, and what the mixer explains better is used.

A motor that fails changes nothing of this: it is told what the mixer asks. What the craft *does* is no evidence of an
output's place, as a failing motor and an exchanged output look alike there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
import scipy

from logparse import Finding, MissingDataError, Severity, Tables, Vehicle
from logparse.tables import between
from sysid.records import Floats
from sysid.records.mixer import INDEPENDENT, MARGIN, expectation, factors_of, sampled_at
from sysid.records.motor_scaling import curve, motor_commands

#: Time over which neighbours count as one, and over which means are taken where the controller is logged slowly, s.
BLOCK_SECONDS = 0.5
#: Fewest half seconds that tell an order.
_FEWEST = 20
#: How much better another order must explain the outputs, and part of their movement that it must explain: firmware
#: gives what it is asked for within 0.3 %, and no order but the right one comes near that.
_BETTER, _EXPLAINED = 4.0, 0.5


@dataclass(frozen=True, slots=True)
class _View:
    """Which order of the motors explains their outputs best, and how well."""

    best: np.ndarray  #: Motor of the mixer that each output follows best.
    own: Floats  #: What is left of each output's movement in the logged order ...
    least: Floats  #: ... and in the best one.
    explained: float


def check_outputs(tables: Tables, vehicle: Vehicle, start: float, stop: float) -> tuple[Finding, ...]:
    """Name outputs that follow what the mixer asks of another motor.

    MissingDataError without frame, a motor's output or the controller's outputs, or when the flight is too short.
    """
    names = [f"m{motor.number}" for motor in vehicle.motors]
    if not names or tables.motors is None or not set(names) <= set(tables.motors):
        raise MissingDataError("the order of motors needs the frame and the outputs of all its motors")
    motors, asked = tables.motors.loc[start:stop, names].dropna(), _asked(tables, start, stop)
    views = _views(motors, asked, vehicle)
    if not views:
        raise MissingDataError("what was asked of the motors holds numbers that no controller gives: damage")
    view = max(views, key=lambda one: one.explained)
    wrong = view.best != np.arange(len(names))
    ratio = float(view.own.sum() / max(float(view.least.sum()), 1e-300))
    if (
        wrong.any()
        and ratio > _BETTER
        and view.explained > _EXPLAINED
        and np.all(view.own[wrong] > _BETTER * view.least[wrong])
    ):
        return (_order_finding([(names[k], names[view.best[k]]) for k in np.flatnonzero(wrong)], ratio),)
    return ()


def _asked(tables: Tables, start: float, stop: float) -> pd.DataFrame:
    """Return the rate controller's outputs, ``thrust`` first where it is known, with a second more on either side."""
    if tables.has("rates"):
        columns = tables.columns("rates", ["out_thrust", "out_roll", "out_pitch", "out_yaw"])
        known = dict(zip(("thrust", "roll", "pitch", "yaw"), columns, strict=True))
        known = {name: column for name, column in known.items() if column.notna().sum() > 1}
        if {"roll", "pitch", "yaw"} <= set(known):
            rows = between(pd.DataFrame(known), start - 1.0, stop + 1.0)
            # Beyond the outputs of any firmware's scale are flipped bits.
            sound: pd.DataFrame = rows[(np.abs(rows.to_numpy()) <= 1e5).all(axis=1)]
            return sound
    raise MissingDataError("the order of motors needs the rate controller's outputs (RATE)")


def _views(motors: pd.DataFrame, asked: pd.DataFrame, vehicle: Vehicle) -> list[_View]:
    """Return what motors were and should be told at the instants of the outputs, and over half seconds."""
    t, factors = motors.index.to_numpy(np.float64), factors_of(vehicle)
    command = motor_commands(motors.to_numpy(np.float64), vehicle)
    thrust = curve(np.clip(command, 0.0, 1.0), vehicle.thrust_expo)
    outputs = np.column_stack([sampled_at(t, asked[name]) for name in asked])
    inside = np.isfinite(outputs).all(axis=1) & np.all((command > MARGIN) & (command < 1.0 - MARGIN), axis=1)
    if "thrust" in asked:
        inside &= outputs[:, 0] > MARGIN
    step = float(np.median(np.diff(t))) if len(t) > 1 else BLOCK_SECONDS
    blocks = inside.sum() * min(step, BLOCK_SECONDS) / BLOCK_SECONDS
    if blocks < _FEWEST:
        raise MissingDataError(f"only {BLOCK_SECONDS * blocks:.0f} s in which no motor is at an end of its range")
    # Half seconds of the flight; those that are not wholly inside are left out.
    half = pd.Series(np.floor(t / BLOCK_SECONDS))
    good = half.groupby(half).transform("size").to_numpy() > 0.8 * BLOCK_SECONDS / step
    good &= pd.Series(inside).groupby(half).transform("all").to_numpy()
    views = []
    for rows in (inside, good) if good.sum() * step >= _FEWEST * BLOCK_SECONDS else (inside,):
        given, due = thrust[rows], outputs[rows]
        if rows is good:
            of = half[rows].to_numpy()
            given, due = (pd.DataFrame(part).groupby(of).mean().to_numpy() for part in (given, due))
        view = _view(given / given.mean(axis=1, keepdims=True), due, given.mean(axis=1, keepdims=True), factors)
        views += [] if view is None else [view]
    return views


def _view(given: Floats, outputs: Floats, mean: Floats, factors: Floats) -> _View | None:
    """Fit the best order; None where numbers are so large that their squares are none."""
    with np.errstate(over="ignore", invalid="ignore"):
        if outputs.shape[1] > 3:
            # What the firmware does about voltage and density is alike for all motors.
            due = expectation(outputs, factors)
            due = due / due.mean(axis=1, keepdims=True)
        else:
            due = _scaled(given, outputs / mean, factors)
        moved, asked = given - given.mean(axis=0), due - due.mean(axis=0)
        costs = np.sum((moved[:, :, None] - asked[:, None, :]) ** 2, axis=0)
    if not np.isfinite(costs).all():
        return None
    own = np.arange(len(costs))
    # Where every row likes its own column best there is nothing to solve, nor an optimiser to import.
    alike = np.array_equal(costs.argmin(axis=1), own)
    best = own if alike else np.asarray(scipy.optimize.linear_sum_assignment(costs)[1])
    least = costs[own, best]
    return _View(best, np.diag(costs), least, float(1.0 - least.sum() / max(float(np.sum(moved**2)), 1e-300)))


def _scaled(given: Floats, driving: Floats, factors: Floats) -> Floats:
    """Return what the mixer asks for where the gain of each axis is unknown, (n, motors).

    Which motor is which does not matter to the size of an axis's pattern over all motors, so that its gain is that size
    in the outputs over that in the mixer.
    """
    pattern = np.linalg.lstsq(driving - driving.mean(axis=0), given - given.mean(axis=0), rcond=None)[0]
    size = np.linalg.norm(factors - factors.mean(axis=0), axis=0)
    gain = np.linalg.norm(pattern, axis=1) / np.maximum(size, INDEPENDENT) * (size > INDEPENDENT)
    return np.asarray(1.0 + (driving * gain) @ factors.T)


def _order_finding(wrong: list[tuple[str, str]], ratio: float) -> Finding:
    pairs = ", ".join(f"{name} follows what the mixer asks of {other}" for name, other in wrong)
    return Finding(
        "motor-order",
        Severity.ERROR,
        f"motor outputs are not in the mixer's order: {pairs} (in this order the mixer explains them {ratio:.3g} times "
        "better); parameters of single motors, moments and transfer functions from motor outputs mean nothing",
        "check SERVOn_FUNCTION, FRAME_CLASS and FRAME_TYPE, and that the parameters are those of this flight",
        {"motors": ", ".join(name for name, _ in wrong), "follow": ", ".join(other for _, other in wrong)},
    )
