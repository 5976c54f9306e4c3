"""Whether the columns of a table fit each other: velocity and position, rates and attitude, thrust and acceleration.

Each check compares what was declared with what else could have been meant, so that the text can say which.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from core.findings import Finding
from core.units import STANDARD_GRAVITY
from logparse.foreign.columns import FRD_TO_BODY, WORLD_TO_NED, ColumnMap
from logparse.foreign.differences import mean_over, slopes
from logparse.foreign.files import TableError
from logparse.foreign.lift import check_lift, following, mean_square, specific_force
from logparse.foreign.motor_order import contradicted_order

Floats = npt.NDArray[np.float64]

#: Correlation that signals of one motion have, and what is too little to be one motion.
_ALIKE, _UNLIKE = 0.5, 0.2

#: How many times as large as the derivative of the other a signal may be; noise and filters make some tenths.
_SCALE = (0.6, 1.6)

#: The same of a single axis, which may be noisier, and the correlation from which on it is believed.
_ODD, _CLEAR = 2.5, 0.8

#: How many times as fast as its lean says a craft may speed up, by regression: drag takes some, units much more.
_SPEEDING = (0.25, 2.0)

#: Movement below which a check has nothing to go by: m/s, rad/s, m/s^2.
_STILL_SPEED, _STILL_RATE, _STILL_FORCE = 0.05, 0.05, 0.3

#: Time over which differences are taken, s: short against the motion, long against noise; and second differences of
#: position, where no velocity is logged.
_BASE, _LONG_BASE = 0.04, 0.2


def check_motion(
    declared: ColumnMap,
    position: Floats,
    velocity: Floats,
    quaternion: Floats,
    rates: Floats,
    motors: Floats,
    t: Floats,
    label: str,
) -> list[Finding]:
    """Compare motion with itself and with the motors, in NED and FRD; what is odd and may still be right is told.

    Motion is (N, 3) in NED and FRD, quaternions scalar first, motors (N, k) in the order declared, t uniform [s].
    TableError names every contradiction, its columns, and what would fit.
    """
    dt = float(t[1] - t[0])
    reach = max(round(_BASE / dt / 2.0), 1)
    rotation = Rotation.from_quat(quaternion, scalar_first=True)
    wrong: list[str] = []
    if declared.velocity is not None:
        wrong += _velocity(declared, position, velocity, rotation, dt, reach)
    if not wrong and declared.rates is not None:
        wrong += _rates(declared, rotation, rates, dt, reach)
    _refuse(label, wrong)
    base = max(round(_LONG_BASE / dt / 2.0), 1) if declared.velocity is None else reach
    force = specific_force(velocity, rotation, dt, base)
    _refuse(label, _thrust(declared, velocity, rotation, force, motors, dt, base))
    _refuse(label, contradicted_order(declared, rates, motors, dt))
    return check_lift(declared, -force[:, 2], motors, 2 * base, dt)


def _refuse(label: str, wrong: Sequence[str]) -> None:
    if wrong:
        raise TableError(f"{label}: " + "; ".join(wrong))


def _alike(a: Floats, b: Floats) -> float:
    """Correlation; zero where one does not move."""
    a, b = a - a.mean(), b - b.mean()
    norm = float(np.sqrt((a @ a) * (b @ b)))
    return float(a @ b) / norm if norm > 0.0 else 0.0


def _still(parts: Mapping[str, Floats], moved: Iterable[int], axes: str) -> str:
    """Name what stands still on an axis on which the other moves; empty where nothing does."""
    found = [
        f"{name} stands still along {axes[axis]}"
        for name, part in parts.items()
        for axis in moved
        if not np.ptp(part[:, axis])
    ]
    return "".join(f"; {text}" for text in found)


def _ratio(of: Floats, by: Floats) -> float:
    """How many times `of` is as large as `by`, by least squares through both."""
    return float(np.sqrt(np.mean((of - of.mean()) ** 2) / max(np.mean((by - by.mean()) ** 2), 1e-300)))


def _odd_axis(ratios: Iterable[float], alike: Iterable[float], moved: Iterable[int], axes: str) -> str:
    """Name an axis on which a signal is many times as large as on the others; empty where none is."""
    for ratio, clear, axis in zip(ratios, alike, moved, strict=True):
        if clear > _CLEAR and not 1.0 / _ODD < ratio < _ODD:
            return f"{ratio:.3g} times along {axes[axis]}: the unit of one column is wrong{_unit_hint(ratio)}"
    return ""


def _unit_hint(ratio: float) -> str:
    for factor, text in ((1000.0, "mm for m"), (100.0, "cm for m"), (57.3, "deg for rad"), (3.6, "km/h for m/s")):
        for value, way in ((factor, text), (1.0 / factor, text)):
            if abs(np.log(ratio / value)) < 0.15:
                return f" ({way}?)"
    return ""


def _velocity(
    declared: ColumnMap, position: Floats, velocity: Floats, rotation: Rotation, dt: float, reach: int
) -> list[str]:
    """Velocity must be the derivative of position."""
    names = ", ".join(declared.velocity.columns) if declared.velocity is not None else ""
    seen = position.std(axis=0)
    slope, inside = slopes(position, dt, reach), velocity[reach:-reach]
    moved = [axis for axis in range(3) if slope[:, axis].std() > _STILL_SPEED or inside[:, axis].std() > _STILL_SPEED]
    if not moved or seen.max() == 0.0:
        return []
    alike = [_alike(slope[:, axis], inside[:, axis]) for axis in moved]
    ratios = [_ratio(inside[:, axis], slope[:, axis]) for axis in moved]
    ratio = float(np.median(ratios))
    if min(alike) > _ALIKE and _SCALE[0] < ratio < _SCALE[1]:
        odd = _odd_axis(ratios, alike, moved, "NED")
        positions = ", ".join(declared.position.columns)
        return [f"columns {names}: velocity is as large as the derivative of {positions}, but {odd}"] if odd else []
    if min(alike) > _ALIKE:
        return [
            f"columns {names}: velocity is {ratio:.3g} times the derivative of {', '.join(declared.position.columns)}: "
            f"a unit is wrong{_unit_hint(ratio)}"
        ]
    evidence = ", ".join(f"{'NED'[axis]} {value:+.2f}" for axis, value in zip(moved, alike, strict=True))
    still = _still({"position": position, "velocity": velocity}, moved, "NED")
    fits = still or _best_axes(slope, inside, "velocity")
    other = rotation[reach:-reach]
    if declared.velocity is not None and not declared.velocity.body and not still:
        turned = other.apply(inside)
        if min(_alike(slope[:, axis], turned[:, axis]) for axis in moved) > max(_ALIKE, 0.8):
            fits = "; in body axes it would fit (axes: body)"
    return [
        f"columns {names}: velocity is not the derivative of {', '.join(declared.position.columns)} (correlation "
        f"{evidence}){fits}"
    ]


def _best_axes(truth: Floats, signal: Floats, what: str) -> str:
    """Which order and signs of the axes would fit; empty if none does."""
    best, score = "", 0.7
    for order in itertools.permutations(range(3)):
        values = [_alike(truth[:, axis], signal[:, order[axis]]) for axis in range(3)]
        known = [abs(value) for value in values if value]
        if known and min(known) > score:
            score = min(known)
            signs = ", ".join(f"{'-' if value < 0 else ''}{'xyz'[order[axis]]}" for axis, value in enumerate(values))
            best = f"; {what} as ({signs}) would fit"
    return best


def _rates(declared: ColumnMap, rotation: Rotation, rates: Floats, dt: float, reach: int) -> list[str]:
    """Rates must be those of the attitude, in body axes."""
    names = ", ".join(declared.rates.columns) if declared.rates is not None else ""
    attitude = ", ".join(declared.attitude.columns)
    step = (rotation[: -2 * reach].inv() * rotation[2 * reach :]).as_rotvec() / (2.0 * reach * dt)
    smooth = mean_over(rates, 2 * reach)
    moved = [axis for axis in range(3) if step[:, axis].std() > _STILL_RATE or smooth[:, axis].std() > _STILL_RATE]
    if not moved:
        return []
    alike = [_alike(step[:, axis], smooth[:, axis]) for axis in moved]
    ratios = [_ratio(smooth[:, axis], step[:, axis]) for axis in moved]
    ratio = float(np.median(ratios))
    if min(alike) > _ALIKE and _SCALE[0] < ratio < _SCALE[1]:
        odd = _odd_axis(ratios, alike, moved, "xyz")
        return [f"columns {names}: rates are those of the attitude ({attitude}), but {odd}"] if odd else []
    if min(alike) > _ALIKE:
        return [
            f"columns {names}: rates are {ratio:.3g} times those of the attitude ({attitude}): a unit is "
            f"wrong{_unit_hint(ratio)}"
        ]
    strongest = int(np.argmax([step[:, axis].std() for axis in moved]))
    if min(alike) > -_ALIKE and alike[strongest] > 0.7 and min(alike) > _UNLIKE and _SCALE[0] < ratio < _SCALE[1]:
        return []
    evidence = ", ".join(f"{'xyz'[axis]} {value:+.2f}" for axis, value in zip(moved, alike, strict=True))
    guess = _still({"the rate": rates}, moved, "xyz") or _attitude_guess(declared, rotation, rates, dt, reach)
    return [
        f"columns {attitude} and {names}: the attitude does not turn at the rates (correlation about body axes "
        f"{evidence}){guess}"
    ]


def _attitude_guess(declared: ColumnMap, rotation: Rotation, rates: Floats, dt: float, reach: int) -> str:
    """Which other reading of the attitude, or of the rates, would fit."""
    smooth = mean_over(rates, 2 * reach)
    guesses: list[tuple[str, Rotation]] = [("world-to-body", rotation.inv())]
    if declared.attitude.quaternion:
        original = _undeclared(declared, rotation)
        swapped = np.roll(original, -1 if declared.attitude.scalar_first else 1, axis=1)
        # Taken in the other order, then into NED and FRD as declared.
        guesses.append(("the other order of the quaternion", _redeclared(declared, swapped)))
        guesses.append(("the other order and direction", _redeclared(declared, swapped, inverse=True)))
    found = []
    for text, other in guesses:
        step = (other[: -2 * reach].inv() * other[2 * reach :]).as_rotvec() / (2.0 * reach * dt)
        moved = [axis for axis in range(3) if smooth[:, axis].std() > _STILL_RATE]
        if moved and min(_alike(step[:, axis], smooth[:, axis]) for axis in moved) > 0.7:
            found.append(text)
    if found:
        return "; " + " or ".join(found) + " would fit"
    step = (rotation[: -2 * reach].inv() * rotation[2 * reach :]).as_rotvec() / (2.0 * reach * dt)
    return _best_axes(step, smooth, "rates")


def _frames(declared: ColumnMap) -> tuple[Rotation, Rotation]:
    """Rotation of the declared world into NED, and of FRD into the declared body."""
    return Rotation.from_matrix(WORLD_TO_NED[declared.world]), Rotation.from_matrix(FRD_TO_BODY[declared.body])


def _undeclared(declared: ColumnMap, rotation: Rotation) -> Floats:
    """Quaternions as they stand in the table."""
    world, body = _frames(declared)
    plain = world.inv() * rotation * body.inv()
    if declared.attitude.world_to_body:
        plain = plain.inv()
    return np.asarray(plain.as_quat(scalar_first=declared.attitude.scalar_first))


def _redeclared(declared: ColumnMap, raw: Floats, inverse: bool = False) -> Rotation:
    world, body = _frames(declared)
    plain = Rotation.from_quat(raw, scalar_first=declared.attitude.scalar_first)
    if declared.attitude.world_to_body != inverse:
        plain = plain.inv()
    return world * plain * body


def _thrust(
    declared: ColumnMap, velocity: Floats, rotation: Rotation, force: Floats, motors: Floats, dt: float, reach: int
) -> list[str]:
    """Specific force must point up through the rotors, and grow with them."""
    names = ", ".join((*declared.position.columns, *declared.attitude.columns))
    acceleration = slopes(velocity, dt, reach)
    inside = rotation[reach:-reach]
    mean = force.mean(axis=0)
    size = float(np.linalg.norm(mean))
    if mean[2] > -0.7 * max(size, 1e-9):
        down = inside.apply(acceleration + np.array([0.0, 0.0, STANDARD_GRAVITY]), inverse=True).mean(axis=0)
        flipped = "; the world's z axis the other way would fit (frame: world)" if down[2] < -5.0 else ""
        return [
            f"columns {names}: the rotors would push along ({mean[0]:+.1f}, {mean[1]:+.1f}, {mean[2]:+.1f}) m/s^2 in "
            f"the body (forward, right, down), not up: frame or quaternion are declared wrong{flipped}"
        ]
    lean = inside.apply(np.array([0.0, 0.0, -STANDARD_GRAVITY]))[:, :2]
    level = acceleration[:, :2]
    moved = [axis for axis in range(2) if level[:, axis].std() > _STILL_FORCE and lean[:, axis].std() > _STILL_FORCE]
    values = {axis: _alike(level[:, axis], lean[:, axis]) for axis in moved}
    if values and min(values.values()) < -_UNLIKE:
        evidence = ", ".join(f"{'NE'[axis]} {value:+.2f}" for axis, value in values.items())
        return [
            f"columns {names}: the craft speeds up against its lean (correlation {evidence}): the world's or the "
            "body's frame, or the direction of the attitude, is declared wrong"
        ]
    if len(values) == 2 and max(values.values()) < _UNLIKE:
        crossed = min(abs(_alike(level[:, 0], lean[:, 1])), abs(_alike(level[:, 1], lean[:, 0])))
        if crossed > _ALIKE:
            return [f"columns {names}: the craft speeds up across its lean: the heading of the world's frame is wrong"]
        sizes = _alike(np.linalg.norm(level, axis=1), np.linalg.norm(lean, axis=1))
        if sizes > _ALIKE:
            return [
                f"columns {names}: the craft speeds up as much as it leans (correlation {sizes:+.2f}), but not where "
                f"it leans (N {values[0]:+.2f}, E {values[1]:+.2f}): the heading is wrong; is the yaw in another unit?"
            ]
    for axis, value in values.items():
        speeding = value * _ratio(level[:, axis], lean[:, axis])
        if abs(value) > _ALIKE and not _SPEEDING[0] < speeding < _SPEEDING[1]:
            return [
                f"columns {names}: the craft speeds up {speeding:.3g} times as much as its lean says: a unit of "
                f"position, velocity or time is wrong{_unit_hint(speeding)}"
            ]
    driven = following(-force[:, 2], mean_square(motors, 2 * reach), dt)
    if not driven.unlike:
        return []
    return [
        f"columns {', '.join(declared.motors.columns)}: thrust does not grow with the motors (correlation "
        f"{driven.likeness:+.2f}): are they the motors of this record?"
    ]
