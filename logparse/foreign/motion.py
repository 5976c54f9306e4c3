"""A table of other origin as motion in rotorid's conventions: NED, FRD, scalar-first quaternions, SI."""

from __future__ import annotations

import difflib
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.spatial.transform import Rotation

from core.attitude import continuous
from core.findings import Finding, Severity
from logparse.craft.frames import Vehicle
from logparse.foreign.clock import held_values, known_rows, steady_rows, uniform, without_spikes
from logparse.foreign.columns import FRD_TO_BODY, WORLD_TO_NED, ColumnMap, read_column_map
from logparse.foreign.consistency import ResampledMotion, contradiction, pairs_of, wrong_frame
from logparse.foreign.files import TableError, flatten, read_columns, table_finding
from logparse.foreign.motors import check_lift, check_units, find_order, not_lifting, unchecked_order, wrong_order
from logparse.foreign.shifts import check_clock, check_shifts

Floats = npt.NDArray[np.float64]

#: A number that is larger than its square can be is damage, and counts as missing.
_LARGEST = 1e150

#: How far quaternions are off unit length beyond rounding, and what is worth a remark.
_ROUNDED, _NORM = 0.003, 0.02

#: Part of what quaternions miss of unit length that another scale of one of their parts must explain to be believed,
#: and the change of its square.
_EXPLAINED, _ODD_SCALE = 0.95, 0.1

#: Part of what motors usually give below which they stand, and height [m] at which a craft has left the ground
#: (the landed coaxial craft of ACSL hops by 0.08 m).
_IDLE, _CLEAR = 0.5, 0.1

#: Sampling interval of what is checked, s: motion has nothing that is faster.
_CHECKED = 0.004

#: Time over which differences are taken, s: short against the motion, long against noise; and second differences of
#: position, where no velocity is logged.
_BASE, _LONG_BASE = 0.04, 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class MotionTable:
    """One record."""

    name: str
    t: Floats  #: shape (N,): s, uniform, in the table's own clock.
    #: shape (N, 3): NED, m and m/s.
    position: Floats
    velocity: Floats
    quaternion: Floats  #: shape (N, 4): Body (FRD) to NED, scalar first, continuous.
    rates: Floats  #: shape (N, 3): FRD, rad/s.
    motors: Floats  #: shape (N, m): rad/s, us or 0..1.
    motor_unit: str  #: ``"rad/s"``, ``"us"`` or ``"1"``.
    inputs: Floats  #: shape (N, e)
    input_names: tuple[str, ...]
    voltage: Floats | None  #: shape (N,)
    vehicle: Vehicle
    columns: ColumnMap
    findings: tuple[Finding, ...]


def read_motion(
    source: Path | str | pd.DataFrame, columns: Mapping[str, Any] | str | Path, name: str | None = None
) -> MotionTable:
    """Read a table and bring it to rotorid's conventions."""
    declared = read_column_map(columns)
    if isinstance(source, pd.DataFrame):
        frame, label = flatten(source), name or declared.name or "table"
    else:
        path = Path(source)
        frame, label = read_columns(path), name or declared.name or path.name
    _require(frame, declared, label)
    if declared.time is not None:
        column = declared.time.columns[0]
        if declared.names.count(column) > 1:
            raise TableError(f"{label}: column {column} is the time, and cannot be anything else")
        t = frame[column].to_numpy(np.float64) * declared.time.factor
        rows, findings = steady_rows(t, column, label)
        t, frame = t[rows], frame.iloc[rows]
    else:
        t, findings = np.arange(len(frame)) / (declared.rate or 1.0), []
    names = list(dict.fromkeys(declared.names))[0 if declared.time is None else 1 :]
    values = np.array(frame[names], dtype=np.float64)
    values[np.abs(values) > _LARGEST] = np.nan
    dt = float(np.median(np.diff(t)))
    attitude = [names.index(column) for column in declared.attitude.columns]
    values[:, attitude] = _without_turns(values[:, attitude], declared)
    keep, values, more = known_rows(values, names, dt, declared.fill, label)
    values, t = values[keep], t[keep]
    values, spikes = without_spikes(values, names)
    at = {name: k for k, name in enumerate(names)}
    # Commands are round numbers, which stand still in a calm hover; measured speeds do not.
    measured = () if declared.motors.quantity in {"pwm", "command"} else declared.motors.columns
    vectors = [signal.columns for signal in (declared.velocity, declared.rates) if signal is not None]
    moving = (*declared.position.columns, *declared.attitude.columns, *measured, *itertools.chain(*vectors))
    table = _Converter(values, at, declared, label)
    quaternion, remarks = table.quaternion()
    clock = uniform(t)
    columns_of = {
        "position": table.vector(declared.position.columns, declared.position.factor),
        "quaternion": quaternion,
        "motors": values[:, [at[column] for column in declared.motors.columns]] * declared.motors.factor,
        "inputs": values[:, [at[signal.columns[0]] for signal in declared.inputs.values()]],
    }
    if declared.velocity is not None:
        columns_of["velocity"] = table.vector(declared.velocity.columns, declared.velocity.factor)
    if declared.rates is not None:
        columns_of["rates"] = table.vector(declared.rates.columns, declared.rates.factor)
    if declared.voltage is not None:
        columns_of["voltage"] = values[:, [at[declared.voltage.columns[0]]]] * declared.voltage.factor
    signals, labels = values[:, [at[each] for each in moving]], list(moving)
    if not measured:  # all commands at once do not stand still
        commands = values[:, [at[column] for column in declared.motors.columns]]
        signals = np.column_stack([signals, commands @ np.sqrt(np.arange(2.0, 2.0 + commands.shape[1]))])
        labels.append(", ".join(declared.motors.columns))
    found = [*findings, *more, *spikes, *held_values(signals, labels, dt), *remarks]
    if len(clock) != len(t) or np.max(np.abs(clock - t)) > 0.3 * dt:
        columns_of = {key: _resampled(t, values, clock) for key, values in columns_of.items()}
    found += check_units(declared, columns_of, label)
    position, velocity, quaternion, rates = _in_ned(columns_of, clock, declared)
    flown = _flown(-position[:, 2], columns_of["motors"], declared)
    if standing := len(clock) - len(clock[flown]):
        found.append(
            table_finding(
                ", ".join(declared.position.columns),
                f"the craft stands on the ground for {standing * dt:.1f} s, which are left out",
                "nothing: what carries it there is not the motors",
                Severity.INFO,
                seconds=standing * dt,
            )
        )
        clock, position, velocity, quaternion, rates = (
            values[flown] for values in (clock, position, velocity, quaternion, rates)
        )
        columns_of = {key: values[flown] for key, values in columns_of.items()}
    every = slice(None, None, max(round(_CHECKED / dt), 1))
    times = clock[every]
    motion = ResampledMotion(
        position[every],
        velocity[every],
        Rotation.from_quat(quaternion[every], scalar_first=True),
        rates[every],
        columns_of["motors"][every],
        float(times[1] - times[0]),
    )
    found += _check(declared, motion, label)
    unit = {"pwm": "us", "command": "1"}.get(declared.motors.quantity, "rad/s")
    return MotionTable(
        name=label,
        t=clock,
        position=position,
        velocity=velocity,
        quaternion=quaternion,
        rates=rates,
        motors=columns_of["motors"],
        motor_unit=unit,
        inputs=columns_of["inputs"],
        input_names=tuple(declared.inputs),
        voltage=columns_of["voltage"][:, 0] if "voltage" in columns_of else None,
        vehicle=_vehicle(declared),
        columns=declared,
        findings=tuple(found),
    )


def _flown(height: Floats, motors: Floats, declared: ColumnMap) -> slice:
    """Rows between take-off and landing, where motors that stand before or after show the ground; else all."""
    low = declared.motors.pwm[0] if declared.motors.quantity == "pwm" else 0.0
    strength = motors.mean(axis=1) - low
    idle = strength < _IDLE * np.quantile(strength, 0.75)
    turning = np.flatnonzero(~idle)
    if not len(turning) or not (idle[0] or idle[-1]):
        return slice(None)
    first, last = int(turning[0]), int(turning[-1])
    ground = height[first - 1] if idle[0] else height[last + 1]
    above = first + np.flatnonzero(height[first : last + 1] > ground + _CLEAR)
    return slice(int(above[0]), int(above[-1]) + 1) if len(above) else slice(None)


def _check(declared: ColumnMap, motion: ResampledMotion, label: str) -> list[Finding]:
    """Compare motion with itself and with the motors; TableError for what contradicts, findings for what is odd."""
    pairs = pairs_of(declared, motion)
    reach = motion.half(_BASE)
    base = motion.half(_LONG_BASE) if declared.velocity is None else reach
    order = find_order(declared, motion)
    refusals = (
        *(contradiction(pair, declared, motion, reach) for pair in pairs),
        wrong_frame(declared, motion, base),
        not_lifting(declared, motion, base),
        wrong_order(declared, order),
    )
    if wrong := next(filter(None, refusals), ""):
        raise TableError(f"{label}: {wrong}")
    return [
        *check_lift(declared, motion, base),
        *unchecked_order(declared, order),
        *check_shifts(declared, motion, pairs),
        *check_clock(declared, motion, pairs),
    ]


def _require(frame: pd.DataFrame, declared: ColumnMap, label: str) -> None:
    """Check that every column that is named is there."""
    known = [str(column) for column in frame.columns]
    missing = [each for each in dict.fromkeys(declared.names) if each not in frame.columns]
    # A name that a file has twice is read as NAME and NAME.1.
    if twice := [each for each in dict.fromkeys(declared.names) if f"{each}.1" in known]:
        raise TableError(f"{label}: column {', '.join(twice)} stands in the table more than once; rename one")
    if not missing:
        return
    hints = []
    for each in missing:
        near = difflib.get_close_matches(each, known, 1)
        hints.append(f"{each} (is it {near[0]}?)" if near else each)
    listed = ", ".join(known[:40]) + (", ..." if len(known) > 40 else "")
    raise TableError(f"{label}: no column {', '.join(hints)}; the table has {listed}")


@dataclass(frozen=True, slots=True)
class _Converter:
    """Values of the table and where each column is."""

    values: Floats
    at: Mapping[str, int]
    declared: ColumnMap
    label: str

    def vector(self, names: tuple[str, ...], factor: float) -> Floats:
        """Columns of a vector, SI, in the declared axes."""
        return np.asarray(self.values[:, [self.at[name] for name in names]] * factor)

    def quaternion(self) -> tuple[Floats, list[Finding]]:
        """Attitude as unit quaternions of the declared frames, body to world, scalar first, continuous."""
        signal = self.declared.attitude
        raw = self.values[:, [self.at[name] for name in signal.columns]]
        findings: list[Finding] = []
        if signal.quaternion:
            norm = np.linalg.norm(raw, axis=1)
            named = ", ".join(signal.columns)
            if norm.min() < 0.1:
                raise TableError(
                    f"{self.label}: columns {named}: {int(np.sum(norm < 0.1))} quaternions are zero; is it the "
                    "attitude?"
                )
            off = float(np.max(np.abs(norm - 1.0)))
            if off > 0.5:
                raise TableError(
                    f"{self.label}: columns {named}: quaternions have norms from {norm.min():.3g} to {norm.max():.3g}; "
                    "that is no attitude, or a column of it is another's"
                )
            if off > _ROUNDED and (odd := _odd_part(raw)) is not None:
                raise TableError(
                    f"{self.label}: column {signal.columns[odd[0]]}: with {odd[1]:.2f} times these values quaternions "
                    f"({named}) would have unit length; they are up to {100 * off:.1f} % off it: another scale?"
                )
            if off > _NORM:
                text = f"quaternions are up to {100 * off:.1f} % off unit length and are normalised"
                findings.append(table_finding(named, text, "", Severity.INFO, largest=off))
            rotation = Rotation.from_quat(raw, scalar_first=signal.scalar_first)
        else:
            angles = raw * signal.factor
            for name, angle in zip(signal.columns[:2], angles[:, :2].T, strict=True):
                if (most := float(np.max(np.abs(angle)))) > 2.0 * np.pi:
                    raise TableError(
                        f"{self.label}: column {name}: a lean of {most:.3g} rad is more than a turn; is it in deg?"
                    )
            rotation = Rotation.from_euler("ZYX", angles[:, ::-1])
        if signal.world_to_body:
            rotation = rotation.inv()
        return continuous(rotation.as_quat(scalar_first=True)), findings


def _odd_part(quaternion: Floats) -> tuple[int, float] | None:
    """Name the part of quaternions of which another scale would make them unit ones, and that scale; None for none."""
    known = quaternion[np.isfinite(quaternion).all(axis=1)]
    missing = 1.0 - np.sum(known**2, axis=1)
    whole = float(missing @ missing)
    for k, square in enumerate((known**2).T):
        slope = float(square @ missing) / max(float(square @ square), 1e-300)
        left = float(np.sum((missing - slope * square) ** 2))
        if left < (1.0 - _EXPLAINED) * whole and abs(slope) > _ODD_SCALE and slope > -1.0:
            return k, float(np.sqrt(1.0 + slope))
    return None


def _without_turns(attitude: Floats, declared: ColumnMap) -> Floats:
    """Quaternions without changes of sign, angles without turns of 360 degrees: both are none, and no spikes either."""
    known = np.isfinite(attitude).all(axis=1)
    out = attitude.copy()
    if declared.attitude.quaternion:
        out[known] = continuous(attitude[known])
    else:
        out[known] = np.unwrap(attitude[known], period=2.0 * np.pi / declared.attitude.factor, axis=0)
    return out


def _resampled(t: Floats, values: Floats, clock: Floats) -> Floats:
    return (
        np.column_stack([np.interp(clock, t, column) for column in values.T])
        if values.size
        else np.empty((len(clock), 0))
    )


def _in_ned(columns: Mapping[str, Floats], clock: Floats, declared: ColumnMap) -> tuple[Floats, Floats, Floats, Floats]:
    """Position, velocity, quaternion and rates in NED and FRD; what is not logged is derived."""
    world, body = WORLD_TO_NED[declared.world], FRD_TO_BODY[declared.body]
    dt = float(clock[1] - clock[0])
    rotation = Rotation.from_quat(columns["quaternion"], scalar_first=True).as_matrix()
    if "velocity" in columns:
        velocity = columns["velocity"]
        if declared.velocity is not None and declared.velocity.body:
            velocity = np.einsum("nij,nj->ni", rotation, velocity)
    else:
        velocity = np.gradient(columns["position"], dt, axis=0)
    if "rates" in columns:
        rates = columns["rates"]
    else:
        turn = np.swapaxes(rotation[:-1], -1, -2) @ rotation[1:]
        between = Rotation.from_matrix(turn).as_rotvec() / dt
        rates = np.vstack([between[:1], 0.5 * (between[1:] + between[:-1]), between[-1:]])
    turned = Rotation.from_matrix(world @ rotation @ body).as_quat(scalar_first=True)
    return columns["position"] @ world.T, velocity @ world.T, continuous(turned), rates @ body


def _vehicle(declared: ColumnMap) -> Vehicle:
    low, high = declared.motors.pwm
    frame = declared.motors.frame
    return Vehicle(
        motors=declared.motors.motors,
        frame_class=frame[0] if frame else None,
        frame_type=frame[1] if frame else None,
        frame_source="declared",
        pwm_min=low,
        pwm_max=high,
        spin_arm=0.0,
        spin_min=0.0,
        spin_max=1.0,
    )
