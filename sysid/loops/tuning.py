"""`tune`: gains that reject disturbances best within margins that hold for everything the data leave possible.

The rejection of disturbances, its bandwidth first and then rms attitude under gusts, is made best over P, D, I and the
filters of derivative and gyro, subject to gain margin, phase margin and peak sensitivity at the worst of the 95 % set,
to the noise at the actuators, and to a change of no more than a factor of two. Without the evidence (`evidence`) there
is a reason and no number.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime

import numpy as np
from numpy.typing import NDArray

from logparse import FlightLog, RotoridError
from logparse.summary import Summarised, listed
from sysid.loops.autopilot import read_settings
from sysid.loops.errors import LoopError
from sysid.loops.evidence import (
    RANGES,
    at_their_limits,
    motors_limited,
    oscillation,
    saturation,
    two_ways_apart,
    unfit_log,
    weak_band,
)
from sysid.loops.filters import Complexes, Floats
from sysid.loops.loop import RateLoop, rate_loop
from sysid.loops.margins import MarginSet, margins_of
from sysid.loops.parameter_file import parameter_file, typed
from sysid.loops.same_craft import SUMMED, gain_apart, other_craft
from sysid.loops.settings import AXES, LoopSettings

#: Factors of P and D, of I over P's factor, and of the filters of derivative and gyro that are tried.
_P = np.geomspace(0.501, 1.996, 13)
_D = np.geomspace(0.501, 1.996, 11)
_I = (0.7, 1.0, 1.4)
_FLTD = (1.0, 1.5, 2.0)
_GYRO = (1.0, 1.25, 1.5, 2.0)

#: Candidates whose margins are computed at once, and of how many frequencies one is taken in this first look.
_AT_ONCE, _EVERY = 256, 2

#: Gain of the rejection bandwidth [logarithm] over the flown one that is asked for first, and how much it counts
#: against the answer to gusts [logarithm of rms attitude]; beyond it only that answer counts, so that bandwidth is not
#: bought with a soft loop at low frequency.
_WANTED_GAIN, _BANDWIDTH_WEIGHT = 0.06, 8.0

#: Corner [Hz] of the gusts' spectrum in that.
_GUST_HZ = 1.0

#: Least gain, dB, and phase, deg, that another filter of the gyro may take from an axis whose gains stay.
_BYSTANDER_GAIN, _BYSTANDER_PHASE = 0.5, 3.0

#: Scores that differ by less are one: the gyro filter is not changed for less.
_SAME_SCORE = 0.02

#: Candidates whose worst case is computed, best first.
_CHECKED = 150

#: Part of that loss which the next candidate must have in hand to be looked at.
_SAME_SPARE = 0.8

#: Part of the draws beyond the bound of each margin: so few that gain margin, phase margin, peak and rejection hold
#: together for 95 % of what the data leave possible, and more.
TAIL = 0.005

#: Factor by which a mode of 3 % damping that carries a third of the acceleration stands above the rigid craft.
_MODE = 6.0

#: Factors by which a loop's gain may be raised beyond the measured band, each tried only where the one before leaves no
#: rejection gained, unless the rigid craft keeps it below `_UNSEEN_SMALL` there, which leaves a mode 4 dB. The band is
#: looked at up to this frequency, Hz, in so many steps. Chirps that ended below `_FIRST_MODES` [Hz], where
#: the first modes of frames lie, raise nothing beyond.
_UNSEEN_RAISED, _UNSEEN_SMALL, _UNSEEN_UP_TO, _UNSEEN_STEPS = (1.12, 1.5, 2.0), 0.63 / _MODE, 150.0, 24
_FIRST_MODES = 30.0

#: Horizontal vibration, m/s^2, above which the gyro filter is not opened.
_CALM = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Aim:
    """What a tune must keep, at the worst of the 95 % set.

    `noise` is the largest factor by which rms and slew of the actuators' noise may rise over the flown settings.
    """

    gain_db: float = 6.0
    phase_deg: float = 45.0
    peak_db: float = 6.0
    noise: float = 1.5


#: Aims by name: most rejection, quiet actuators, wide margins.
AIMS: Mapping[str, Aim] = {
    "rejection": Aim(),
    "quiet": Aim(noise=1.0),
    "margins": Aim(gain_db=8.0, phase_deg=55.0, peak_db=5.0),
}


@dataclass(frozen=True, slots=True, eq=False)
class AxisTuning:
    """One axis: what was flown, what is proposed, or why nothing is."""

    axis: str
    refused: str | None
    loop: RateLoop | None = None  #: As flown.
    tuned: RateLoop | None = None  #: With the proposed values.
    worst: Mapping[str, float] = field(default_factory=dict)  #: Bound of each proposed margin that the 95 % set keeps.
    noise: float | None = None  #: Actuator noise over that of the flown settings.
    score: float = -np.inf  #: What was maximised: more is better, 0 as flown.
    #: Factor by which the gain of the loop rises beyond the measured band where it may count.
    unseen: float = 1.0
    wider: bool = False  #: Whether disturbances are rejected up to a higher frequency than as flown.

    @property
    def gains(self) -> bool:
        """Return whether the proposal rejects disturbances better than as flown, by bandwidth and by the score."""
        return self.wider and self.score > 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Tuning(Summarised):
    """Proposed parameters, the way back, and the reasons."""

    logs: tuple[str, ...]
    aim: Aim
    #: By parameter name: exactly as written to the files; empty where refused.
    proposed: dict[str, float]
    rollback: dict[str, float]
    refused: str | None  #: Why nothing is proposed.
    axes: tuple[AxisTuning, ...]
    remarks: tuple[str, ...]
    made: str  #: UTC.

    def proposed_file(self) -> str:
        """Return the text of ``proposed.param``.

        Raises
        ------
        LoopError
            Where nothing is proposed.
        """
        if self.refused is not None:
            raise LoopError(f"nothing is proposed: {self.refused}")
        return parameter_file(self.proposed, (*self._provenance("proposed"), *self._promises()))

    def rollback_file(self) -> str:
        """Return the text of ``rollback.param``: the values as flown.

        Raises
        ------
        LoopError
            Where nothing is proposed.
        """
        if self.refused is not None:
            raise LoopError(f"nothing is proposed: {self.refused}")
        return parameter_file(self.rollback, self._provenance("as flown: load this to go back"))

    def _provenance(self, what: str) -> tuple[str, ...]:
        return (f"rotorid tune: {what}", f"from {', '.join(self.logs)}, made {self.made}")

    def _promises(self) -> tuple[str, ...]:
        lines = []
        for axis in self.axes:
            if axis.tuned is None:
                lines.append(f"{axis.axis}: unchanged: {axis.refused}")
                continue
            bounds = ", ".join(f"{name} {value:.3g}" for name, value in axis.worst.items())
            lines.append(f"{axis.axis}: worst of the 95 % set: {bounds}")
        return (
            *lines,
            *self.remarks,
            "first flight: hover low, be ready to load rollback.param; then `rotorid prove`",
        )

    def summary(self) -> dict[str, str]:
        """Return the logs and what is proposed, or why nothing is."""
        if self.refused is not None:
            return {"logs": listed(self.logs), "refused": self.refused}
        changes = [f"{name} {self.rollback[name]:.4g} → {value:.4g}" for name, value in self.proposed.items()]
        return {"logs": listed(self.logs), "proposed": listed(changes, most=4)}


def tune(logs: FlightLog | Sequence[FlightLog], aim: Aim | str = "rejection") -> Tuning:
    """Propose gains for the axes whose logs support it.

    Parameters
    ----------
    logs : FlightLog or sequence of FlightLog
        Flights of one craft with the same settings and chirps at the mixer.
    aim : Aim or {"rejection", "quiet", "margins"}

    Raises
    ------
    LoopError
        For an aim that there is not.
    """
    if isinstance(aim, str):
        if aim not in AIMS:
            raise LoopError(f"there is no aim {aim!r}; the aims are {', '.join(AIMS)}")
        aim = AIMS[aim]
    flights = [logs] if isinstance(logs, FlightLog) else list(logs)
    names = tuple(log.name for log in flights)
    made = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")

    def refuse(reason: str, axes: tuple[AxisTuning, ...] = ()) -> Tuning:
        return Tuning(names, aim, {}, {}, reason, axes, (), made)

    if not flights:
        return refuse("no log was given")
    for log in flights:
        try:
            read_settings(log, "roll")
            reason = unfit_log(log) or next((r for a in AXES if (r := oscillation(log, a))), None)
        except RotoridError as error:
            reason = str(error)
        reason = reason or other_craft(flights[0], log)
        if reason is not None:
            return refuse(reason)
    found = [_examined(flights, axis) for axis in AXES]
    loops = {item.axis: item.loop for item in found if item.loop is not None and item.refused is None}
    if not loops:
        reasons = list(dict.fromkeys(item.refused for item in found if item.refused))
        return refuse("; ".join(reasons), tuple(found))
    vibration = _vibration(flights)
    known = all(item.loop is not None and weak_band(item.loop) is None for item in found)
    open_gyro = known and vibration is not None and vibration < _CALM
    options = [f for f in _GYRO if f == 1.0 or (open_gyro and _others_keep(found, loops, f))]
    best = {axis: tune_axis(loop, aim) for axis, loop in loops.items()}
    for factor in options[1:]:
        tuned = {axis: tune_axis(loop, aim, factor) for axis, loop in loops.items()}
        if all(item.tuned is not None for item in tuned.values()) and _worth(tuned) > _worth(best):
            best = tuned
    axes = tuple(best.get(item.axis, item) for item in found)
    proposed, rollback = _differences(axes)
    remarks = [remark for item in axes if item.loop is not None for remark in item.loop.flown.remarks]
    remarks += [
        f"{item.axis}: above {item.loop.hz[-1]:.0f} Hz, where no chirp looked for modes of the frame, the gain of the "
        f"loop rises by up to {item.unseen:.1f}; a chirp to a higher SID_F_STOP_HZ, with RATE as fast, would tell"
        for item in axes
        if item.loop is not None and item.unseen > _UNSEEN_RAISED[0]
    ]
    if not open_gyro:
        remarks.append(
            "INS_GYRO_FILTER stays: it serves all axes, so it is changed only where roll, pitch and yaw are identified "
            "and vibration is known to be low"
        )
    if not proposed:
        reasons = [item.refused or f"{item.axis}: the flown gains are the best that were found" for item in axes]
        return refuse("; ".join(dict.fromkeys(reasons)), axes)
    return Tuning(names, aim, proposed, rollback, None, axes, tuple(dict.fromkeys(remarks)), made)


def _worth(tuned: Mapping[str, AxisTuning]) -> tuple[int, int, int, float]:
    """Return what one setting of the gyro filter is worth: axes that gain, little raised unseen, the score in steps."""
    items = tuned.values()
    return (
        sum(item.wider for item in items),
        sum(item.gains for item in items),
        -max(next((k for k, most in enumerate(_UNSEEN_RAISED) if item.unseen <= most), 9) for item in items),
        round(sum(item.score for item in items) / _SAME_SCORE),
    )


def _examined(logs: Sequence[FlightLog], axis: str) -> AxisTuning:
    """Identify an axis and look at the evidence."""
    try:
        loop = rate_loop(logs, axis)
        alone = [rate_loop(log, axis) for log in logs] if len(logs) > 1 else [loop]
    except RotoridError as error:
        return AxisTuning(axis, str(error))
    apart = max(gain_apart(alone[0], other) for other in alone)
    if apart > SUMMED:
        return AxisTuning(
            axis,
            f"{axis} answers {apart:.2f} times as strongly in one flight as in another, at equal input: give flights "
            "of one craft with one load",
            loop,
        )
    reason = (
        at_their_limits(loop)
        or next((r for log in logs if (r := saturation(log, axis) or motors_limited(log, loop))), None)
        or weak_band(loop)
        or two_ways_apart(loop)
    )
    return AxisTuning(axis, reason, loop)


def _others_keep(found: Sequence[AxisTuning], loops: Mapping[str, RateLoop], factor: float) -> bool:
    """Return whether axes whose gains stay keep their margins with another gyro filter."""
    for item in found:
        if item.axis in loops or item.loop is None:
            continue
        flown = margins_of(item.loop.hz, item.loop.response).row(0)
        other = item.loop.with_gains(gyro_filter=_gyro_filter(item.loop, factor))
        new = margins_of(item.loop.hz, other.response).row(0)
        if not new["stable"] or new["phase_deg"] < flown["phase_deg"] - _BYSTANDER_PHASE:
            return False
        if new["gain_db"] < flown["gain_db"] - _BYSTANDER_GAIN:
            return False
    return True


def _gyro_filter(loop: RateLoop, factor: float) -> float:
    flown = loop.flown.gyro.low_pass
    return flown if factor == 1.0 else float(round(flown * factor))


def _vibration(logs: Sequence[FlightLog]) -> float | None:
    """Return the largest median of horizontal vibration, m/s^2; None where it is not logged."""
    levels = []
    for log in logs:
        if "VIBE" not in log.messages:
            return None
        frame = log.messages["VIBE"]
        if not {"VibeX", "VibeY"} <= set(frame.columns) or not len(frame):
            return None
        levels += [float(np.nanmedian(frame[name].to_numpy(np.float64))) for name in ("VibeX", "VibeY")]
    return max(levels) if levels and np.all(np.isfinite(levels)) else None


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """Candidates of an axis at one setting of the gyro filter, with what needs no draws; all of shape (K,)."""

    bare: LoopSettings
    values: tuple[Mapping[str, float], ...]
    nominal: MarginSet
    gained: Floats  #: Logarithm of the rejection bandwidth over the flown one.
    score: Floats
    unseen: Floats  #: Factor by which the gain rises beyond the measured band where it may count.


def tune_axis(loop: RateLoop, aim: Aim, gyro_factor: float = 1.0) -> AxisTuning:
    """Search one axis at one setting of the gyro filter; refused where no candidate keeps the aim.

    Gains that raise the loop where nothing was measured are tried only where others reject no more than as flown.

    Parameters
    ----------
    loop : RateLoop
    aim : Aim
    gyro_factor : float
        Of INS_GYRO_FILTER.
    """
    candidates = _field(loop, gyro_factor)
    if loop.hz[-1] < _FIRST_MODES:
        return _best(loop, aim, candidates, 1.0)
    best = _best(loop, aim, candidates, _UNSEEN_RAISED[0])
    for most in _UNSEEN_RAISED[1:]:
        if best.gains:
            break
        found = _best(loop, aim, candidates, most)
        if found.tuned is not None and (found.wider, found.score) > (best.wider, best.score):
            best = found
    return best


def _promised(tuned: RateLoop, bounds: Mapping[str, float], aim: Aim) -> dict[str, float]:
    """Return bounds that a mode just beyond the measured band does not break either: of what is kept, not more."""
    beyond = _MODE * float(np.abs(tuned.response[-1]))
    promised = dict(bounds)
    promised["gain_db"] = min(bounds["gain_db"], max(aim.gain_db, -20.0 * np.log10(beyond)))
    if beyond > 1.0:
        promised["phase_deg"] = min(bounds["phase_deg"], aim.phase_deg)
    return promised


def _field(loop: RateLoop, gyro_factor: float) -> _Field:
    """Lay out the candidates of an axis and compute their nominal margins."""
    flown = loop.flown.controller
    ranges = RANGES[loop.axis]
    candidates = []
    for p, d, i, fltd in itertools.product(
        _P, _D if flown.D > 0.0 else (1.0,), _I, _FLTD if flown.FLTD > 0.0 else (1.0,)
    ):
        values = {
            "P": typed(flown.P * p),
            "I": typed(flown.I * min(max(p * i, _P[0]), _P[-1])),
            "D": typed(flown.D * d),
            "FLTD": typed(flown.FLTD * fltd),
        }
        if all(_within(values[name], getattr(flown, name), ranges[name]) for name in ranges):
            candidates.append(values)
    hz = loop.hz[::_EVERY]
    bare = loop.flown.changed(gyro_filter=_gyro_filter(loop, gyro_factor))
    through = (loop.with_settings(bare).gyro_change * loop.plant.response)[::_EVERY]
    true_plant = through / bare.gyro.response(hz)
    feedbacks, beyond = _Feedbacks(bare, hz), _Unseen(loop, bare)
    rows = []
    gusts, unseen = np.empty(len(candidates)), np.empty(len(candidates))
    for first in range(0, len(candidates), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        broken = through * feedbacks.of(candidates[some])
        rows.append(margins_of(hz, broken))
        gusts[some] = _gust_response(hz, true_plant, broken)
        unseen[some] = beyond.raised(candidates[some])
    nominal = _stack(rows)
    flown_loop = (loop.with_settings(loop.flown).response)[::_EVERY][None, :]
    flown_rejection = margins_of(hz, flown_loop).rejection_hz[0]
    flown_gust = _gust_response(hz, loop.plant.response[::_EVERY] / loop.flown.gyro.response(hz), flown_loop)[0]
    with np.errstate(invalid="ignore"):
        gained = np.log(nominal.rejection_hz / (flown_rejection if np.isfinite(flown_rejection) else hz[0]))
        score = _BANDWIDTH_WEIGHT * np.minimum(gained, _WANTED_GAIN) - np.log(gusts / flown_gust)
    return _Field(bare, tuple(candidates), nominal, np.asarray(gained), np.asarray(score), unseen)


def _best(loop: RateLoop, aim: Aim, field: _Field, unseen: float) -> AxisTuning:
    """Return the candidate of the best score that keeps the aim at its worst, or why there is none."""
    nominal, score = field.nominal, field.score
    good = (field.unseen <= unseen) & nominal.stable & _keeps(nominal, aim) & np.isfinite(nominal.rejection_hz)
    order = np.flatnonzero(good)[np.argsort(-score[good], kind="stable")]
    noise_flown = _actuator_noise(loop.with_settings(loop.flown))
    # How far below its nominal margins a candidate's worst case lay: those with less in hand need no look.
    spare = {"gain_db": 0.0, "phase_deg": 0.0, "peak_db": 0.0}
    checked = 0
    for k in order:
        if not _in_hand(nominal, int(k), aim, spare):
            continue
        tuned = loop.with_settings(field.bare.changed(**field.values[k]))
        noise = max(_actuator_noise(tuned) / noise_flown)
        if noise > aim.noise:
            continue
        checked += 1
        if checked > _CHECKED:
            break
        bounds = worst_case(tuned)
        if bounds is None:
            continue
        if _bounds_keep(bounds, aim):
            return AxisTuning(
                axis=loop.axis,
                refused=None,
                loop=loop,
                tuned=tuned,
                worst=_promised(tuned, bounds, aim),
                noise=float(noise),
                score=float(score[k]),
                unseen=float(field.unseen[k]),
                wider=bool(field.gained[k] > 0.0),
            )
        for name in spare:
            short = abs(bounds[name] - float(getattr(nominal, name)[k]))
            if np.isfinite(short):
                spare[name] = max(spare[name], _SAME_SPARE * short)
    return AxisTuning(
        loop.axis,
        f"{loop.axis}: no gains within a factor of two keep {aim.gain_db:g} dB, {aim.phase_deg:g} deg and a peak of "
        f"{aim.peak_db:g} dB for everything that the data leave possible",
        loop,
    )


class _Feedbacks:
    """Feedback of many candidates: linear in P, I and D, with a filter of the derivative that takes few values."""

    def __init__(self, settings: LoopSettings, hz: Floats) -> None:
        self._settings, self._hz = settings, hz
        self._without = self._feedback()
        self._p, self._i = self._feedback(P=1.0) - self._without, self._feedback(I=1.0) - self._without
        self._d: dict[float, Complexes] = {}

    def of(self, candidates: Sequence[Mapping[str, float]]) -> Complexes:
        """Compute the feedback of each candidate, shape (K, n)."""
        p, i, d = (np.array([each[name] for each in candidates])[:, None] for name in ("P", "I", "D"))
        derivative = np.stack([self._derivative(each["FLTD"]) for each in candidates])
        return np.asarray(self._without + p * self._p + i * self._i + d * derivative)

    def _derivative(self, corner: float) -> Complexes:
        if corner not in self._d:
            self._d[corner] = self._feedback(D=1.0, FLTD=corner) - self._without
        return self._d[corner]

    def _feedback(self, **values: float) -> Complexes:
        return self._settings.changed(**({"P": 0.0, "I": 0.0, "D": 0.0} | values)).feedback(self._hz)


class _Unseen:
    """The loop beyond the measured band, as the rigid craft would continue it: modes of the frame may stand above."""

    def __init__(self, loop: RateLoop, settings: LoopSettings) -> None:
        end = loop.hz[-1:]
        self._hz = np.geomspace(end[0], max(_UNSEEN_UP_TO, 1.1 * end[0]), _UNSEEN_STEPS)
        self._feedbacks = _Feedbacks(settings, self._hz)
        self._gyro = np.abs(settings.gyro.response(self._hz))
        self._flown = np.abs(loop.flown.feedback(self._hz) * loop.flown.gyro.response(self._hz))
        craft = np.abs(loop.plant.response[-1:] / loop.flown.gyro.response(end))
        self._craft = craft * end / self._hz  # it integrates; lags only lower it

    def raised(self, candidates: Sequence[Mapping[str, float]]) -> Floats:
        """Return the largest factor by which each raises it where it may count, shape (K,); 1 where nowhere."""
        gain = np.abs(self._feedbacks.of(candidates)) * self._gyro
        factor = np.where(gain * self._craft > _UNSEEN_SMALL, gain / self._flown, 1.0)
        return np.asarray(np.maximum(factor.max(axis=1), 1.0))


def _within(value: float, flown: float, span: tuple[float, float]) -> bool:
    """Return whether a gain lies in its documented range, or no farther outside than the flown one."""
    return flown == 0.0 or min(span[0], flown) <= value <= max(span[1], flown)


def _gust_response(hz: Floats, plant: Complexes, broken: Complexes) -> Floats:
    """Compute rms attitude under gusts, to a common factor, shape (K,)."""
    spectrum = plant / (2j * np.pi * hz) / (1.0 + 1j * hz / _GUST_HZ)
    return np.asarray(np.sqrt(np.sum(np.abs(spectrum / (1.0 + broken)) ** 2 * np.gradient(hz), axis=1)))


def _in_hand(nominal: MarginSet, k: int, aim: Aim, spare: Mapping[str, float]) -> bool:
    """Return whether a candidate's nominal margins leave what others lost in their worst case."""
    gain = float(nominal.gain_db[k])
    return (
        (not np.isfinite(gain) or gain >= aim.gain_db + spare["gain_db"])
        and float(nominal.phase_deg[k]) >= aim.phase_deg + spare["phase_deg"]
        and float(nominal.peak_db[k]) <= aim.peak_db - spare["peak_db"]
    )


def worst_case(loop: RateLoop) -> dict[str, float] | None:
    """Return the bound of each margin that the 95 % set keeps; None where a draw is unstable.

    A gain margin that the band does not show is bounded by the gain at the band's end.
    """
    draws = margins_of(loop.hz, loop.draws)
    if not draws.stable.all():
        return None
    at_end = -20.0 * np.log10(np.abs(loop.draws[:, -1]))
    gain = np.where(np.isfinite(draws.gain_db), draws.gain_db, at_end)
    phase = np.where(np.isfinite(draws.phase_deg), draws.phase_deg, 0.0)
    rejection = np.where(np.isfinite(draws.rejection_hz), draws.rejection_hz, loop.hz[0])
    return {
        "gain_db": float(np.quantile(gain, TAIL)),
        "phase_deg": float(np.quantile(phase, TAIL)),
        "peak_db": float(np.quantile(draws.peak_db, 1.0 - TAIL)),
        "rejection_hz": float(np.quantile(rejection, TAIL)),
    }


def _keeps(margins: MarginSet, aim: Aim) -> NDArray[np.bool_]:
    gain = np.where(np.isfinite(margins.gain_db), margins.gain_db, np.inf)
    return np.asarray(
        (gain >= aim.gain_db) & (margins.phase_deg >= aim.phase_deg) & (margins.peak_db <= aim.peak_db), np.bool_
    )


def _bounds_keep(bounds: Mapping[str, float], aim: Aim) -> bool:
    return (
        bounds["gain_db"] >= aim.gain_db and bounds["phase_deg"] >= aim.phase_deg and bounds["peak_db"] <= aim.peak_db
    )


def _stack(rows: Sequence[MarginSet]) -> MarginSet:
    names = ("gain_db", "phase_deg", "crossover_hz", "rejection_hz", "peak_db", "stable")
    return MarginSet(*(np.concatenate([getattr(row, name) for row in rows]) for name in names))


def _actuator_noise(loop: RateLoop) -> Floats:
    """Compute rms and slew of what white noise of the gyro makes at the mixer, to a common factor, shape (2,).

    From 2 Hz to half the loop rate; beyond the measured band the loop is taken as open.
    """
    settings = loop.settings
    hz = np.linspace(2.0, 0.499 * settings.controller.loop_rate, 400)
    response = settings.controller.error_response(hz) * settings.gyro.response(hz)
    inside = hz <= loop.hz[-1]
    broken = loop.response
    closed = np.ones(len(hz), np.complex128)
    back = np.interp(hz[inside], loop.hz, broken.real) + 1j * np.interp(hz[inside], loop.hz, broken.imag)
    closed[inside] = 1.0 / (1.0 + back)
    power = np.abs(response * closed) ** 2
    return np.asarray(np.sqrt([power.sum(), (power * hz**2).sum()]), np.float64)


def _differences(axes: Sequence[AxisTuning]) -> tuple[dict[str, float], dict[str, float]]:
    """Return the parameters that differ from the flown ones, and their flown values."""
    proposed: dict[str, float] = {}
    rollback: dict[str, float] = {}
    for item in axes:
        if item.tuned is None or item.loop is None:
            continue
        before, after = item.loop.flown.parameters(), item.tuned.settings.parameters()
        for name, value in after.items():
            if np.float32(value) != np.float32(before[name]):
                proposed[name], rollback[name] = value, before[name]
    return proposed, rollback
