"""`tune`: gains that reject disturbances best within margins that hold for everything the data leave possible.

The rejection of disturbances, first its bandwidth and then rms attitude under gusts, is maximised over P, D, I and the
filters of derivative and gyro, subject to gain margin, phase margin and peak sensitivity at the worst of the 95 % set,
to the noise at the actuators, and to changes by at most a factor of two. Without the evidence (`evidence`) the result
is a reason and no number.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from types import MappingProxyType

import numpy as np

from core.summary import Summarised, listed
from logparse import FlightLog, GivenLogs, RotoridError, logs_of
from logparse.craft.quadplane import own_names
from sysid.frequency.excitation import mixer_chirps
from sysid.frequency.rate_signals import LogSignals
from sysid.loops.as_flown import contradiction, contradiction_of, gyro_seen
from sysid.loops.controller import AXES, LoopError
from sysid.loops.criteria import identified, sheet
from sysid.loops.evidence import (
    autotuned,
    loop_parameters,
    motors_limited,
    no_one_setting,
    oscillation,
    other_settings,
    sagged,
    saturation,
    unfit_log,
    unsupported,
    weak_band,
)
from sysid.loops.loop import RateLoop, loop_of_flights, rate_loop
from sysid.loops.parameter_file import parameter_file
from sysid.loops.plant import FIRST_MODES
from sysid.loops.safety import AIMS, Aim, is_calm, others_keep
from sysid.loops.same_craft import SUMMED, gain_apart, other_craft, other_load
from sysid.loops.search import (
    DEFAULT_I,
    LARGEST_OF_STICKS,
    SAME_SCORE,
    AxisTuning,
    integral_part,
    tune_axis,
    without_integral,
    would_tell,
)
from sysid.loops.settings import read_settings
from sysid.loops.unseen import UNSEEN_RAISED, saw_modes, unseen_mode

#: Largest I that may be asked for, as a part of P.
_LARGEST_I = 3.0

#: Factors by which the gyro's filter is raised, in the order in which they are tried.
_GYRO_FACTORS = (1.25, 1.5, 2.0)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Tuning(Summarised):
    """Proposed parameters, the way back, and the reasons."""

    logs: tuple[str, ...]
    aim: Aim
    #: By parameter name: exactly as written to the files; empty where refused.
    proposed: dict[str, float]
    rollback: dict[str, float]  #: The same as they were on the craft before the flights.
    flown: dict[str, float]  #: The same as they were during the chirps.
    refused: str | None  #: Why nothing is proposed.
    axes: tuple[AxisTuning, ...]
    remarks: tuple[str, ...]
    made: str  #: UTC.

    def in_names_of(self, firmware: str | None) -> Tuning:
        """Return the same with parameters and procedures as the firmware itself names them."""

        def own(text: str | None) -> str | None:
            return None if text is None else own_names(text, firmware)

        proposed, rollback, flown = (
            {own_names(name, firmware): value for name, value in values.items()}
            for values in (self.proposed, self.rollback, self.flown)
        )
        return replace(
            self,
            proposed=proposed,
            rollback=rollback,
            flown=flown,
            refused=own(self.refused),
            axes=tuple(replace(axis, refused=own(axis.refused)) for axis in self.axes),
            remarks=tuple(own_names(remark, firmware) for remark in self.remarks),
        )

    def proposed_file(self) -> str:
        """Return the text of ``proposed.param``; LoopError where nothing is proposed."""
        unchanged = (f"{axis.axis}: unchanged: {axis.reason}" for axis in self.axes if axis.tuned is None)
        first = "first flight: hover low, be ready to load rollback.param; then `rotorid prove`"
        reasons = {name: f"was {self.rollback[name]:g}; {reason}" for name, reason in self.reasons().items()}
        return self._file("proposed", self.proposed, reasons, *unchanged, *self.remarks, first)

    def rollback_file(self) -> str:
        """Return the text of ``rollback.param``, the values as flown; LoopError where nothing is proposed."""
        reasons = {name: f"proposed was {value:g}" for name, value in self.proposed.items()}
        return self._file("as flown: load this to go back", self.rollback, reasons)

    def reasons(self) -> dict[str, str]:
        """Return for each proposed parameter the margins that its axis keeps with the whole proposal."""
        kept = {AXES[axis.axis]: f"{axis.axis}: {axis.promise}" for axis in self.axes if axis.tuned is not None}
        axes = {name: next((part for part in name.split("_") if part in kept), "") for name in self.proposed}
        return {name: kept.get(axis, "serves all axes") for name, axis in axes.items()}

    def _file(self, what: str, values: Mapping[str, float], reasons: Mapping[str, str], *more: str) -> str:
        if self.refused is not None:
            raise LoopError(f"nothing is proposed: {self.refused}")
        comments = (f"rotorid tune: {what}", f"from {', '.join(self.logs)}, made {self.made}", *more)
        return parameter_file(values, comments, reasons)

    def summary(self) -> dict[str, str]:
        """Return the logs and what is proposed, or why nothing is."""
        if self.refused is not None:
            return {"logs": listed(self.logs), "refused": self.refused}
        changes = [f"{name} {self.rollback[name]:.4g} → {value:.4g}" for name, value in self.proposed.items()]
        return {"logs": listed(self.logs), "proposed": listed(changes, most=4)}


def tune(
    logs: GivenLogs, aim: Aim | str = "rejection", i_term: float | None = None, size: float | None = None
) -> Tuning:
    """Propose gains for the axes whose logs support it.

    Parameters
    ----------
    logs : FlightLog, path-like, or a sequence of either
        Flights of one craft with the same settings and chirps at the mixer, of all axes in one or one axis in each.
    aim : Aim or {"rejection", "quiet", "margins"}
    i_term : float, optional
        I as a part of P; default: what rejects best about the I that flew, and where that was 0, as in ArduPilot's
        published procedure, the firmware's own part of 1 (0.1 for yaw).
    size : float, optional
        Distance between opposite hubs, m, to which the criteria's limits of helicopters are scaled.

    Raises
    ------
    LoopError
        For an aim that there is not, or an I that is none.
    """
    if i_term is not None and not 0.0 < i_term <= _LARGEST_I:
        raise LoopError(f"I = {i_term:g} P is none: a part between 0 and {_LARGEST_I:g} is flown")
    if isinstance(aim, str):
        if aim not in AIMS:
            raise LoopError(f"there is no aim {aim!r}; the aims are {', '.join(AIMS)}")
        aim = AIMS[aim]
    flights = without_copies(logs_of(logs))
    result = _tuned(flights, aim, i_term, size)
    return result.in_names_of(flights[0].vehicle.firmware) if flights else result


def tune_known(log: FlightLog, known: Mapping[str, RateLoop]) -> Tuning:
    """Propose gains for the axes of one flight as `tune` does by default, with the loops that are known already."""
    return _tuned([log], AIMS["rejection"], None, None, known).in_names_of(log.vehicle.firmware)


def _tuned(
    flights: Sequence[FlightLog],
    aim: Aim,
    i_term: float | None,
    size: float | None,
    known: Mapping[str, RateLoop] = MappingProxyType({}),
) -> Tuning:
    names = tuple(log.name for log in flights)
    made = datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC")

    def refuse(reason: str, axes: tuple[AxisTuning, ...] = ()) -> Tuning:
        return Tuning(names, aim, {}, {}, {}, reason, axes, (), made)

    reason = _refusal(flights)
    if reason is not None:
        return refuse(reason)
    signals = [LogSignals(log) for log in flights]  # read once for all axes
    tunings = [_examined(signals, axis, known) for axis in AXES]
    loops = {item.axis: item.loop for item in tunings if item.loop is not None and item.refused is None}
    if not loops:
        return refuse(_reasons(tunings), tuple(tunings))
    filter_stays = _gyro_filter_stays(flights, tunings)
    staying = [item.loop for item in tunings if item.axis not in loops and item.loop is not None]
    factors = [factor for factor in _GYRO_FACTORS if filter_stays is None and others_keep(staying, factor)]
    best = _best(loops, aim, i_term, factors)
    axes = tuple(_with_sheets(best.get(item.axis, item), size) for item in tunings)
    proposed = _proposed(axes)
    during = {name: value for loop in loops.values() for name, value in loop.flown.parameters().items()}
    before, flown = _before(flights, during, proposed), {name: during[name] for name in proposed}
    remarks = [remark for item in axes if item.loop is not None for remark in item.loop.flown.remarks]
    remarks += _said_once(
        remark for item in axes for remark in _remarks(item, loops.get(item.axis), aim, i_term, proposed)
    )
    if any(log.tables.battery is not None and log.vehicle.battery_voltage_max <= 0.0 for log in flights):
        remarks.append(
            "MOT_BAT_VOLT_MAX is 0: the margins are those of the battery as it was during the chirps; a fuller one "
            "raises the gain of the loops by twice as many per cent as its voltage"
        )
    if filter_stays is not None:
        remarks.append(f"INS_GYRO_FILTER stays: it serves all axes, and {filter_stays}")
    if not proposed:
        return refuse(_reasons(axes), axes)
    kept = _changed_later(flights, axes)
    if kept:
        remarks.append(
            f"{listed(kept)} changed after the flight: both files hold what flew, without which nothing is sure"
        )
    proposed, before, flown = ({**kept, **values} for values in (proposed, before, flown))
    return Tuning(names, aim, proposed, before, flown, None, axes, tuple(dict.fromkeys(remarks)), made)


def _refusal(flights: Sequence[FlightLog]) -> str | None:
    """Return why nothing can be proposed from these flights together, before their loops are identified."""
    if not flights:
        return "no log was given"
    for log in flights:
        try:
            read_settings(log, "roll")
            reason = _unfit(log)
        except RotoridError as error:
            reason = str(error)
        reason = reason or other_craft(flights[0], log) or other_load(flights[0], log)
        if reason is not None:
            return reason
    return other_settings(flights)


def _best(
    loops: Mapping[str, RateLoop], aim: Aim, i_term: float | None, gyro_factors: Sequence[float]
) -> dict[str, AxisTuning]:
    """Tune axes with the gyro's filter as flown, and with a higher one as long as all axes together gain by it."""
    best = {axis: tune_axis(loop, aim, 1.0, i_term) for axis, loop in loops.items()}
    for factor in gyro_factors:
        tuned = {axis: tune_axis(loop, aim, factor, i_term) for axis, loop in loops.items()}
        if any(item.tuned is None for item in tuned.values()) or _worth(tuned) <= _worth(best):
            break
        best = tuned
    return best


def _remarks(
    item: AxisTuning, during: RateLoop | None, aim: Aim, i_term: float | None, proposed: Mapping[str, float]
) -> Iterator[tuple[str, str]]:
    """Yield remarks on an axis, each with its name; `during` is its loop as it flew during the chirps."""
    loop, axis = item.loop, item.axis
    if loop is None:
        return
    if during is not None and without_integral(during.flown):
        flown = f"I was {during.flown.controller.I:.2g} during the chirps"
        if f"ATC_RAT_{AXES[axis]}_I" in proposed:
            tuned = f"it is tuned with I = {integral_part(during.flown, i_term):g} P"
            yield axis, f"{flown}; {tuned}, and compared with the flown P and D beside such an I"
        else:
            yield axis, f"{flown}, and nothing is proposed: give it back"
    if item.unseen > UNSEEN_RAISED[0]:
        yield (
            axis,
            f"above {loop.plant.seen:.0f} Hz, where no chirp looked for modes of the frame, the gain of the loop rises "
            f"by up to {item.unseen:.1f}; a chirp to a higher SID_F_STOP_HZ, with RATE as fast, would tell",
        )
    if item.tuned is not None and loop.ordinary:
        yield (
            axis,
            f"from ordinary flying, which shows the craft up to {loop.plant.seen:.0f} Hz: gains are raised by a factor "
            f"of {LARGEST_OF_STICKS:g} at most; fly a chirp of mode SYSTEMID to win more",
        )
    for remark in (_filters_opened(item), rejects_less(item, aim)):
        if remark is not None:
            yield axis, remark
    if item.short:
        yield (
            axis,
            f"a first step: no gains within reach are sure to keep {aim.words}; fly these and tune again, or "
            f"{would_tell(loop)}",
        )


def _filters_opened(item: AxisTuning) -> str | None:
    """Return what phase at the crossover filters proposed higher win, and at what noise."""
    if item.tuned is None or item.loop is None or item.noise is None:
        return None
    flown, tuned = item.loop.flown, item.tuned.settings
    filters = {"FLTT": "FLTT", "FLTE": "FLTE", "FLTD": "FLTD", "gyro_filter": "INS_GYRO_FILTER"}
    values = {name: tuned.value(name) for name in filters if tuned.value(name) > flown.value(name) > 0.0}
    crossover = item.tuned.margins.crossover_hz.value
    if crossover is None or not values:
        return None
    hz = np.array([crossover])
    before, after = (
        settings.feedback(hz) * settings.gyro.response(hz) for settings in (flown, flown.changed(**values))
    )
    names = [f"{filters[name]} {flown.value(name):g} to {value:g} Hz" for name, value in values.items()]
    return (
        f"{listed(names)} wins {float(np.degrees(np.angle(after / before))[0]):.0f} deg at the crossover; noise at the "
        f"motors, with the new gains, is {item.noise:.2g} times that of the flown ones"
    )


def _said_once(remarks: Iterable[tuple[str, str]]) -> list[str]:
    """Return each sentence once, with the axes that it is about."""
    axes_of: dict[str, list[str]] = {}
    for axis, sentence in remarks:
        axes_of.setdefault(sentence, []).append(axis)
    return [f"{', '.join(axes)}: {sentence}" for sentence, axes in axes_of.items()]


def _reasons(axes: Sequence[AxisTuning]) -> str:
    """Return why nothing is proposed."""
    return "; ".join(_said_once((item.axis, item.reason) for item in axes))


def _unfit(log: FlightLog) -> str | None:
    """Return why nothing can be tuned from a log: no one loop per axis, an oscillation, parameters that did not fly.

    Without chirps at the mixer AutoTune may have run: its steps show the craft, not the loop.
    """
    chirped = any(mixer_chirps(log, axis) for axis in AXES)
    ordinary = not chirped and log.vehicle.firmware != "PX4"
    reason = no_one_setting(log) if ordinary else unfit_log(log)
    if reason is not None or (ordinary and autotuned(log)):
        return reason
    oscillating = next((r for axis in AXES if (r := oscillation(log, axis))), None)
    return oscillating or contradiction(log)


def _with_sheets(item: AxisTuning, size: float | None) -> AxisTuning:
    """Return an axis with its criteria, as flown and as proposed."""
    if item.loop is None:
        return item
    criteria = (*sheet(item.loop, size), *identified(item.loop))
    return replace(item, criteria=criteria, promises=() if item.tuned is None else sheet(item.tuned, size))


def without_copies(logs: Sequence[FlightLog]) -> list[FlightLog]:
    """Return logs without those whose flight is another's to the microsecond: the same evidence twice is not more."""
    by_flight: dict[tuple[float, float] | int, FlightLog] = {}
    for k, log in enumerate(logs):
        by_flight.setdefault(k if log.flight is None else (log.flight.start, log.flight.stop), log)
    return list(by_flight.values())


def _gyro_filter_stays(logs: Sequence[FlightLog], axes: Sequence[AxisTuning]) -> str | None:
    """Return which evidence is missing to raise the gyro's filter; None where it is complete."""
    unknown = [item.axis for item in axes if item.loop is None or weak_band(item.loop) or unseen_mode(item.loop)]
    if unknown:
        return f"{listed(unknown)} {'is' if len(unknown) == 1 else 'are'} not identified"
    low = [item.axis for item in axes if item.loop is not None and not saw_modes(item.loop)]
    if low:
        return f"the chirp of {listed(low)} ended below {FIRST_MODES:.0f} Hz, where frames bend"
    if not all(gyro_seen(log, axis) for log in logs for axis in AXES):
        return "SIDD does not show the rates before the filters, which would tell whether it is the one that flew"
    return None if is_calm(logs) else "vibration is not known to be low (VIBE)"


def _worth(tuned: Mapping[str, AxisTuning]) -> tuple[int, int, int, int, float]:
    """Rank a gyro filter: axes with a proposal, with more bandwidth, that gain; small rise unseen; score in steps."""
    items = [item for item in tuned.values() if item.tuned is not None]
    raised = (next((k for k, most in enumerate(UNSEEN_RAISED) if item.unseen <= most), 9) for item in items)
    return (
        len(items),
        sum(item.wider for item in items),
        sum(item.gains for item in items),
        -max(raised, default=0),
        round(sum(item.score for item in items) / SAME_SCORE),
    )


def _examined(flights: Sequence[LogSignals], axis: str, known: Mapping[str, RateLoop]) -> AxisTuning:
    """Identify an axis and check the evidence, from the flights with a chirp on it, else from all."""
    chirped = [flight for flight in flights if mixer_chirps(flight.log, axis)]
    used, identify = (chirped, rate_loop) if chirped else (flights, loop_of_flights)
    logs = [flight.log for flight in used]
    try:
        loop = known[axis] if axis in known else identify(used, axis)
    except RotoridError as error:
        others = not chirped and any(mixer_chirps(flight.log, other) for flight in flights for other in AXES)
        return AxisTuning(axis, f"no chirp of this axis was given, and without one: {error}" if others else str(error))
    alone = []
    for flight in used if len(used) > 1 else ():
        with suppress(RotoridError):
            alone.append(identify([flight], axis))
    apart = max((gain_apart(alone[0], other) for other in alone[1:]), default=1.0)
    if apart > SUMMED:
        return AxisTuning(
            axis,
            f"{axis} answers {apart:.2f} times as strongly in one flight as in another, at equal input: give "
            "flights of one craft with one load",
            loop,
        )
    if chirped:
        reasons = (saturation(log, axis) or motors_limited(log, loop) or sagged(log, axis) for log in logs)
    else:
        reasons = (None if autotuned(log) else contradiction_of(log, axis) for log in logs)
    return AxisTuning(axis, next(filter(None, reasons), None) or unsupported(loop), loop)


def rejects_less(item: AxisTuning, aim: Aim) -> str | None:
    """Return the remark on a proposal that gives up rejection for margins that the flown gains lack."""
    if item.tuned is None or item.loop is None or item.wider:
        return None
    flown, tuned = item.loop.best_margins, item.tuned.best_margins
    short = aim.lacking(flown)
    why = f"leave {listed(short)}" if flown["stable"] and short else "are unstable"
    return (
        f"disturbances are rejected up to {tuned['rejection_hz']:.2g} Hz instead of {flown['rejection_hz']:.2g}: "
        f"the flown gains {why}"
    )


def _proposed(axes: Sequence[AxisTuning]) -> dict[str, float]:
    """Return the proposal for each axis that changes: its P, I and D, and what else differs from the flown."""
    proposed: dict[str, float] = {}
    for item in axes:
        if item.tuned is None or item.loop is None:
            continue
        before, after = item.loop.flown.parameters(), item.tuned.settings.parameters()
        other = {name: value for name, value in after.items() if np.float32(value) != np.float32(before[name])}
        if other:
            gains = [f"ATC_RAT_{AXES[item.axis]}_{term}" for term in ("P", "I", "D")]
            proposed |= {name: after[name] for name in gains} | other
    return proposed


def _before(logs: Sequence[FlightLog], flown: Mapping[str, float], names: Iterable[str]) -> dict[str, float]:
    """Return the values to go back to: as flown; of an I taken away for the chirps the one before, else its default."""
    values = {name: flown[name] for name in names}
    for axis, letters in AXES.items():
        name, P = f"ATC_RAT_{letters}_I", flown.get(f"ATC_RAT_{letters}_P", 0.0)
        if name in values and values[name] < 0.1 * DEFAULT_I[axis] * P:
            known = [at.get(name, 0.0) for log in logs for at in (log.parameters_at(-np.inf), log.parameters)]
            values[name] = max(
                (value for value in known if value >= 0.1 * DEFAULT_I[axis] * P), default=DEFAULT_I[axis] * P
            )
    return values


def _changed_later(logs: Sequence[FlightLog], axes: Sequence[AxisTuning]) -> dict[str, float]:
    """Return, as they flew, loop parameters that were changed after the flight, without those of axes that stay."""
    staying = tuple(f"ATC_{kind}_{AXES[item.axis]}_" for item in axes if item.tuned is None for kind in ("RAT", "ANG"))
    changed = {}
    for log in logs:
        assert log.flight is not None
        flown, now = (loop_parameters(values) for values in (log.parameters_at(log.flight.stop), log.parameters))
        for name, value in flown.items():
            own = name.endswith("_I") or name.startswith(staying)
            if not own and np.float32(now.get(name, value)) != np.float32(value):
                changed[name] = value
    return changed
