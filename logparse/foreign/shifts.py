"""Whether the columns of a table share one clock, and whether it runs in seconds.

Velocity is held against position, rates against attitude, lean against acceleration. Recorders stamp what arrives late
as if it were new. A shift of some hundredths of a second is no contradiction that a correlation shows, yet it turns a
damped mode into an undamped one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from core.findings import Finding
from core.units import STANDARD_GRAVITY
from logparse.foreign.columns import ColumnMap
from logparse.foreign.consistency import Pair, ResampledMotion, alike, ratio
from logparse.foreign.files import table_finding

Floats = npt.NDArray[np.float64]

#: Largest shift that is looked for, and the smallest that is told, s; below one sample nothing is.
_FARTHEST, _LEAST = 0.5, 0.015

#: Parts of a record that must agree on a shift, and how many of their own standard errors it must have.
_PARTS, _SURE = 4, 4.0

#: Part of a signal's variance that the other explains at the best shift, and how much more is left without a shift.
_EXPLAINED, _WORSE = 0.6, 1.02

#: Times [s] over which position and attitude are compared with what velocity and rates add up to, the correlation that
#: they need, and the part by which both must lie to one side. Of 18 flights of others none has both beyond 2.5 %,
#: although velocities were up to 8 %, and rates up to 8 %, from what moved.
_LEGS, _FOLLOWS, _STRETCHED = {"velocity": 0.5, "rates": 0.2}, 0.98, 0.05


@dataclass(frozen=True, slots=True)
class Shift:
    """How much later one signal stands in the table than another that it should equal."""

    seconds: float
    sigma: float
    #: Variance left without the shift over that left with it.
    gain: float


def check_shifts(declared: ColumnMap, motion: ResampledMotion, pairs: Sequence[Pair]) -> list[Finding]:
    """Name the columns that stand later or earlier in the table than others of the same motion."""
    findings: list[Finding] = []
    for pair in pairs:
        findings += _late(pair.columns, pair.other, find_shift(*pair.over(2), pair.dt), pair.dt)
    # Elevons and other surfaces push sideways as they turn the craft, which looks like a shift.
    if not findings and not declared.inputs:
        # Thrust along the rotors' axis over its vertical part, which holds the weight and what climbs.
        acceleration = np.gradient(motion.velocity, motion.dt, axis=0)
        axis = motion.rotation.apply(np.array([0.0, 0.0, -1.0]))
        lean = (STANDARD_GRAVITY - acceleration[:, 2:]) * axis[:, :2] / np.maximum(-axis[:, 2:], 0.2)
        late = find_shift(acceleration[:, :2], lean, motion.dt, beside=motion.velocity[:, :2])
        findings += _late(declared.attitude.columns, declared.position.columns, late, motion.dt)
    return findings


def check_clock(declared: ColumnMap, motion: ResampledMotion, pairs: Sequence[Pair]) -> list[Finding]:
    """Name a time column that runs too fast or too slow: what velocity and rates add up to is then off alike."""
    widths = [max(round(_LEGS[pair.what] / pair.dt), 1) for pair in pairs]
    if len(pairs) < 2 or len(motion.position) < 4 * max(widths):
        return []
    slopes = [pair.over(width) for pair, width in zip(pairs, widths, strict=True)]
    if min(alike(*slope) for slope in slopes) < _FOLLOWS:
        return []
    stretch = np.array([ratio(signal, slope) for slope, signal in slopes])
    if not (stretch > 1.0 + _STRETCHED).all() and not (stretch < 1.0 - _STRETCHED).all():
        return []
    name = "rate" if declared.time is None else declared.time.columns[0]
    text = (
        f"velocities add up to {stretch[0]:.2f} and rates to {stretch[1]:.2f} times what positions and attitudes do: "
        "time runs too fast or too slow by about as much, or both units are wrong"
    )
    advice = "check the unit and the rate of the time column; gains and damping of models err by as much"
    return [table_finding(name, text, advice, velocity=float(stretch[0]), rates=float(stretch[1]))]


def find_shift(truth: Floats, signal: Floats, dt: float, beside: Floats | None = None) -> Shift | None:
    """Estimate by how much `signal` is late; None where parts of the record disagree or it does not follow at all.

    Both (N, k); the truth may depend on `beside` without a shift, such as on the velocity that makes drag.
    """
    reach = round(_FARTHEST / dt)
    parts = np.array_split(np.arange(reach, len(truth) - reach), _PARTS)
    if len(parts[0]) < 4 * reach:
        return None
    found = []
    for rows in parts:
        late = np.lib.stride_tricks.sliding_window_view(
            signal[rows[0] - reach : rows[-1] + 1 + reach], len(rows), axis=0
        )
        left = _left(truth[rows], late, None if beside is None else beside[rows])
        at = int(np.argmin(left))
        if not 0 < at < len(left) - 1 or left[at] > 1.0 - _EXPLAINED:
            return None
        bend = left[at - 1] - 2.0 * left[at] + left[at + 1]
        between = 0.5 * (left[at - 1] - left[at + 1]) / bend if bend > 0.0 else 0.0
        found.append(((at - reach + between) * dt, left[reach] / max(left[at], 1e-12)))
    seconds, gains = np.array(found).T
    sigma = float(seconds.std(ddof=1) / np.sqrt(len(seconds)))
    return Shift(float(seconds.mean()), sigma, float(np.median(gains)))


def _left(truth: Floats, signals: Floats, beside: Floats | None) -> Floats:
    """Part of the truth's variance, (S,), that each of the shifted signals leaves, (S, k, N), over all axes."""
    left, total = np.zeros(len(signals)), 0.0
    for axis in range(truth.shape[1]):
        known = [np.ones(len(truth)), np.linspace(-1.0, 1.0, len(truth))]
        base, _ = np.linalg.qr(np.column_stack([*known, beside[:, axis]] if beside is not None else known))
        y, x = truth[:, axis] - base @ (base.T @ truth[:, axis]), signals[:, axis]
        x = x - (x @ base) @ base.T
        squares = float(y @ y)
        left += squares - (x @ y) ** 2 / np.maximum((x**2).sum(axis=1), 1e-300)
        total += squares
    return left / max(total, 1e-300)


def _late(columns: tuple[str, ...], other: tuple[str, ...], shift: Shift | None, dt: float) -> list[Finding]:
    if shift is None or abs(shift.seconds) < max(_LEAST, dt, _SURE * shift.sigma) or shift.gain < _WORSE:
        return []
    way = "later" if shift.seconds > 0.0 else "earlier"
    text = f"they stand {abs(shift.seconds):.3f} ± {shift.sigma:.3f} s {way} in the table than {', '.join(other)}"
    advice = "export both on one clock, or shift one of them by this time; delays and damping of models err by as much"
    return [table_finding(", ".join(columns), text, advice, seconds=shift.seconds, sigma=shift.sigma)]
