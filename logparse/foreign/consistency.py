"""Whether the columns of a table fit each other: velocity and position, rates and attitude, lean and acceleration.

Each check compares what was declared with what else could have been meant, so that the text can say which.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from core.units import STANDARD_GRAVITY
from logparse.foreign.columns import FRD_TO_BODY, WORLD_TO_NED, ColumnMap

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ResampledMotion:
    """Motion in NED and FRD on a uniform clock, at the rate at which it is checked."""

    position: Floats  #: shape (N, 3), m
    velocity: Floats  #: shape (N, 3), m/s
    rotation: Rotation  #: Body to NED.
    rates: Floats  #: shape (N, 3), rad/s
    motors: Floats  #: shape (N, k), in the order declared
    dt: float  #: s

    def half(self, seconds: float) -> int:
        """Return half of a time in samples, at least one."""
        return max(round(seconds / self.dt / 2.0), 1)

    def acceleration(self, reach: int) -> Floats:
        """Acceleration over 2 * reach samples, m/s^2; shape (N - 2 reach, 3)."""
        return np.asarray((self.velocity[2 * reach :] - self.velocity[: -2 * reach]) / (2.0 * reach * self.dt))

    def specific_force(self, reach: int) -> Floats:
        """Acceleration less gravity in body axes, m/s^2, over 2 * reach samples; shape (N - 2 reach, 3)."""
        pushed = self.acceleration(reach) - np.array([0.0, 0.0, STANDARD_GRAVITY])
        return self.rotation[reach:-reach].apply(pushed, inverse=True)


@dataclass(frozen=True, slots=True)
class Pair:
    """A signal, and what it must be the slope of."""

    what: str  #: ``"velocity"`` or ``"rates"``.
    columns: tuple[str, ...]
    other: tuple[str, ...]  #: Columns of what changes.
    axes: str
    still: float  #: Movement below which there is nothing to compare, in the unit of the signal.
    signal: Floats  #: shape (N, 3)
    change: Callable[[int], Floats]  #: Of the other over so many samples, shape (N - width, 3).
    dt: float

    def over(self, width: int) -> tuple[Floats, Floats]:
        """Return the slope and the mean of the signal over so many samples, shape (N - width, 3)."""
        return self.change(width) / (width * self.dt), mean_over(self.signal, width)

    def moved(self, slope: Floats, signal: Floats) -> list[int]:
        """Return the axes along which either moves."""
        return [k for k in range(3) if max(slope[:, k].std(), signal[:, k].std()) > self.still]


def pairs_of(declared: ColumnMap, motion: ResampledMotion) -> list[Pair]:
    """Return velocity beside position and rates beside attitude, where both are logged."""
    position, rotation = motion.position, motion.rotation

    def moved(width: int) -> Floats:
        return np.asarray(position[width:] - position[:-width])

    def turning(width: int) -> Floats:
        return turned(rotation, width)

    found, dt = [], motion.dt
    if (late := declared.velocity) is not None:
        found.append(Pair("velocity", late.columns, declared.position.columns, "NED", 0.05, motion.velocity, moved, dt))
    if (late := declared.rates) is not None:
        found.append(Pair("rates", late.columns, declared.attitude.columns, "xyz", 0.05, motion.rates, turning, dt))
    return found


def turned(rotation: Rotation, width: int) -> Floats:
    """Return the turns over so many samples in body axes, rad; shape (N - width, 3)."""
    return np.asarray((rotation[:-width].inv() * rotation[width:]).as_rotvec())


def mean_over(values: Floats, width: int) -> Floats:
    """Average columns, shape (N, k), over `width` samples from each on; shape (N - width, k)."""
    total = np.cumsum(np.vstack([np.zeros((1, values.shape[1])), 0.5 * (values[1:] + values[:-1])]), axis=0)
    return np.asarray((total[width:] - total[:-width]) / width)


def alike(a: Floats, b: Floats) -> float:
    """Return the correlation of signals, or of the columns of two together; zero where one does not move."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    norm = float(np.sqrt(np.sum(a**2) * np.sum(b**2)))
    return float(np.sum(a * b)) / norm if norm > 0.0 else 0.0


def ratio(of: Floats, by: Floats) -> float:
    """Return how many times `of` is as large as `by`, by least squares through both."""
    return float(np.sqrt(np.sum((of - of.mean(axis=0)) ** 2) / max(float(np.sum((by - by.mean(axis=0)) ** 2)), 1e-300)))


#: Correlation that signals of one motion have, what is too little to be one motion, and what a guess needs.
_ALIKE, _UNLIKE, _GUESSED = 0.5, 0.2, 0.7

#: How many times as large as the derivative of the other a signal may be; noise and filters make some tenths.
_SCALE = (0.6, 1.6)

#: The same of a single axis, which may be noisier, and the correlation from which on it is believed.
_ODD, _CLEAR = 2.5, 0.8

#: How many times as fast as its lean says a craft may speed up, by regression: drag takes some, units much more.
_SPEEDING = (0.25, 2.0)

#: Movement below which accelerations have nothing to go by, m/s^2.
_STILL_FORCE = 0.3

#: Factors by which units are mistaken for each other.
_UNITS = {1000.0: "mm for m", 100.0: "cm for m", 57.3: "deg for rad", 3.6: "km/h for m/s"}


def contradiction(pair: Pair, declared: ColumnMap, motion: ResampledMotion, reach: int) -> str:
    """Explain that a signal is not the slope that it must be, over 2 * reach samples; empty where it is."""
    slope, signal = pair.over(2 * reach)
    moved = pair.moved(slope, signal)
    if not moved or (pair.what == "velocity" and not np.ptp(motion.position, axis=0).any()):
        return ""
    likeness = [alike(slope[:, axis], signal[:, axis]) for axis in moved]
    ratios = [ratio(signal[:, axis], slope[:, axis]) for axis in moved]
    usual = float(np.median(ratios))
    names, other = ", ".join(pair.columns), ", ".join(pair.other)
    in_scale = _SCALE[0] < usual < _SCALE[1]
    if min(likeness) > _ALIKE and in_scale:
        for each, clear, axis in zip(ratios, likeness, moved, strict=True):
            if clear > _CLEAR and not 1.0 / _ODD < each < _ODD:
                return (
                    f"columns {names}: {pair.what} fit the changes of {other}, but {each:.3g} times along "
                    f"{pair.axes[axis]}: the unit of one column is wrong{unit_hint(each)}"
                )
        return ""
    if min(likeness) > _ALIKE:
        return (
            f"columns {names}: {pair.what} are {usual:.3g} times the changes of {other} in time: a unit is "
            f"wrong{unit_hint(usual)}"
        )
    strongest = int(np.argmax([slope[:, axis].std() for axis in moved]))
    if pair.what == "rates" and in_scale and likeness[strongest] > _GUESSED and min(likeness) > _UNLIKE:
        return ""
    evidence = ", ".join(f"{pair.axes[axis]} {value:+.2f}" for axis, value in zip(moved, likeness, strict=True))
    guess = _standing_still(pair, motion, moved) or (
        _body_axes(declared, motion, slope, signal, moved, reach)
        if pair.what == "velocity"
        else _other_attitude(declared, motion, reach)
    )
    return (
        f"columns {names} and {other}: {pair.what} are not the changes of the other in time (correlation {evidence})"
        f"{guess or _best_axes(slope, signal, pair.what)}"
    )


def unit_hint(factor: float) -> str:
    """Name units that would be mistaken for each other by a factor; empty where none would."""
    for known, text in _UNITS.items():
        if min(abs(np.log(factor / known)), abs(np.log(factor * known))) < 0.15:
            return f" ({text}?)"
    return ""


def _standing_still(pair: Pair, motion: ResampledMotion, moved: list[int]) -> str:
    """Name what stands still along an axis on which the other moves; empty where nothing does."""
    parts = {pair.what: pair.signal} | ({"position": motion.position} if pair.what == "velocity" else {})
    return "".join(
        f"; {name} stand still along {pair.axes[axis]}"
        for name, part in parts.items()
        for axis in moved
        if not np.ptp(part[:, axis])
    )


def _body_axes(
    declared: ColumnMap, motion: ResampledMotion, slope: Floats, signal: Floats, moved: list[int], reach: int
) -> str:
    """Return whether velocity would fit in body axes."""
    if declared.velocity is None or declared.velocity.body:
        return ""
    inside = motion.rotation[reach:-reach].apply(signal)
    fits = min(alike(slope[:, axis], inside[:, axis]) for axis in moved) > _CLEAR
    return "; in body axes it would fit (axes: body)" if fits else ""


def _best_axes(truth: Floats, signal: Floats, what: str) -> str:
    """Return which order and signs of the axes would fit; empty if none does."""
    best, score = "", _GUESSED
    for order in itertools.permutations(range(3)):
        values = [alike(truth[:, axis], signal[:, order[axis]]) for axis in range(3)]
        known = [abs(value) for value in values if value]
        if known and min(known) > score:
            score = min(known)
            signs = ", ".join(f"{'-' if value < 0 else ''}{'xyz'[order[axis]]}" for axis, value in enumerate(values))
            best = f"; {what} as ({signs}) would fit"
    return best


def _other_attitude(declared: ColumnMap, motion: ResampledMotion, reach: int) -> str:
    """Return which other reading of the attitude would turn at the rates."""
    signal = declared.attitude
    readings = {"world-to-body": motion.rotation.inv()}
    if signal.quaternion:
        world = Rotation.from_matrix(WORLD_TO_NED[declared.world])
        body = Rotation.from_matrix(FRD_TO_BODY[declared.body])
        plain = world.inv() * motion.rotation * body.inv()
        original = (plain.inv() if signal.world_to_body else plain).as_quat(scalar_first=signal.scalar_first)
        swapped = Rotation.from_quat(
            np.roll(original, -1 if signal.scalar_first else 1, axis=1), scalar_first=signal.scalar_first
        )
        readings["the other order of the quaternion"] = (
            world * (swapped.inv() if signal.world_to_body else swapped) * body
        )
        readings["the other order and direction"] = world * (swapped if signal.world_to_body else swapped.inv()) * body
    smooth = mean_over(motion.rates, 2 * reach)
    moved = [axis for axis in range(3) if smooth[:, axis].std() > 0.05]
    found = [
        text
        for text, other in readings.items()
        if moved
        and min(alike(step[:, axis], smooth[:, axis]) for step in (turned(other, 2 * reach),) for axis in moved)
        > _GUESSED
    ]
    return "; " + " or ".join(found) + " would fit" if found else ""


def wrong_frame(declared: ColumnMap, motion: ResampledMotion, reach: int) -> str:
    """Explain that specific force does not point up through the rotors, or the craft not speed up where it leans."""
    names = ", ".join((*declared.position.columns, *declared.attitude.columns))
    mean = motion.specific_force(reach).mean(axis=0)
    acceleration, inside = motion.acceleration(reach), motion.rotation[reach:-reach]
    if mean[2] > -0.7 * max(float(np.linalg.norm(mean)), 1e-9):
        down = inside.apply(acceleration + np.array([0.0, 0.0, STANDARD_GRAVITY]), inverse=True).mean(axis=0)
        flipped = "; the world's z axis the other way would fit (frame: world)" if down[2] < -5.0 else ""
        return (
            f"columns {names}: the rotors would push along ({mean[0]:+.1f}, {mean[1]:+.1f}, {mean[2]:+.1f}) m/s^2 in "
            f"the body (forward, right, down), not up: frame or quaternion are declared wrong{flipped}"
        )
    lean, level = inside.apply(np.array([0.0, 0.0, -STANDARD_GRAVITY]))[:, :2], acceleration[:, :2]
    moved = [axis for axis in range(2) if min(level[:, axis].std(), lean[:, axis].std()) > _STILL_FORCE]
    values = {axis: alike(level[:, axis], lean[:, axis]) for axis in moved}
    text = _heading(values, level, lean)
    for axis, value in values.items():
        speeding = value * ratio(level[:, axis], lean[:, axis])
        if not text and abs(value) > _ALIKE and not _SPEEDING[0] < speeding < _SPEEDING[1]:
            text = (
                f"the craft speeds up {speeding:.3g} times as much as its lean says: a unit of position, velocity or "
                f"time is wrong{unit_hint(speeding)}"
            )
    return f"columns {names}: {text}" if text else ""


def _heading(values: Mapping[int, float], level: Floats, lean: Floats) -> str:
    """Explain that a craft speeds up elsewhere than where it leans."""
    evidence = ", ".join(f"{'NE'[axis]} {value:+.2f}" for axis, value in values.items())
    if values and min(values.values()) < -_UNLIKE:
        return (
            f"the craft speeds up against its lean (correlation {evidence}): the world's or the body's frame, or the "
            "direction of the attitude, is declared wrong"
        )
    if len(values) < 2 or max(values.values()) >= _UNLIKE:
        return ""
    if min(abs(alike(level[:, 0], lean[:, 1])), abs(alike(level[:, 1], lean[:, 0]))) > _ALIKE:
        return "the craft speeds up across its lean: the heading of the world's frame is wrong"
    sizes = alike(np.linalg.norm(level, axis=1), np.linalg.norm(lean, axis=1))
    if sizes > _ALIKE:
        return (
            f"the craft speeds up as much as it leans (correlation {sizes:+.2f}), but not where it leans ({evidence}): "
            "the heading is wrong; is the yaw in another unit?"
        )
    return ""
