"""The first screen of a flight: what happened, the state of the craft, how it turns, models that hold, what next."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from core.findings import Finding, Severity
from core.parameter import Parameter
from core.quantity import counted, duration, number, uncertain
from pipeline.flight.identification import parameter_rows
from pipeline.results.account import Account, BatteryReading, GpsReading, HoverReading, MotorsReading, VibrationReading
from pipeline.results.answer import Answer, AnswerLine, Picture, Tone, clause
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult
from pipeline.results.model import bare_unit, headlines
from pipeline.results.rotation import AxisMargins, LoopState
from pipeline.results.span import Span
from sysid.records.motor_scaling import curve
from sysid.rigid_body.physical import UNITS, quantity
from sysid.rotors.thrust_regression import THRUST_CHANGED
from sysid.validation.uses import PredictionUse


def compose_answer(result: FlightResult) -> Answer:
    """Sum a flight up for its first screen; `result` is complete but for its answer."""
    picture, around = picture_of(result)
    account = result.account
    if isinstance(account, Failure):
        lines = [AnswerLine(purpose="Happened", word="", tone=Tone.UNKNOWN, text=f"Not known: {account.reason}")]
    else:
        lines = [happened(account), *_damage(result), *state_lines(account, full_thrust(result))]
    return Answer(
        lines=(*lines, *_identified(result)),
        picture=picture,
        around=around,
        next=next_step(result),
    )


def _identified(result: FlightResult) -> Iterator[AnswerLine]:
    """Yield how it turns and which models hold, where anything is determined; what was tried in vain is one line."""
    if isinstance(result.flight, Failure) or result.vehicle.other_craft:
        return
    account = present(result.account)
    crashed = account is not None and any(finding.id == "crash" for finding in account.story)
    # Of a flight that ended in a crash only what is good or bad is worth a line.
    for line in (loops(result), parameters(result), ahead(result)):
        if line is not None and (line.tone in (Tone.GOOD, Tone.BAD) or not crashed):
            yield line


def _damages(result: FlightResult) -> Iterator[Finding]:
    """Yield what is damaged in the file, by more than a few bytes of a radio link."""
    yield from (finding for finding in result.findings if finding.id == "file-damaged" and finding.notable)


def _damage(result: FlightResult) -> Iterator[AnswerLine]:
    """Yield a line of a damaged file: numbers below it rest on what is left."""
    if damaged := next(_damages(result), None):
        yield AnswerLine(purpose="File", word="damaged", tone=Tone.CARE, text=brief(damaged.reason))


def next_step(result: FlightResult) -> str:
    """Return what to inspect before the next flight, else how to fly or log better."""
    account, first = present(result.account), next(iter(result.advice), None)
    found = (*(() if account is None else account.causes_first), *_damages(result))
    otherwise = "" if first is None else f"{first.do.rstrip('.')}."
    return next((finding.advice for finding in found if finding.advice), otherwise)


#: Time shown before and after what happened, s.
_BEFORE, _AFTER = 8.0, 6.0
#: The signal that shows each kind of happening; height where none is named.
_SHOWS: Mapping[str, Picture] = {
    "motor-fault": Picture.MOTORS,
    "control-lost": Picture.ATTITUDE,
    "oscillation": Picture.RATES,
    "yaw-lost": Picture.MOTORS,
    "vibration": Picture.VIBRATION,
    "gps-lost": Picture.GPS,
    "gps-glitch": Picture.GPS,
    "crash": Picture.ATTITUDE,
}
_FAILSAFES: Mapping[str, Picture] = {"FAILSAFE_BATTERY": Picture.BATTERY, "FAILSAFE_GPS": Picture.GPS}


def picture_of(result: FlightResult) -> tuple[Picture, Span | None]:
    """Choose the plot of the first screen, and the time span that it shows; None for the whole flight."""
    account, flight = present(result.account), present(result.flight)
    if account is not None and flight is not None and (cause := account.cause) is not None:
        last = account.story[-1]
        end = max(last.t, min(last.end, cause.t + 20.0))
        around = Span(max(cause.t - _BEFORE, flight.start - 2.0), end + _AFTER)
        picture = _SHOWS.get(cause.id, Picture.ALTITUDE)
        picture = _FAILSAFES.get(str(cause.evidence.get("subsystem")), picture)
        return (picture if _drawn(result, picture) else Picture.ALTITUDE), around
    return Picture.ALTITUDE, None


def _drawn(result: FlightResult, picture: Picture) -> bool:
    """Return whether the log has the signal."""
    if picture is Picture.MOTORS:
        return result.motors is not None and result.motors.shape[1] > 0
    if picture is Picture.ALTITUDE or isinstance(result.signals, Failure):
        return False
    return bool(getattr(result.signals, str(picture)))


_TONES = {Severity.INFO: Tone.GOOD, Severity.WARNING: Tone.CARE, Severity.ERROR: Tone.BAD}
#: Full thrust over the weight that pilots are advised to have, and part of a volt per cell that is spent.
_ADVISED, _SPENT = 2.0, 3.3
#: Share of a flight with a motor at its limit that is more than a manoeuvre, and spread of the motors' work that a
#: balanced craft does not have, and that needs no name.
_AT_LIMIT, _UNEVEN, _ALIKE = 0.05, 0.15, 0.05
#: Change of the hover throttle that tells nothing of the battery or the load.
_STEADY = 0.025


def happened(account: Account) -> AnswerLine:
    """Answer with the story of the flight in a sentence."""
    story, notable = account.story, account.notable
    tone = Tone.UNKNOWN if account.flight is None else Tone.GOOD
    if story:
        tone = _TONES[min((finding.severity for finding in story), key=list(_TONES)[::-1].index)]
    elif notable or account.unseen:
        tone = Tone.CARE
    remark = ""
    if notable and not story:
        # Vibration stands in a line of its own.
        remark = " Look at vibration." if notable[0].id == "vibration" else f" To know: {notable[0].reason}"
    return AnswerLine(purpose="Happened", word=account.in_short, tone=tone, text=account.headline + remark)


def state_lines(account: Account, full: float | None) -> Iterator[AnswerLine]:
    """Yield how it flew, battery, vibration, GPS, thrust (`full_thrust`) and motors, each where the log tells it."""
    if account.flight is None:
        return
    flown = _flown(account)
    if flown is not None:
        yield flown
    if account.battery is not None:
        yield _battery(account.battery)
    if account.vibration is not None:
        yield _vibration(account.vibration, harmful=any(finding.id == "vibration" for finding in account.notable))
    if account.gps is not None:
        yield _gps(account.gps, [finding for finding in account.notable if finding.id == "gps-glitch"])
    if account.hover is not None:
        yield _thrust(account.hover, full)
    if account.motors is not None:
        yield _motors(account.motors, failed=any(finding.id == "motor-fault" for finding in account.story))


def _line(purpose: str, text: str, *, care: bool, bad: bool = False) -> AnswerLine:
    return AnswerLine(purpose=purpose, word="", tone=Tone.BAD if bad else Tone.CARE if care else Tone.GOOD, text=text)


def _flown(account: Account) -> AnswerLine | None:
    """Return how long, high, far and fast; None where the first line has said it and all sources agree."""
    assert account.flight is not None
    height = account.height
    disputed = height is not None and any(
        abs(other - height.value) > max(1.0, 0.3 * height.value) for other in height.others.values()
    )
    if not account.story and not disputed:
        return None
    shown = "" if height is None else f"{number(height.value, 2)} m high"
    if height is not None and disputed:
        others = ", ".join(f"{name} {number(value, 2)}" for name, value in height.others.items())
        shown += f" by {height.source} ({others})"
    if not account.story:
        return _line("Height", shown.replace(" high", ""), care=True)
    parts = [duration(account.flight.duration), shown]
    for reading, words in ((account.distance, " away"), (account.ground_speed, "")):
        parts += [] if reading is None else [f"{number(reading.value, 2)} {reading.unit}{words}"]
    return _line("Flown", ", ".join(part for part in parts if part), care=disputed)


def _battery(battery: BatteryReading) -> AnswerLine:
    per_cell = None if battery.cells is None else battery.lowest / battery.cells
    text = f"{battery.start:.1f} to {battery.end:.1f} V, lowest {battery.lowest:.1f} V"
    text += "" if per_cell is None else f" ({per_cell:.2f}/cell)"
    return _line("Battery", text, care=per_cell is not None and per_cell < _SPENT)


def _vibration(shaken: VibrationReading, *, harmful: bool) -> AnswerLine:
    """Answer with the worst of a flight: where nothing else shook it, that of a crash or a landing."""
    along = f"{shaken.axis}, " if shaken.axis else ""
    clips = f", {shaken.clips} clips" if shaken.clips else ""
    text = f"{number(shaken.worst, 2)} m/s² ({along}{shaken.t:.0f} s; limit {shaken.advised:.0f}){clips}"
    return _line("Vibration", text, care=shaken.worst > shaken.advised, bad=harmful)


def _gps(gps: GpsReading, jumps: Sequence[Finding]) -> AnswerLine:
    if gps.fix_share < 0.005:
        return _line("GPS", "no fix", care=True)
    least = "always fixed" if gps.satellites_least is None else f"{gps.satellites_least}+ satellites"
    text = least if gps.fix_share > 0.995 else f"fix {100.0 * gps.fix_share:.0f} % of the time"
    jumped = max((float(jump.evidence["jump_m"] or 0.0) for jump in jumps), default=0.0)
    text += f", jumped by {number(jumped, 2)} m" if jumped else ""
    return _line("GPS", text, care=gps.fix_share < 0.99 or jumped > 0.0)


def _thrust(hover: HoverReading, full: float | None) -> AnswerLine:
    steady = abs(hover.end - hover.start) < _STEADY
    text = (
        f"hovers at {100.0 * hover.start:.0f} %"
        + ("" if steady else f", later {100.0 * hover.end:.0f} %")
        + " throttle"
    )
    text += "" if full is None else f"; at most {number(full, 2)} × weight"
    return _line("Thrust", text, care=full is not None and full < _ADVISED)


def _motors(motors: MotorsReading, *, failed: bool) -> AnswerLine:
    spread = f"{max(100.0 * motors.spread, 1.0):.0f} %"
    text = f"{motors.hardest} works hardest, by {spread}" if motors.spread > _ALIKE else f"alike within {spread}"
    text = f"one failed; {motors.hardest} works hardest, by {spread}" if failed else text
    text += f"; at a limit {100.0 * motors.at_limit:.0f} %" if motors.at_limit > _AT_LIMIT else ""
    return _line("Motors", text, care=motors.at_limit > _AT_LIMIT or motors.spread > _UNEVEN, bad=failed)


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
    swings = [] if account is None else [finding.evidence for finding in account.notable if finding.id == "oscillation"]
    if swings:
        axes = " and ".join(dict.fromkeys(str(swing["axis"]) for swing in swings))
        hz = max(float(swing["frequency_hz"] or 0.0) for swing in swings)
        return AnswerLine(purpose="Loops", word="oscillate", tone=Tone.BAD, text=f"in {axes}", value=hz, unit="Hz")
    margins = {} if isinstance(result.rotation, Failure) else result.rotation.loops
    known = {axis: margin for axis, margin in margins.items() if _determined(margin.computed.phase_deg)}
    return _margins(known) if known else _bandwidth(result)


def _determined(number: Parameter) -> bool:
    """Return whether a number is known to half of itself at least: 5 ± 11 degrees are no margin."""
    return number.value is not None and number.sigma is not None and 2.0 * number.sigma < abs(number.value)


def _margins(known: Mapping[str, AxisMargins]) -> AnswerLine:
    """Answer with the axis whose phase margin is smallest; the word is that of the worst of all axes."""
    axis = min(known, key=lambda name: known[name].computed.phase_deg.value or 0.0)
    phase, states = known[axis].computed.phase_deg, [margins.state for margins in known.values()]
    word, tone = next(_STATES[state] for state in _STATES if state in states)
    gains = [margins.computed.gain_db for margins in known.values() if _determined(margins.computed.gain_db)]
    least = min(gains, key=lambda parameter: parameter.value or 0.0, default=None)
    text = f"phase margin in {axis}" + ("" if least is None else f", gain {uncertain(least.value, least.sigma, 'dB')}")
    text += " (without chirps)" if any(margins.ordinary for margins in known.values()) else ""
    return AnswerLine(purpose="Loops", word=word, tone=tone, text=text, value=phase.value, sigma=phase.sigma, unit="°")


def _bandwidth(result: FlightResult) -> AnswerLine | None:
    axes = () if isinstance(result.rotation, Failure) else result.rotation.axes
    known = {
        axis.axis: axis.attitude.bandwidth
        for axis in axes
        if axis.attitude is not None and _determined(axis.attitude.bandwidth) and axis.axis != "yaw"
    }
    if not known:
        return None
    axis = min(known, key=lambda name: known[name].value or 0.0)
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
    fitted = [model.report for model in result.models if not isinstance(model.model, Failure)]
    if not fitted:
        needed = (result.flight, result.trajectory, result.experiment, *(model.model for model in result.models))
        reason = next((failure.reason for failure in needed if isinstance(failure, Failure)), "no model")
        return _none("no model", brief(reason))
    best = max(fitted, key=lambda model: model.uses.prediction.horizon_s or 0.0)
    use, changed = best.uses.prediction, changed_load(result)
    if not use.holds:
        tried = f"{counted(len(fitted), 'model')} tried"
        if any(model.uses.prediction.judged for model in fitted):
            return _none("none holds", tried)
        missing = next((model.missing for model in fitted if model.missing), "too little flight was held out")
        return _none("not judged", f"{tried}: {brief(missing)}")
    text = f"by {best.short}, {_error(use)}"
    word, tone = ("yes", Tone.GOOD)
    if changed:
        # Models were fitted to two loads, and this held after the change only.
        word, tone, text = "with care", Tone.CARE, f"{text}; {changed}"
    value, sigma = use.ahead
    return AnswerLine(purpose="Predict ahead", word=word, tone=tone, text=text, value=value, sigma=sigma, unit="s")


def _none(word: str, text: str) -> AnswerLine:
    return AnswerLine(purpose="Predict ahead", word=word, tone=Tone.UNKNOWN, text=text)


def _error(use: PredictionUse) -> str:
    """Write the RMS error at the longest horizon, over all axes."""
    error = math.sqrt(sum(value**2 for value in use.rmse_m.values()))
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
    rows = _headlines(result)
    known: list[tuple[str, float, float, str]] = []
    unknown = []
    for label, names in _SHOWN:
        name = next((name for name in names if name in rows), None)
        if name is None:
            unknown.append(label)
        else:
            known_value, error, in_full = rows[name]
            what = _divided(name, in_full) + (" per motor" if label == "thrust" else "")
            known.append((what, known_value, error, bare_unit(in_full)))
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


def full_thrust(result: FlightResult) -> float | None:
    """Return the full thrust over the weight, in the air and with the battery of the flight; None where undetermined.

    Throttle does not tell it: autopilots correct theirs for air and battery, and old ones are no share of the thrust.
    """
    thrust, stated = present(result.thrust), _headlines(result).get("thrust over mass")
    if thrust is None or stated is None or not thrust.hover_command or changed_load(result):
        return None
    value, _, unit = stated
    own = thrust.common.newton if unit.startswith("N") else thrust.common.per_mass
    return None if not own else value / own / curve(np.array(thrust.hover_command), thrust.thrust_expo).item()


def _headlines(result: FlightResult) -> Mapping[str, tuple[float, float, str]]:
    """Return the best value of each parameter; where no method could be applied, of thrust that of its own fit."""
    rows, thrust = parameter_rows(result.parameters), present(result.thrust)
    if rows is None and thrust is not None and thrust.common.determined:
        name, common = "thrust over mass", thrust.common
        return (
            {} if common.per_mass is None or not common.sigma else {name: (common.per_mass, common.sigma, UNITS[name])}
        )
    return headlines(rows)


def _divided(parameter: str, unit: str) -> str:
    """Name a number as its unit has it: motion alone gives no inertia, but its ratio to mass and arm."""
    name, divisor = quantity(parameter, unit)
    if not divisor:
        return name
    return f"{name}/({divisor.replace(' and ', '·')})" if " and " in divisor else f"{name}/{divisor}"


#: Words of a reason that a line has room for.
_BRIEF = 12


def brief(reason: str) -> str:
    """Return the first clause of a reason, cut to what a line has room for; in small letters, as it follows a word."""
    first = re.sub(r"^(The|A|An|No|Only|It|There|Nothing|Too|About) ", lambda match: match[0].lower(), clause(reason))
    words = first.split()
    return first if len(words) <= _BRIEF else " ".join(words[:_BRIEF]) + " …"


def changed_load(result: FlightResult) -> str:
    """Describe from when on the same commands gave another thrust per mass; empty when they did not."""
    findings = () if isinstance(result.thrust, Failure) else result.thrust.findings
    evidence = next((finding.evidence for finding in findings if finding.id == THRUST_CHANGED), None)
    if evidence is None:
        return ""
    change, time = (float(evidence[name] or 0.0) for name in ("change", "time"))
    return f"thrust/mass changed by {100.0 * change:+.0f} % at {time:.0f} s"
