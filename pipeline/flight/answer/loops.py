"""How the craft turns: margins of its loops, else how fast the attitude follows, only where that is determined."""

from __future__ import annotations

import math
from collections.abc import Mapping

from core.parameter import Parameter
from core.quantity import uncertain
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.failure import Failure
from pipeline.results.flight import FlightResult
from pipeline.results.rotation import LoopMargins, LoopState

#: Word and colour of what margins say, worst first.
_STATES = {
    LoopState.UNSTABLE: ("unstable", Tone.BAD),
    LoopState.THIN: ("thin margins", Tone.CARE),
    LoopState.UNKNOWN: ("partly known", Tone.UNKNOWN),
    LoopState.GOOD: ("good margins", Tone.GOOD),
}


def loops(result: FlightResult) -> AnswerLine | None:
    """Answer with an oscillation, else the least margin, else how fast the attitude follows; None of nothing known."""
    flown = result.loops
    if not isinstance(flown, Failure) and flown.oscillations_hz:
        axes = " and ".join(flown.oscillations_hz)
        hz = max(flown.oscillations_hz.values())
        return AnswerLine(purpose="Loops", word="oscillate", tone=Tone.BAD, text=f"in {axes}", value=hz, unit="Hz")
    margins = {} if isinstance(result.rotation, Failure) else result.rotation.loops
    known = {axis: each for axis, each in margins.items() if _determined(each.computed.phase_deg)}
    return _margins(known) if known else _bandwidth(result)


def _determined(number: Parameter) -> bool:
    """Return whether a number is known to half of itself at least: 5 ± 11 degrees are no margin."""
    return number.value is not None and number.sigma is not None and 2.0 * number.sigma < abs(number.value)


def _margins(known: Mapping[str, LoopMargins]) -> AnswerLine:
    """Answer with the axis whose phase margin is smallest; the word is that of the worst of all axes."""
    axis = min(known, key=lambda each: known[each].computed.phase_deg.value or 0.0)
    phase, states = known[axis].computed.phase_deg, [each.state for each in known.values()]
    word, tone = next(_STATES[state] for state in _STATES if state in states)
    gains = [each.computed.gain_db for each in known.values() if _determined(each.computed.gain_db)]
    least = min(gains, key=lambda each: each.value or 0.0, default=None)
    text = f"phase margin in {axis}" + ("" if least is None else f", gain {uncertain(least.value, least.sigma, 'dB')}")
    text += " (without chirps)" if any(each.ordinary for each in known.values()) else ""
    return AnswerLine(purpose="Loops", word=word, tone=tone, text=text, value=phase.value, sigma=phase.sigma, unit="°")


def _bandwidth(result: FlightResult) -> AnswerLine | None:
    axes = () if isinstance(result.rotation, Failure) else result.rotation.axes
    known = {
        each.axis: each.attitude.bandwidth
        for each in axes
        if each.attitude is not None and _determined(each.attitude.bandwidth) and each.axis != "yaw"
    }
    if not known:
        return None
    axis = min(known, key=lambda each: known[each].value or 0.0)
    value, sigma = known[axis].value or 0.0, known[axis].sigma or 0.0
    return AnswerLine(
        purpose="Loops",
        word="",
        tone=Tone.UNKNOWN,
        text=f"attitude bandwidth in {axis}",
        value=value / math.tau,
        sigma=sigma / math.tau,
        unit="Hz",
    )
