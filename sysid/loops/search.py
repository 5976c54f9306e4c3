"""The search for one axis' gains: best rejection of disturbances among those that keep what `safety` asks."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sysid.loops.controller import LoopSettings
from sysid.loops.criteria import Criterion
from sysid.loops.evidence import RANGES
from sysid.loops.filters import Complexes, Floats
from sysid.loops.loop import RateLoop
from sysid.loops.margins import MarginSet, margins_of
from sysid.loops.parameter_file import typed
from sysid.loops.plant import FIRST_MODES
from sysid.loops.safety import LEAST, ActuatorNoise, Aim, other_gyro_filter, worst_case
from sysid.loops.unseen import AMPLIFIED, amplified_at_end, may_raise, promised, raised_unseen, saw_modes

#: Largest factors by which P and D are changed, and by which ordinary flights may raise them; what typing them may add,
#: and steps of P and of D; factors of I over P's, and of the derivative's filter.
LARGEST, LARGEST_OF_STICKS = 2.0, 1.3
_ROUNDING, _STEPS_P, _STEPS_D = 0.004, 13, 11
_I = (0.7, 1.0, 1.4)
_FLTD = (1.0, 1.5, 2.0)

#: I over P of ArduCopter's default gains.
DEFAULT_I: Mapping[str, float] = {"roll": 1.0, "pitch": 1.0, "yaw": 0.1}

#: The same of the filters of target and error and of the feed-forward; highest filter that ArduCopter documents, Hz.
_OTHER_FILTERS, _FF, _HIGHEST_FILTER = (0.7, 1.0, 1.5, 2.0), (0.7, 1.0, 1.4), 100.0

#: Factors of the attitude controller's gain, the highest that ArduCopter documents [1/s], and the phase margin [deg]
#: that the attitude loop keeps: a step of attitude then overshoots by less than 10 %.
_ANGLE, _HIGHEST_ANGLE, _ATTITUDE_PHASE = (1.2, 1.5), 12.0, 60.0

#: Factors of it where no rate gains beside it keep the aim: a slow rate loop bears no fast one about it.
_SLOWER = (0.7, 0.5)

#: Logarithm of bandwidth or answer to gusts that is the rounding of gains that flew.
_ROUNDED = 1e-9

#: Scores that differ by less are one: no other filter is proposed for less.
SAME_SCORE = 0.02

#: Candidates whose margins are computed at once, and of how many frequencies one is taken in this first look.
_AT_ONCE, _EVERY = 256, 2

#: Gain of the rejection bandwidth [logarithm] over the flown one that is asked for first, and how much it counts
#: against the answer to gusts [logarithm of rms attitude]; beyond it only that answer counts, so that bandwidth is not
#: bought with a soft loop at low frequency.
_WANTED_GAIN, _BANDWIDTH_WEIGHT = 0.06, 8.0

#: Part of an aim by which flown gains may miss it without rejection being given up for it: 43 of 45 deg are kept.
_TRIFLE = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class AxisTuning:
    """One axis: what was flown, what is proposed, or why nothing is."""

    axis: str
    refused: str | None
    loop: RateLoop | None = None  #: As flown; where I flew at 0, with the I that is flown otherwise.
    tuned: RateLoop | None = None  #: With the proposed values.
    worst: Mapping[str, float] = field(default_factory=dict)  #: Bound of each proposed margin that the 95 % set keeps.
    noise: float | None = None  #: Actuator noise over that of the flown settings.
    score: float = -np.inf  #: What was maximised: more is better, 0 as flown.
    #: Factor by which the gain of the loop rises beyond the measured band where it may count.
    unseen: float = 1.0
    short: bool = False  #: Whether it is a first step: surely better than as flown, not yet sure to keep the aim.
    criteria: tuple[Criterion, ...] = ()  #: The sheet of the loop as flown, and as proposed; empty without a loop.
    promises: tuple[Criterion, ...] = ()
    wider: bool = False  #: Whether disturbances are rejected up to a higher frequency than as flown.

    @property
    def gains(self) -> bool:
        """Return whether the proposal rejects disturbances better than as flown, by bandwidth and by the score."""
        return self.wider and self.score > _ROUNDED

    @property
    def reason(self) -> str:
        """Why it stays as flown."""
        return (self.refused or "the flown gains are the best that were found").removeprefix(f"{self.axis}: ")

    @property
    def promise(self) -> str:
        """What the proposal keeps of each margin at the worst of the 95 % set."""
        bounds = self.worst
        return (
            f"at the worst gain margin {bounds['gain_db']:.1f} dB, phase margin {bounds['phase_deg']:.0f} deg, "
            f"peak {bounds['peak_db']:.1f} dB; rejects up to {bounds['rejection_hz']:.1f} Hz"
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Field:
    """Candidates of an axis at one setting of the gyro filter, with what needs no draws; all of shape (K,)."""

    bare: LoopSettings
    values: tuple[Mapping[str, float], ...]
    nominal: MarginSet
    gained: Floats  #: Logarithm of the rejection bandwidth over the flown one.
    score: Floats
    unseen: Floats  #: Factor by which the gain rises beyond the measured band where it may count.
    noise: Floats  #: The same wherever it does, with which noise from there rises.
    #: Whether disturbances are amplified little where a low chirp ended, or as flown and nothing is raised beyond.
    ends_well: NDArray[np.bool_]


def without_integral(settings: LoopSettings) -> bool:
    """Return whether I flew at 0, or at the little above it with which the firmware arms."""
    return 0.1 * DEFAULT_I[settings.axis] * settings.controller.P > settings.controller.I


def integral_part(settings: LoopSettings, i_term: float | None) -> float | None:
    """Return I as a part of P where it is not searched: as given, or the firmware's own where I flew at 0."""
    return DEFAULT_I[settings.axis] if i_term is None and without_integral(settings) else i_term


def tune_axis(loop: RateLoop, aim: Aim, gyro_factor: float = 1.0, i_term: float | None = None) -> AxisTuning:
    """Search one axis at one setting of the gyro filter; refused where no candidate keeps the aim.

    I is `i_term` times P where that is given, or where I flew at 0: the loop is then compared with itself with that I.
    One that rejects less is proposed only where the flown gains fall short of the aim: otherwise it would buy nothing
    but certainty, which a better chirp buys too. Gains that raise the loop where nothing was measured are tried only
    where others reject no more than as flown. The filters of target and error and the feed-forward come last, around
    the best of the others.
    """
    part = integral_part(loop.flown, i_term)
    if part is not None:
        flown = loop.flown.changed(I=typed(part * loop.flown.controller.P))
        loop = replace(loop, flown=flown, settings=flown)
    best = _searched(loop, aim, gyro_factor, part)
    if best.tuned is None or best.gains or lacks(loop, aim):
        return best
    return AxisTuning(
        loop.axis,
        f"{loop.axis}: the flown gains keep {aim.words} by the best estimate, and none that are sure to keep it "
        f"reject more; {would_tell(loop)}",
        loop,
    )


def lacks(loop: RateLoop, aim: Aim) -> bool:
    """Return whether the flown gains miss an aim, by the best estimate and by more than a trifle."""
    flown = loop.best_margins
    return not flown["stable"] or aim.missed_by(flown) > _TRIFLE


def _searched(loop: RateLoop, aim: Aim, gyro_factor: float, part: float | None) -> AxisTuning:
    bare = loop.flown.changed(gyro_filter=other_gyro_filter(loop, gyro_factor))
    best, allowed, candidates = _raised_least(loop, aim, bare, part)
    for slower in _SLOWER if best.tuned is None and lacks(loop, aim) else ():
        angle = typed(slower * loop.flown.angle.P)
        best, allowed, candidates = _raised_least(loop, aim, bare.changed(angle_P=angle), part)
        if best.tuned is not None:
            break
    if best.tuned is None and lacks(loop, aim):
        best = _first_step(loop, aim, candidates, best)
    if best.tuned is None or best.short or loop.ordinary:
        return best
    angle = loop.flown.angle.P
    for more in (_others(loop), [{"angle_P": typed(angle * k)} for k in _ANGLE if angle * k <= _HIGHEST_ANGLE]):
        tuning = _best(loop, aim, _field(loop, best.tuned.settings, more), allowed) if more else best
        if tuning.tuned is not None and tuning.score > best.score + SAME_SCORE and _attitude_keeps(tuning.tuned):
            best = tuning
    return best


def _raised_least(loop: RateLoop, aim: Aim, bare: LoopSettings, part: float | None) -> tuple[AxisTuning, float, _Field]:
    """Return the best of the gains about `bare` that raises least what nobody saw, by how much, and all of them."""
    candidates = _field(loop, bare, _gains(loop, part))
    raised = may_raise(loop)
    best, allowed = _best(loop, aim, candidates, raised[0]), raised[0]
    for most in raised[1:]:
        if best.gains:
            break
        tuning = _best(loop, aim, candidates, most)
        if tuning.tuned is not None and (tuning.wider, tuning.score) > (best.wider, best.score):
            best, allowed = tuning, most
    return best, allowed, candidates


def _first_step(loop: RateLoop, aim: Aim, candidates: _Field, refused: AxisTuning) -> AxisTuning:
    """Return the candidate that falls least short of the aim at its worst, where the flown gains fall shorter.

    Gains as thin as those of some firmware's defaults are not within a factor of two of any that are sure to keep the
    aim; what is surely better is flown, measured and tuned again.
    """
    flown, actuators = worst_case(loop), ActuatorNoise(loop)
    best, least = refused, LEAST if flown is None else LEAST.at_least(flown)
    missed = aim.all_missed_by(candidates.nominal._asdict())
    sound = np.flatnonzero(_sound(candidates, aim, may_raise(loop)[0]))
    # By how much a worst case falls short of its best estimate at the least: those with less in hand need no look.
    spare = np.inf
    for k in sorted(sound.tolist(), key=missed.__getitem__):
        if best.tuned is not None and missed[k] + spare >= aim.missed_by(best.worst):
            break
        tuned = loop.with_settings(candidates.bare.changed(**candidates.values[k]))
        if actuators.factor(tuned) > aim.noise or (bounds := worst_case(tuned)) is None:
            continue
        spare = min(spare, aim.missed_by(bounds) - missed[k])
        if least.missed_by(bounds) > 0.0:
            continue
        if best.tuned is None or aim.missed_by(bounds) < aim.missed_by(best.worst):
            best = _tuning(loop, aim, candidates, k, tuned, bounds)
    return best


def _gains(loop: RateLoop, part: float | None) -> list[dict[str, float]]:
    """Return the grid of P, I (or a fixed part of P), D and the derivative's filter."""
    flown, ranges = loop.flown.controller, RANGES[loop.axis]
    least, most = 1.0 / (LARGEST - _ROUNDING), (LARGEST_OF_STICKS if loop.ordinary else LARGEST) - _ROUNDING
    factors_p, factors_d = (np.geomspace(least, most, steps) for steps in (_STEPS_P, _STEPS_D))

    def allowed(name: str, values: Iterable[float]) -> list[float]:
        return [value for value in map(typed, values) if _within(value, getattr(flown, name), ranges[name])]

    filters = [typed(flown.FLTD * k) for k in ((1.0,) if loop.ordinary else _filters(flown.FLTD, _FLTD))]
    derivatives = allowed("D", flown.D * factors_d if flown.D > 0.0 else [0.0])
    candidates = []
    for p in factors_p:
        integrals = (
            [flown.I * min(max(p * i, least), most) for i in _I] if part is None else [part * typed(flown.P * p)]
        )
        searched = allowed("P", [flown.P * p]), allowed("I", integrals), derivatives, filters
        candidates += [
            dict(zip("PID", gains[:3], strict=True), FLTD=gains[3]) for gains in itertools.product(*searched)
        ]
    return candidates


def _others(loop: RateLoop) -> list[dict[str, float]]:
    """Lay out the filters of target and error, and the feed-forward, of those that are in use."""
    flown = loop.flown
    factors = {name: _filters(flown.value(name), _OTHER_FILTERS) for name in ("FLTT", "FLTE")}
    factors["FF"] = _FF if flown.controller.FF > 0.0 else (1.0,)
    return [
        {name: typed(flown.value(name) * factor) for name, factor in zip(factors, chosen, strict=True)}
        for chosen in itertools.product(*factors.values())
        if set(chosen) != {1.0}
    ]


def _attitude_keeps(tuned: RateLoop) -> bool:
    """Return whether the attitude loop keeps its phase margin for everything that the data leave possible."""
    if tuned.settings.angle.P <= tuned.flown.angle.P:
        return True
    phase = margins_of(tuned.hz, tuned.attitude_loop(tuned.plant.draws)).phase_deg
    return bool((phase[np.isfinite(phase)] >= _ATTITUDE_PHASE).all())


def _filters(flown: float, factors: Sequence[float]) -> tuple[float, ...]:
    """Return the factors of a filter that keep it in the documented range; of none, none."""
    return tuple(k for k in factors if k == 1.0 or 0.0 < flown * k <= _HIGHEST_FILTER)


def _field(loop: RateLoop, bare: LoopSettings, candidates: Sequence[Mapping[str, float]]) -> _Field:
    """Compute what needs no draws of candidates that change the settings `bare`."""
    hz = loop.hz[::_EVERY]
    through = (loop.with_settings(bare).gyro_change * loop.plant.response)[::_EVERY]
    true_plant = through / bare.gyro.response(hz)
    feedbacks, (raised, noise) = bare.feedbacks(candidates, hz), raised_unseen(loop, bare, candidates)
    rows = []
    gusts, ending = np.empty(len(candidates)), np.empty(len(candidates))
    for first in range(0, len(candidates), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        broken = through * feedbacks[some]
        rows.append(margins_of(hz, broken))
        gusts[some] = _gust_response(hz, true_plant, broken)
        ending[some] = amplified_at_end(loop, hz, broken)
    nominal = MarginSet(*map(np.concatenate, zip(*rows, strict=True)))
    flown_loop = (loop.with_settings(loop.flown).response)[::_EVERY][None, :]
    flown_rejection = margins_of(hz, flown_loop).rejection_hz[0]
    flown_gust = _gust_response(hz, loop.plant.response[::_EVERY] / loop.flown.gyro.response(hz), flown_loop)[0]
    with np.errstate(invalid="ignore"):
        gained = np.log(nominal.rejection_hz / (flown_rejection if np.isfinite(flown_rejection) else hz[0]))
        score = _BANDWIDTH_WEIGHT * np.minimum(gained, _WANTED_GAIN) - np.log(gusts / flown_gust)
    as_flown = (ending <= amplified_at_end(loop, hz, flown_loop)) & (raised <= may_raise(loop)[0])
    ends_well = np.asarray((ending <= AMPLIFIED) | as_flown)
    return _Field(bare, tuple(candidates), nominal, np.asarray(gained), np.asarray(score), raised, noise, ends_well)


def _best(loop: RateLoop, aim: Aim, field: _Field, raised: float) -> AxisTuning:
    """Return the candidate of the best score that keeps the aim at its worst, or why there is none."""
    nominal, score = field.nominal, field.score
    good = _sound(field, aim, raised)
    order = np.flatnonzero(good)[np.argsort(-score[good], kind="stable")]
    actuators = ActuatorNoise(loop)
    # How far below its nominal margins a candidate's worst case lay: those with less in hand need no look.
    spare = {"gain_db": 0.0, "phase_deg": 0.0, "peak_db": 0.0}
    checked, enough = 0, good
    for k in order:
        if not enough[k]:
            continue
        tuned = loop.with_settings(field.bare.changed(**field.values[k]))
        noise = actuators.factor(tuned)
        if noise > aim.noise:
            continue
        checked += 1
        if checked > 150:
            break
        bounds = worst_case(tuned)
        if bounds is None:
            continue
        if aim.missed_by(bounds) <= 0.0:
            return _tuning(loop, aim, field, int(k), tuned, bounds)
        for name in spare:
            short = abs(bounds[name] - float(getattr(nominal, name)[k]))
            if np.isfinite(short):
                spare[name] = max(spare[name], 0.8 * short)
        enough = aim.keeping(spare).all_missed_by(nominal._asdict()) <= 0.0
    return AxisTuning(
        loop.axis,
        f"{loop.axis}: no gains within reach keep {aim.words} for everything that the data leave possible; "
        f"{_thinner(loop) or would_tell(loop)}",
        loop,
    )


def _sound(field: _Field, aim: Aim, raised: float) -> NDArray[np.bool_]:
    """Return which candidates keep an aim by the best estimate, and raise what nobody saw by a factor at most."""
    nominal = field.nominal
    return np.asarray(
        (field.unseen <= raised)
        & (field.noise <= 1.01 * aim.noise)
        & field.ends_well
        & nominal.stable
        & (aim.all_missed_by(nominal._asdict()) <= 0.0)
        & np.isfinite(nominal.rejection_hz),
        np.bool_,
    )


def _tuning(
    loop: RateLoop, aim: Aim, field: _Field, k: int, tuned: RateLoop, bounds: Mapping[str, float]
) -> AxisTuning:
    """Return a candidate as what is proposed."""
    return AxisTuning(
        axis=loop.axis,
        refused=None,
        loop=loop,
        tuned=tuned,
        worst=promised(tuned, bounds, asdict(aim)),
        noise=ActuatorNoise(loop).factor(tuned),
        score=float(field.score[k]),
        unseen=float(field.unseen[k]),
        wider=bool(field.gained[k] > _ROUNDED),
        short=aim.missed_by(bounds) > 0.0,
    )


def _thinner(loop: RateLoop) -> str:
    """Return what to do about flown gains with which no chirp should be flown; empty of those that keep some margin."""
    flown = loop.best_margins["gain_db"]
    if not flown < LEAST.gain_db:
        return ""
    return f"the flown gains leave {max(flown, 0.0):.1f} dB: lower P, I and D of this axis by a quarter, and fly again"


def would_tell(loop: RateLoop) -> str:
    """Return which chirp would leave less open."""
    if loop.ordinary:
        return "a chirp of mode SYSTEMID to 30 Hz or more would leave less open"
    other = "a longer chirp, or one in calmer air," if saw_modes(loop) else f"a chirp to {FIRST_MODES:.0f} Hz or more"
    return f"{other} would leave less open"


def _within(value: float, flown: float, span: tuple[float, float]) -> bool:
    """Return whether a gain lies in its documented range, or no farther outside than the flown one."""
    return flown == 0.0 or min(span[0], flown) <= value <= max(span[1], flown)


def _gust_response(hz: Floats, plant: Complexes, broken: Complexes) -> Floats:
    """Compute rms attitude under gusts whose corner is at 1 Hz, to a common factor, shape (K,)."""
    spectrum = plant / (2j * np.pi * hz) / (1.0 + 1j * hz)
    return np.asarray(np.sqrt(np.sum(np.abs(spectrum / (1.0 + broken)) ** 2 * np.gradient(hz), axis=1)))
