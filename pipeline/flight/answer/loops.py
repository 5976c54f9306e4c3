"""How stable the loops are: margins, else how closely the attitude followed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from core.quantity import uncertain
from pipeline.flight.answer.words import brief
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.rotation import LoopState

if TYPE_CHECKING:
    from pipeline.results.loops import FlightLoops
    from pipeline.results.rotation import LoopMargins

#: Words of a reason that stands in brackets.
_SHORT_REASON = 8
#: Word and colour of what margins say, worst first.
_STATES = {
    LoopState.UNSTABLE: ("unstable", Tone.BAD),
    LoopState.THIN: ("thin", Tone.CARE),
    LoopState.UNKNOWN: ("partly known", Tone.CARE),
    LoopState.GOOD: ("good", Tone.GOOD),
}


def loops(result: FlightResult) -> AnswerLine:
    """Answer with an oscillation, else with the least margins, else with how well the attitude followed."""
    flown = result.loops
    if isinstance(flown, Failure):
        return AnswerLine(purpose="Loops", word="not known", tone=Tone.UNKNOWN, text=brief(flown.reason))
    if flown.oscillations_hz:
        axis, hz = max(flown.oscillations_hz.items(), key=lambda each: each[1])
        named = " and ".join(flown.oscillations_hz)
        return AnswerLine(
            purpose="Loops",
            word="oscillate",
            tone=Tone.BAD,
            text=f"oscillation in {named}: lower P and D of {axis if named == axis else 'both'} by 25 %",
            value=hz,
            unit="Hz",
        )
    margins = {} if isinstance(result.rotation, Failure) else result.rotation.loops
    known = {axis: each for axis, each in margins.items() if each.computed.phase_deg.value is not None}
    return _margins(known, result) if known else _unmeasured(result, flown)


def _margins(known: Mapping[str, LoopMargins], result: FlightResult) -> AnswerLine:
    """Answer with the axis whose phase margin is smallest; the word is that of the worst of all axes."""
    axis = min(known, key=lambda each: known[each].computed.phase_deg.value or 0.0)
    phase = known[axis].computed.phase_deg
    states = [each.state for each in known.values()]
    word, tone = next(_STATES[state] for state in _STATES if state in states)
    text = f"least phase margin ({axis})"
    gains = [each.computed.gain_db for each in known.values() if each.computed.gain_db.value is not None]
    if gains:
        least = min(gains, key=lambda each: each.value or 0.0)
        text += f", gain margin {uncertain(least.value, least.sigma, 'dB')}"
    rotation = present(result.rotation)
    others = [] if rotation is None else [each.axis for each in rotation.axes if each.axis not in known]
    if others:
        text += f"; {' and '.join(others)} not measured{_shared_reason(result, others)}"
    if any(each.ordinary for each in known.values()):
        text += "; by model, no chirps"
    elif any(each.remarks for each in known.values()):
        text += "; unchecked without PID messages"
    elif tone is not Tone.GOOD and not others:
        text += "; rotorid tune proposes gains"
    if tone is Tone.GOOD and (others or any(each.remarks for each in known.values())):
        word, tone = _STATES[LoopState.UNKNOWN]
    return AnswerLine(purpose="Loops", word=word, tone=tone, text=text, value=phase.value, sigma=phase.sigma, unit="°")


def _shared_reason(result: FlightResult, axes: Sequence[str]) -> str:
    """Return in brackets why some axes have no margins, where it is one short reason for all; else nothing."""
    rotation = present(result.rotation)
    reasons = {
        brief(each.loop_reason.removeprefix(f"{each.axis}: "))
        for each in (() if rotation is None else rotation.axes)
        if each.axis in axes
    }
    reason = reasons.pop() if len(reasons) == 1 else ""
    return f" ({reason})" if 0 < len(reason.split()) <= _SHORT_REASON else ""


def _unmeasured(result: FlightResult, flown: FlightLoops) -> AnswerLine:
    """Answer with how fast, else how closely, the attitude followed, where no chirp shows margins."""
    px4 = result.log.format == "ulog"
    fly = f"margins need {'short, sharp stick inputs' if px4 else 'SYSTEMID chirps'}"
    axes = () if isinstance(result.rotation, Failure) else result.rotation.axes
    followed = {
        axis.axis: axis.attitude.bandwidth
        for axis in axes
        if axis.attitude is not None and axis.attitude.bandwidth.value is not None and axis.axis != "yaw"
    }
    if followed:
        axis = min(followed, key=lambda each: followed[each].value or 0.0)
        slowest = followed[axis]
        return AnswerLine(
            purpose="Loops",
            word="partly known",
            tone=Tone.UNKNOWN,
            text=f"is how fast {axis} follows its target; {fly}",
            value=(slowest.value or 0.0) / math.tau,
            sigma=None if slowest.sigma is None else slowest.sigma / math.tau,
            unit="Hz",
        )
    if not flown.tracking_rad:
        return AnswerLine(purpose="Loops", word="not measured", tone=Tone.UNKNOWN, text=fly)
    axis, error = max(flown.tracking_rad.items(), key=lambda each: each[1])
    return AnswerLine(
        purpose="Loops",
        word="partly known",
        tone=Tone.UNKNOWN,
        text=f"RMS error of {axis} against its target; {fly}",
        value=math.degrees(error),
        unit="°",
    )
