"""How the craft turns, how far ahead a model predicts, and what is known of its thrust, inertia and drag."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from core.parameter import Parameter
from core.quantity import counted, number, uncertain
from pipeline.flight.purposes import uses_of
from pipeline.results.answer import HOLDS, AnswerLine, Tone
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.rotation import AxisMargins, LoopState
from pipeline.results.verdict import PredictionUse
from sysid.rigid_body.physical import HEADLINE, UNITS, quantity
from sysid.rotors.thrust_regression import THRUST_CHANGED

#: Word and colour of what margins say, worst first.
_STATES = {
    LoopState.UNSTABLE: ("unstable", Tone.BAD),
    LoopState.THIN: ("thin margins", Tone.CARE),
    LoopState.UNKNOWN: ("partly known", Tone.UNKNOWN),
    LoopState.GOOD: ("good margins", Tone.GOOD),
}


def loops(result: FlightResult) -> AnswerLine | None:
    """Answer with an oscillation, else the least margin, else how fast the attitude follows; None of nothing known."""
    account = present(result.account)
    swings = [] if account is None else [each.evidence for each in account.notable if each.id == "oscillation"]
    if swings:
        axes = " and ".join(dict.fromkeys(str(each["axis"]) for each in swings))
        hz = max(float(each["frequency_hz"] or 0.0) for each in swings)
        return AnswerLine(purpose="Loops", word="oscillate", tone=Tone.BAD, text=f"in {axes}", value=hz, unit="Hz")
    margins = {} if isinstance(result.rotation, Failure) else result.rotation.loops
    known = {axis: each for axis, each in margins.items() if _determined(each.computed.phase_deg)}
    return _margins(known) if known else _bandwidth(result)


def _determined(number: Parameter) -> bool:
    """Return whether a number is known to half of itself at least: 5 ± 11 degrees are no margin."""
    return number.value is not None and number.sigma is not None and 2.0 * number.sigma < abs(number.value)


def _margins(known: Mapping[str, AxisMargins]) -> AnswerLine:
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


def ahead(result: FlightResult) -> AnswerLine:
    """Answer with the model that predicts furthest, and its error there."""
    fitted = [each for each in result.models if not isinstance(each.model, Failure)]
    if not fitted:
        needed = (result.flight, result.trajectory, result.experiment, *(each.model for each in result.models))
        reason = next((each.reason for each in needed if isinstance(each, Failure)), "no model")
        return _none("no model", brief(reason))
    uses = {each.key: uses_of(present(each.validation), present(each.model)).prediction for each in fitted}
    names = {each.key: each.title.partition(" →")[0] for each in fitted}
    able = {key: use for key, use in uses.items() if use.horizon_s is not None}
    best = max(able, key=lambda key: able[key].horizon_s or 0.0, default="")
    if not best or (able[best].horizon_s or 0.0) < HOLDS:
        tried = f"{counted(len(fitted), 'model')} tried"
        if not any(use.judged for use in uses.values()):
            missing = next((each.missing for each in fitted if each.missing), "too little flight was held out")
            return _none("not judged", f"{tried}: {brief(missing)}")
        return _none("none holds", tried)
    use, changed = able[best], changed_load(result)
    text = f"by {names[best]}, {_error(use)}"
    word, tone = ("yes", Tone.GOOD)
    if changed:
        # Models were fitted to two loads, and this held after the change only.
        word, tone, text = "with care", Tone.CARE, f"{text}; {changed}"
    value = use.horizon_s if use.reach_s is None else use.reach_s
    return AnswerLine(
        purpose="Predict ahead", word=word, tone=tone, text=text, value=value, sigma=use.reach_sigma_s, unit="s"
    )


def _none(word: str, text: str) -> AnswerLine:
    return AnswerLine(purpose="Predict ahead", word=word, tone=Tone.UNKNOWN, text=text)


def _error(use: PredictionUse) -> str:
    """Write the RMS error at the longest horizon, over all axes."""
    error = math.sqrt(sum(each**2 for each in use.rmse_m.values()))
    there = "" if use.reach_s is None else f" at {use.horizon_s:g} s"
    return f"± {number(error, 2)} m{there}"


#: Parameters of the first screen: name, and rows of `PhysicalParameters.table` in order of preference.
_SHOWN = (
    ("thrust", ("thrust over mass",)),
    ("inertia", ("roll inertia over mass and arm", "pitch inertia over mass and arm")),
    ("drag", ("linear drag over mass", "quadratic drag over mass")),
)


def parameters(result: FlightResult) -> AnswerLine | None:
    """Answer with thrust first; None where nothing is determined."""
    known: list[tuple[str, float, float, str]] = []
    unknown = []
    for label, rows in _SHOWN:
        found = next(((row, each) for row in rows if (each := _row(result, row)) is not None), None)
        if found is None:
            unknown.append(label)
        else:
            name, (known_value, error, in_full) = found
            what = _divided(name, in_full) + (" per motor" if label == "thrust" else "")
            known.append((what, known_value, error, _unit(in_full)))
    if not known:
        return None
    what, value, sigma, unit = known[0]
    parts = [what]
    parts += [f"{name} {uncertain(known_value, error, its_unit)}" for name, known_value, error, its_unit in known[1:]]
    text = ", ".join(parts)
    disagree = not isinstance(result.parameters, Failure) and bool(result.parameters.findings)
    if disagree:
        text += "; methods disagree"
    changed = changed_load(result)
    if changed:
        text += f"; {changed}: of neither load"
    complete = not unknown and not disagree and not changed
    word = "known" if complete else "disputed" if disagree or changed else "partly"
    tone = Tone.GOOD if complete else Tone.CARE
    return AnswerLine(purpose="Parameters", word=word, tone=tone, text=text, value=value, sigma=sigma, unit=unit)


def _row(result: FlightResult, parameter: str) -> tuple[float, float, str] | None:
    """Return the headline of a parameter with its error, in SI with the mass where that is given."""
    if not isinstance(result.parameters, Failure):
        rows = result.parameters.table.reset_index().to_dict("records")
        row = next((each for each in rows if (each["parameter"], each["method"]) == (parameter, HEADLINE)), None)
        if row is None:
            return None
        for prefix in ("si_", ""):
            value, sigma = float(row[f"{prefix}value"]), float(row[f"{prefix}sigma"])
            if math.isfinite(value) and math.isfinite(sigma) and sigma > 0.0:
                return value, sigma, str(row[f"{prefix}unit"])
        return None
    if parameter == "thrust over mass" and not isinstance(result.thrust, Failure):
        common = result.thrust.common
        if common.determined and common.per_mass is not None and common.sigma is not None:
            return common.per_mass, common.sigma, UNITS[parameter]
    return None


def _divided(parameter: str, unit: str) -> str:
    """Name a number as its unit has it: motion alone gives no inertia, but its ratio to mass and arm."""
    name, divisor = quantity(parameter, unit)
    if not divisor:
        return name
    return f"{name}/({divisor.replace(' and ', '·')})" if " and " in divisor else f"{name}/{divisor}"


def _unit(unit: str) -> str:
    """Leave the conditions out of a unit, which stand in the table of parameters."""
    return re.split(r",| at | \(", unit, maxsplit=1)[0].replace("^2", "²").replace(" ", "·")


#: Words of a reason that a line has room for.
_BRIEF = 12


def brief(reason: str) -> str:
    """Return the first clause of a reason, cut to what a line has room for; the whole stands further down.

    It follows a word in the line, and begins with a small letter as that does.
    """
    clause = re.split(r"[:;(]|\. ", reason, maxsplit=1)[0].strip().rstrip(".")
    clause = re.sub(r"^(The|A|An|No|Only|It|There|Nothing|Too) ", lambda found: found[0].lower(), clause)
    words = clause.split()
    return clause if len(words) <= _BRIEF else " ".join(words[:_BRIEF]) + " …"


def changed_load(result: FlightResult) -> str:
    """Describe from when on the same commands gave another thrust per mass; empty when they did not."""
    findings = () if isinstance(result.thrust, Failure) else result.thrust.findings
    evidence = next((finding.evidence for finding in findings if finding.id == THRUST_CHANGED), None)
    if evidence is None:
        return ""
    change, time = (float(evidence[name] or 0.0) for name in ("change", "time"))
    return f"thrust/mass changed by {100.0 * change:+.0f} % at {time:.0f} s"
