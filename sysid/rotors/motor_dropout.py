"""When a motor gives less thrust for moments only, as with a dry solder joint or a loose plug.

Outputs and motion are those of `sysid.rotors.motor_loss`: a craft whose motor j gives less for a moment has, in that
moment, a residual of all three moments that is the part x of what motor j was asked to give. A lasting loss is found
by one step in time; here windows of a third of a second to two seconds are compared with all others of their length,
whose spread (by the median of absolute deviations) holds gusts and what the model leaves out. Three things together
make a dropout, and each alone does not: the residual points along one motor's own column of the mixer and not elsewhere
as a gust does; that motor's command rises, because the controller asks more of it; and it ends, by itself. Tails of the
spread are heavier than normal, and how much so the flight itself tells: no motor can give *more* than it is asked for,
so the surest window that says so is chance (or lag in a hard manoeuvre), and a dropout must stand out above it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from logparse import Tables, Vehicle
from sysid.records.experiment import Floats
from sysid.rotors.motor_loss import Moments

#: Lengths of windows, s.
_LENGTHS = (0.3, 0.5, 0.8, 1.2, 2.0)
#: Least loss of thrust in a window, and its size in standard deviations.
_SMALLEST, _SURE = 0.25, 7.0
#: The same for a dropout that stands alone: once is chance, twice a pattern, unless it is plain.
_PLAIN, _SURER = 0.3, 10.0
#: Score over that of the surest window of the wrong sign, for one dropout of several and for one alone.
_ABOVE, _FAR_ABOVE = 1.2, 1.5
#: Part of the residual of all moments that one motor must explain, and that no other may reach beside it.
_ONE_MOTOR, _ALIKE = 0.8, 0.85
#: Command in the window over that of the seconds around it.
_RISE, _USUAL = 1.12, 6.0
#: Part of the loss that may be left after a window: else it lasts, and is no dropout.
_RECOVERED = 0.5
#: Time within which dropouts are one, s.
_JOIN = 0.6

#: Change of the attitude asked for [rad] within this time of a sample [s] that is a manoeuvre.
_STEP, _BEFORE = float(np.radians(15.0)), 0.4

Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Dropout:
    """A moment in which a motor gave less."""

    t: float  #: Begin, s.
    end: float  #: s
    loss: float  #: Part of the thrust that was missing.
    score: float  #: Loss over its standard deviation.

    @property
    def sigma(self) -> float:
        """Standard deviation of the loss."""
        return self.loss / self.score


@dataclass(frozen=True, slots=True, kw_only=True)
class MotorDropouts:
    """Moments in which one motor gave less thrust than it was asked for."""

    motor: int  #: Number in the autopilot's frame.
    dropouts: tuple[Dropout, ...]  #: In the order of time.

    @property
    def worst(self) -> Dropout:
        """The largest of them."""
        return max(self.dropouts, key=lambda one: one.loss)


def find_motor_dropouts(moments: Moments | None, tables: Tables, vehicle: Vehicle) -> tuple[MotorDropouts, ...]:
    """Find motors that give less thrust for moments.

    Parameters
    ----------
    moments : Moments or None
        Of `read_moments`, up to a crash and a lasting loss.
    tables : Tables
        With what was asked of the attitude, where that is known.
    vehicle : Vehicle
        Whose frame is known.

    Returns
    -------
    tuple of MotorDropouts
        In the order of the motors' first dropouts; empty where there are none.
    """
    if moments is None:
        return ()
    residuals = [_left(moments, axis) for axis in range(len(moments.factors))]
    candidates, chance = _candidates(moments, residuals, _steady(tables, moments.t))
    found: dict[int, list[Dropout]] = {}
    for column, dropout in _apart(candidates):
        if dropout.score >= _ABOVE * chance:
            found.setdefault(column, []).append(dropout)
    named = [
        MotorDropouts(motor=vehicle.motors[column].number, dropouts=tuple(sorted(those, key=lambda one: one.t)))
        for column, those in found.items()
        if len(those) > 1 or (those[0].loss >= _PLAIN and those[0].score >= max(_SURER, _FAR_ABOVE * chance))
    ]
    return tuple(sorted(named, key=lambda one: one.dropouts[0].t))


def _left(moments: Moments, axis: int) -> Floats:
    """Moment that motion, drift and the motors' lag do not explain."""
    moment = moments.thrust @ moments.factors[axis]
    lag = np.gradient(moment, moments.t)
    basis = np.linalg.qr(np.column_stack([moments.nuisances[axis], lag]))[0]
    return np.asarray(moment - basis @ (basis.T @ moment))


def _steady(tables: Tables, t: Floats) -> Flags:
    """Return where no new attitude was asked for: a step of the sticks drives motors faster than outputs are logged."""
    if tables.setpoints is None:
        return np.ones(len(t), dtype=bool)
    asked = tables.setpoints[["roll", "pitch"]].dropna()
    at = asked.index.to_numpy(np.float64)
    first, last = np.searchsorted(at, t - _BEFORE), np.searchsorted(at, t + _BEFORE)
    if not len(at):
        return np.ones(len(t), dtype=bool)
    # One row more, so that a stretch may end with the last one.
    angles, edges = np.pad(asked.to_numpy(np.float64), ((0, 1), (0, 0))), np.column_stack([first, last]).ravel()
    highest, lowest = (reduce.reduceat(angles, edges)[::2] for reduce in (np.maximum, np.minimum))
    return np.asarray((first >= last) | np.all(highest - lowest < _STEP, axis=1))


def _candidates(
    moments: Moments, residuals: Sequence[Floats], steady: Flags
) -> tuple[list[tuple[int, Dropout]], float]:
    """List all windows in which a motor gave less, with its column, and the best score of one that gave more."""
    t, step = moments.t, float(np.median(np.diff(moments.t)))
    found: list[tuple[int, Dropout]] = []
    chance = 0.0
    around = np.array([_around(column, t, _USUAL) for column in moments.thrust.T])
    for length in _LENGTHS:
        size = max(round(length / step), 3)
        if len(t) < 10 * size:
            continue
        means = np.array([_rolling(each, size) for each in residuals])
        sigmas = np.array([_spread(each) for each in means])
        asked = np.array([_rolling(column, size) for column in moments.thrust.T])
        usual = around[:, : asked.shape[1]]
        pattern = moments.factors[:, :, None] * asked[None] / sigmas[:, None, None]
        seen = means / sigmas[:, None]
        power = np.maximum(np.sum(pattern**2, axis=0), 1e-12)
        hits = np.sum(pattern * seen[:, None], axis=0)
        loss, score = hits / power, hits / np.sqrt(power)
        even = t[size - 1 :] - t[: len(t) - size + 1] < 1.5 * size * step
        even &= _rolling(steady.astype(float), size) > 1.0 - 0.5 / size
        less = _one_motor(score, seen) & even & (score >= _SURE) & (loss >= _SMALLEST) & (loss <= 1.3)
        more = _one_motor(-score, seen) & even & (loss <= -_SMALLEST)
        less &= asked >= _RISE * usual
        # A motor that gives less looks like its counterpart that gives more: only what is not the former is chance.
        beside = _rolling(np.pad(less.any(axis=0).astype(float), size), 2 * size + 1)[: less.shape[1]] > 0.0
        chance = max(chance, float(np.max(-score[more & ~beside], initial=0.0)))
        for column, row in zip(*np.nonzero(less), strict=True):
            if _recovers(moments, residuals, sigmas, int(column), int(row), size, float(loss[column, row])):
                part, sure = float(min(loss[column, row], 1.0)), float(score[column, row])
                found.append((int(column), Dropout(float(t[row]), float(t[row + size - 1]), part, sure)))
    return found, chance


def _one_motor(score: Floats, seen: Floats) -> Flags:
    """Return where one motor explains what is seen, and no other as well; scores of the wrong sign explain nothing."""
    explained = np.maximum(score, 0.0) ** 2 / np.maximum(np.sum(seen**2, axis=0), 1e-12)
    best = explained.max(axis=0)
    others = np.sort(explained, axis=0)[-2] if len(explained) > 1 else np.zeros(len(best))
    return np.asarray((explained == best) & (best >= _ONE_MOTOR) & (others < _ALIKE * best))


def _recovers(
    moments: Moments, residuals: Sequence[Floats], sigmas: Floats, column: int, row: int, size: int, loss: float
) -> bool:
    """Return whether the motor gives its thrust again within the two seconds after a window."""
    step = float(np.median(np.diff(moments.t)))
    last = min(row + size + round(2.0 / step), len(moments.t) - size)
    for begin in range(row + size, last, max(size // 2, 1)):
        rows = slice(begin, begin + size)
        pattern = moments.factors[:, column] * moments.thrust[rows, column].mean() / sigmas
        seen = np.array([residual[rows].mean() for residual in residuals]) / sigmas
        if float(pattern @ seen) / max(float(pattern @ pattern), 1e-12) < _RECOVERED * loss:
            return True
    return False


def _apart(found: Sequence[tuple[int, Dropout]]) -> list[tuple[int, Dropout]]:
    """Keep the surest of dropouts that overlap."""
    kept: list[tuple[int, Dropout]] = []
    for column, one in sorted(found, key=lambda each: -each[1].score):
        if all(one.t > other.end + _JOIN or one.end < other.t - _JOIN for _, other in kept):
            kept.append((column, one))
    return kept


def _rolling(values: Floats, size: int) -> Floats:
    """Mean of each window of `size` samples."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    return np.asarray((total[size:] - total[:-size]) / size)


def _around(values: Floats, t: Floats, width: float) -> Floats:
    """Median of the seconds around each sample."""
    edges = np.arange(t[0], t[-1] + width, width)
    first, last = np.searchsorted(t, edges[:-1] - width), np.searchsorted(t, edges[1:] + width)
    inside = [values[a:b] for a, b in zip(first.tolist(), last.tolist(), strict=True)]
    medians = [float(np.median(each)) if len(each) else 0.0 for each in inside]
    return np.asarray(np.interp(t, edges[:-1] + 0.5 * width, medians))


def _spread(values: Floats) -> float:
    """Estimate the standard deviation of values about zero from their bulk."""
    return max(1.4826 * float(np.median(np.abs(values))), 1e-9)
