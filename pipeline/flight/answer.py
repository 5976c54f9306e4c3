"""What a flight says, by purpose: `compose_answer` chooses words and numbers that cannot contradict each other.

Every word follows from a number by a rule that stands here; texts are short, because all six lines, the heading and
the captions of two plots must be read in ten seconds. Full reasons stand further down in a report.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from logparse import MissingDataError
from logparse.frames import OTHER_CRAFT
from logparse.quantity import duration, number, uncertain
from pipeline.flight.kinds import RIGID_BODY_KEY
from pipeline.flight.purposes import uses_of
from pipeline.results.answer import Answer, AnswerLine, Picture, Tone
from pipeline.results.failure import Failure, present
from pipeline.results.flight import FlightResult, ModelResult
from pipeline.results.rotation import LoopState
from pipeline.results.span import Span
from pipeline.results.verdict import PredictionUse, Trust
from sysid.rigid_body.frame_json import frame_json
from sysid.rigid_body.model import RigidBodyModel
from sysid.rigid_body.physical import HEADLINE, UNITS, quantity
from sysid.rotors.thrust_regression import BLOCK_SECONDS, THRUST_CHANGED, regress

if TYPE_CHECKING:
    from logparse import FlightEvent
    from pipeline.results.health import FlightHealth
    from pipeline.results.loops import FlightLoops
    from pipeline.results.rotation import LoopMargins

#: Words of a reason that a line has room for.
_BRIEF = 12
#: Words of a reason that stands in brackets.
_SHORT_REASON = 8
#: Time shown before and after an event, s.
_BEFORE, _AFTER = 8.0, 6.0
#: Time between the end of a loss of control and the crash that it led to, s.
_LED = 2.0
#: Time about a flight that still belongs to it, s: a crash is logged after the last moment in the air.
_LANDING = 5.0

#: Fewest blocks of a flight for a mean over them.
_FEWEST_BLOCKS = 5

#: Parameters of the first screen: name, and rows of `PhysicalParameters.table` in order of preference.
_SHOWN = (
    ("thrust", ("thrust over mass",)),
    ("inertia", ("roll inertia over mass and arm", "pitch inertia over mass and arm")),
    ("drag", ("linear drag over mass", "quadratic drag over mass")),
)


def compose_answer(result: FlightResult) -> Answer:
    """Sum a flight up for its first screen.

    Parameters
    ----------
    result : FlightResult
        Complete but for its answer.
    """
    model = _shown(result)
    picture, around = _picture(result, model)
    unfit = _unfit(result)
    if unfit:
        rest = tuple(
            AnswerLine(purpose=purpose, word=word, tone=Tone.UNKNOWN, text=unfit) for purpose, word in _UNFIT.items()
        )
    else:
        rest = (_loops(result), _ahead(result), _parameters(result), _simulate(result))
    lines = (_flown(result), _healthy(result), *rest)
    return Answer(lines=lines, picture=picture, around=around, model=model if picture is Picture.PREDICTION else "")


#: Purposes that no log of the ground and of no other robot serves, with their word.
_UNFIT = {"Loops": "not known", "Predict ahead": "no model", "Parameters": "not known", "Simulate": "no"}


def _unfit(result: FlightResult) -> str:
    """Explain in a clause why nothing can be fitted to a log at all; empty where it can be tried."""
    if result.log.vehicle.firmware in OTHER_CRAFT:
        return f"only for multirotors, this is {result.log.vehicle.firmware}"
    return "needs a flight" if isinstance(result.flight, Failure) else ""


def _flown(result: FlightResult) -> AnswerLine:
    """Answer how long, how high, how far and how fast; heights and distances are from where it began."""
    flight, trajectory = result.flight, result.trajectory
    if isinstance(flight, Failure):
        why = flight.reason.removeprefix("The log shows no flight: ")
        return AnswerLine(purpose="Flown", word="no", tone=Tone.UNKNOWN, text=_brief(why))
    rows = None if isinstance(trajectory, Failure) else trajectory.states.loc[flight.start : flight.stop]
    if isinstance(trajectory, Failure) or rows is None or not len(rows) or trajectory.inconsistency:
        known = not isinstance(trajectory, Failure) and rows is not None and len(rows) > 0
        why = "sensors disagree" if known else "its course is not known"
        return AnswerLine(purpose="Flown", word=duration(flight.duration), tone=Tone.UNKNOWN, text=why)
    sigma = trajectory.sigma.loc[rows.index]
    high = int(rows["p_d"].to_numpy().argmin())
    climb = float(rows["p_d"].iloc[0] - rows["p_d"].iloc[high])
    text = "high"
    if result.position_known:
        north, east = rows["p_n"].to_numpy(np.float64), rows["p_e"].to_numpy(np.float64)
        away = np.hypot(north - north[0], east - east[0])
        far = int(away.argmax())
        speed = np.linalg.norm(rows[["v_n", "v_e", "v_d"]].to_numpy(np.float64), axis=1)
        fast = int(speed.argmax())
        text += f", {uncertain(float(away[far]), _largest(sigma, ('p_n', 'p_e'), far), 'm')} away"
        text += f", up to {uncertain(float(speed[fast]), _largest(sigma, ('v_n', 'v_e', 'v_d'), fast), 'm/s')}"
    return AnswerLine(
        purpose="Flown",
        word=duration(flight.duration),
        tone=Tone.GOOD,
        text=text,
        value=climb,
        sigma=_largest(sigma, ("p_d",), high),
        unit="m",
    )


def _largest(sigma: pd.DataFrame, columns: Sequence[str], row: int) -> float:
    """Return the sigma of a difference from the first row, at most: the errors of both rows count, whichever way."""
    return math.hypot(*(float(sigma[column].iloc[each]) for column in columns for each in (0, row)))


def _healthy(result: FlightResult) -> AnswerLine:
    def line(word: str, tone: Tone, text: str, value: float | None = None, **more: float | str | None) -> AnswerLine:
        sigma, unit = more.get("sigma"), more.get("unit", "")
        return AnswerLine(
            purpose="Healthy",
            word=word,
            tone=tone,
            text=text,
            value=value,
            sigma=sigma if isinstance(sigma, float) else None,
            unit=str(unit),
        )

    health = result.health
    if isinstance(health, Failure):
        return line("not known", Tone.UNKNOWN, _brief(health.reason))
    if isinstance(result.flight, Failure):
        return line("not known", Tone.UNKNOWN, _on_the_ground(health))
    worst = _worst(health, result.flight)
    if worst is not None:
        tone = Tone.BAD if str(worst.severity) == "error" else Tone.CARE
        word = "no" if tone is Tone.BAD else "check"
        others = len(health.notable) - 1
        more = f"; {others} more event{'s' if others > 1 else ''}" if others else ""
        loss = worst.evidence.get("thrust_loss")
        if worst.evidence.get("at_once"):
            several = f"motors {worst.evidence['at_once']} out of balance at once, from {worst.t:.1f} s{more}"
            return line(word, tone, several)
        if isinstance(loss, float):
            sigma = 100.0 * float(worst.evidence["thrust_loss_sigma"] or 0.0)
            output = worst.evidence.get("output_loss")
            part = f" ({100.0 * output:.0f} % of its output)" if isinstance(output, float) and loss <= 0.9 else ""
            text = f"of motor {worst.evidence['motor']}'s thrust lost from {worst.t:.1f} s{part}{more}"
            return line(word, tone, text, 100.0 * loss, sigma=sigma, unit="%")
        where = "" if worst in _during(health, result.flight) or worst is health.cause else " in another flight"
        before = _led_to(worst, health)
        if before is not None:
            others -= 1
            more = f"; {others} more event{'s' if others > 1 else ''}" if others else ""
            text = f"{_named(before)} at {before.t:.1f} s, {_named(worst)} at {worst.t:.1f} s{where}{more}"
            return line(word, tone, text)
        return line(word, tone, f"{_named(worst)}{where} at {worst.t:.1f} s{more}")
    unchecked = "; motors not checked" if health.motors_missing else ""
    tone = Tone.UNKNOWN if unchecked else Tone.GOOD
    word = "nothing seen" if unchecked else "yes"
    panels = () if health.signals is None else health.signals.vibration
    peaks = [float(abs(signal.y).max()) for panel in panels for signal in panel.signals if len(signal.y)]
    if peaks and math.isfinite(max(peaks)):
        # Above the limit without an event: for less time than a warning takes.
        advised = min(panels[0].limits.values())
        moment = ", for a moment only" if max(peaks) > advised else ""
        text = f"largest vibration{moment} (advised below {number(advised, 2)}), no event{unchecked}"
        return line(word, tone, text, max(peaks), unit="m/s²")
    text = f"in the air without an event; vibration not logged{unchecked}"
    return line(word, tone, text, result.flight.duration, unit="s")


def _on_the_ground(health: FlightHealth) -> str:
    """Return what the autopilot complained of last in a log without a flight."""
    said = [event for event in health.events if event.id in ("failsafe-triggered", "autopilot-error")]
    if not said:
        return "on the ground; the autopilot reported no failsafe and no error"
    last = said[-1]
    what = last.reason.partition(": ")[2].rstrip(".") or last.reason.rstrip(".")
    kind = "failsafe" if last.id == "failsafe-triggered" else "error"
    return f"on the ground; last {kind} reported: {what} at {last.t:.1f} s"


def _worst(health: FlightHealth, flight: Span) -> FlightEvent | None:
    """Return the event to name: what ended the flight, else the first that endangers, else the first to look into.

    Events of other flights of the log come after those of the flight that is analysed.
    """
    inside = _during(health, flight)
    errors = [event for event in inside if str(event.severity) == "error"]
    return health.cause or next(iter((*errors, *inside, *health.notable)), None)


def _led_to(event: FlightEvent, health: FlightHealth) -> FlightEvent | None:
    """Return what a crash came from: the loss of control before it, or the motor that dropped out before that."""
    if event.id != "crash":
        return None
    lost = [each for each in health.notable if each.id == "loss-of-control" and each.t < event.t <= each.end + _LED]
    begin = lost[0].t if lost else event.t
    dropped = [each for each in health.notable if each.id == "motor-dropout" and 0.0 <= begin - each.end <= _LED]
    return next(iter((*dropped, *lost)), None)


def _named(event: FlightEvent) -> str:
    words = event.id.replace("-", " ")
    return f"dropout of motor {event.evidence['motor']}" if event.id == "motor-dropout" else words


def _during(health: FlightHealth, flight: Span) -> list[FlightEvent]:
    """Return the notable events of the analysed flight, its landing included."""
    return [event for event in health.notable if flight.start - _LANDING <= event.t <= flight.stop + _LANDING]


def _loops(result: FlightResult) -> AnswerLine:
    loops = result.loops
    if isinstance(loops, Failure):
        return AnswerLine(purpose="Loops", word="not known", tone=Tone.UNKNOWN, text=_brief(loops.reason))
    if loops.oscillations_hz:
        axis, hz = max(loops.oscillations_hz.items(), key=lambda each: each[1])
        named = " and ".join(loops.oscillations_hz)
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
    return _margins(known, result) if known else _unmeasured(result, loops)


#: Word and colour of what margins say, worst first.
_STATES = {
    LoopState.UNSTABLE: ("unstable", Tone.BAD),
    LoopState.THIN: ("thin", Tone.CARE),
    LoopState.UNKNOWN: ("partly known", Tone.CARE),
    LoopState.GOOD: ("good", Tone.GOOD),
}


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
        _brief(each.loop_reason.removeprefix(f"{each.axis}: "))
        for each in (() if rotation is None else rotation.axes)
        if each.axis in axes
    }
    reason = reasons.pop() if len(reasons) == 1 else ""
    return f" ({reason})" if 0 < len(reason.split()) <= _SHORT_REASON else ""


def _unmeasured(result: FlightResult, loops: FlightLoops) -> AnswerLine:
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
    if not loops.tracking_rad:
        return AnswerLine(purpose="Loops", word="not measured", tone=Tone.UNKNOWN, text=fly)
    axis, error = max(loops.tracking_rad.items(), key=lambda each: each[1])
    return AnswerLine(
        purpose="Loops",
        word="partly known",
        tone=Tone.UNKNOWN,
        text=f"RMS error of {axis} against its target; {fly}",
        value=math.degrees(error),
        unit="°",
    )


def _ahead(result: FlightResult) -> AnswerLine:
    """Answer with the model that predicts furthest, and its error there."""
    fitted = [each for each in result.models if not isinstance(each.model, Failure)]
    if not fitted:
        needed = (result.flight, result.trajectory, result.experiment, *(each.model for each in result.models))
        reason = next((each.reason for each in needed if isinstance(each, Failure)), "no model")
        return AnswerLine(purpose="Predict ahead", word="no model", tone=Tone.UNKNOWN, text=_brief(reason))
    uses = {each.key: uses_of(present(each.validation), present(each.model)).prediction for each in fitted}
    names = {each.key: each.title.partition(" →")[0] for each in fitted}
    able = {key: use for key, use in uses.items() if use.horizon_s is not None}
    if not able:
        judged = any(use.judged for use in uses.values())
        text = (
            f"none of {len(fitted)} model{'s' if len(fitted) > 1 else ''} halves the error of constant velocity"
            if judged
            else _brief(next((each.missing for each in fitted if each.missing), "too little flight was held out"))
        )
        word, tone = ("no", Tone.BAD) if judged else ("not judged", Tone.UNKNOWN)
        return AnswerLine(purpose="Predict ahead", word=word, tone=tone, text=text)
    best = max(able, key=lambda key: able[key].horizon_s or 0.0)
    reach, sigma = able[best].reach_s, able[best].reach_sigma_s
    text = f"by {names[best]}, {_error(able[best])}"
    second = sorted((key for key in able if key != best), key=lambda key: able[key].horizon_s or 0.0)[-1:]
    text += "".join(f"; {names[key]} {able[key].horizon_s:g} s" for key in second)
    longest = able[best].horizon_s
    # What predicts shorter than a person needs to react is of use to a filter only.
    word, tone = ("yes", Tone.GOOD) if longest is not None and longest >= 1.0 else ("briefly", Tone.CARE)
    if changed := _changed(result):
        # Models were fitted to two loads, and this held after the change only.
        word, tone, text = "with care", Tone.CARE, f"{text}; {changed}"
    value = longest if reach is None else reach
    return AnswerLine(purpose="Predict ahead", word=word, tone=tone, text=text, value=value, sigma=sigma, unit="s")


def _changed(result: FlightResult) -> str:
    """Describe from when on the same commands gave another thrust per mass; empty when they did not."""
    findings = () if isinstance(result.thrust, Failure) else result.thrust.findings
    evidence = next((finding.evidence for finding in findings if finding.id == THRUST_CHANGED), None)
    if evidence is None:
        return ""
    change, time = (float(evidence[name] or 0.0) for name in ("change", "time"))
    return f"thrust/mass changed by {100.0 * change:+.0f} % at {time:.0f} s"


def _error(use: PredictionUse) -> str:
    """Write the RMS error at the longest horizon, over all axes; from which horizon on where not from the shortest."""
    error = math.sqrt(sum(each**2 for each in use.rmse_m.values()))
    since = f", from {use.horizons_s[0]:g} s" if use.horizons_s[0] > 0.1 and len(use.horizons_s) > 1 else ""
    there = "" if use.reach_s is None else f" at {use.horizon_s:g} s"
    return f"± {number(error, 2)} m{there}{since}"


def _parameters(result: FlightResult) -> AnswerLine:
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
        needed = (result.thrust, result.parameters)
        reasons = (each.reason for each in needed if isinstance(each, Failure))
        reason = next(reasons, "the flight determines none of them")
        value, sigma = _mean_output(result) or (None, None)
        return AnswerLine(
            purpose="Parameters",
            word="not known" if value is None else "hardly",
            tone=Tone.UNKNOWN,
            text=_brief(reason) if value is None else "mean motor output only",
            value=value,
            sigma=sigma,
            unit="" if value is None else "µs",
        )
    what, value, sigma, unit = known[0]
    parts = [what]
    parts += [f"{name} {uncertain(known_value, error, its_unit)}" for name, known_value, error, its_unit in known[1:]]
    text = ", ".join(parts)
    if unknown:
        text += f"; {' and '.join(unknown)} not determined"
    disagree = not isinstance(result.parameters, Failure) and bool(result.parameters.findings)
    if disagree:
        text += "; methods disagree"
    changed = _changed(result)
    if changed:
        text += f"; {changed}: of neither load"
    complete = not unknown and not disagree and not changed
    word = "known" if complete else "disputed" if disagree or changed else "partly"
    tone = Tone.GOOD if complete else Tone.CARE
    return AnswerLine(purpose="Parameters", word=word, tone=tone, text=text, value=value, sigma=sigma, unit=unit)


def _mean_output(result: FlightResult) -> tuple[float, float] | None:
    """Return the mean output of all motors in the air, µs, with its standard error over blocks of the flight."""
    if result.motors is None or isinstance(result.flight, Failure):
        return None
    rows = result.motors.loc[result.flight.start : result.flight.stop].mean(axis=1).dropna()
    blocks = rows.groupby(np.floor(rows.index.to_numpy(np.float64) / BLOCK_SECONDS)).mean().to_numpy(np.float64)
    if len(blocks) < _FEWEST_BLOCKS:
        return None
    fit = regress([np.ones((len(blocks), 1))], [blocks])
    (mean,), (sigma,) = fit.values, fit.sigma  # noqa: PD011 (of a fit, not of a table)
    return float(mean), float(sigma)


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


def _simulate(result: FlightResult) -> AnswerLine:
    """Answer whether ArduPilot's simulator can fly this craft, and how many of its numbers the flight determined."""
    body = _model(result, RIGID_BODY_KEY)
    model = None if body is None else body.model
    if body is None or not isinstance(model, RigidBodyModel):
        reason = "no rigid body model" if body is None or not body.missing else _brief(body.missing)
        return AnswerLine(purpose="Simulate", word="no", tone=Tone.UNKNOWN, text=reason)
    try:
        frame = frame_json(model, result.config.mass)
    except MissingDataError as error:
        needs = "give the mass (--mass)" if result.config.mass is None and model.mass is None else _brief(str(error))
        return AnswerLine(purpose="Simulate", word="not yet", tone=Tone.UNKNOWN, text=f"SITL frame: {needs}")
    count = len(frame.frame)
    known = count - len(frame.undetermined)
    confirmed = uses_of(present(body.validation), model).parameters.trust is Trust.YES
    text = f"of {count} SITL frame numbers from flight"
    if not confirmed:
        text += "; not confirmed by predictions"
    word, tone = ("yes", Tone.GOOD) if confirmed else ("with care", Tone.CARE)
    return AnswerLine(purpose="Simulate", word=word, tone=tone, text=text, value=float(known))


def _model(result: FlightResult, key: str) -> ModelResult | None:
    return next((each for each in result.models if each.key == key), None)


def _picture(result: FlightResult, model: str) -> tuple[Picture, Span | None]:
    """Choose the plot that matters most: what failed, else how the models predict, else how the attitude followed."""
    health = present(result.health)
    signals = None if health is None else health.signals
    event = health.cause if health is not None else None
    if event is None and health is not None and not isinstance(result.flight, Failure):
        event = next((each for each in _during(health, result.flight) if str(each.severity) == "error"), None)
    if event is not None and not isinstance(result.flight, Failure):
        around = Span(max(event.t - _BEFORE, result.flight.start), event.t + _AFTER)
        if result.motors is not None and result.motors.shape[1] and (event.id == "motor-loss" or not _asked(result)):
            return Picture.MOTORS, around
        if signals is not None and signals.attitude:
            return Picture.ATTITUDE, around
    if model:
        return Picture.PREDICTION, None
    if signals is not None and signals.attitude:
        return Picture.ATTITUDE, None
    return Picture.ALTITUDE, None


def _shown(result: FlightResult) -> str:
    """Choose the model whose free run is shown: of those that follow the flight, the one that predicts furthest."""
    best, furthest = "", -1.0
    for each in result.models:
        uses = uses_of(present(each.validation), present(each.model))
        reach = uses.prediction.horizon_s or 0.0
        if each.predictions and uses.free_run.trust in (Trust.YES, Trust.LIMITED) and reach > furthest:
            best, furthest = each.key, reach
    return best


def _asked(result: FlightResult) -> bool:
    """Return whether asked and flown attitude are known."""
    health = present(result.health)
    return health is not None and health.signals is not None and bool(health.signals.attitude)


def _brief(reason: str) -> str:
    """Return the first clause of a reason, cut to what a line has room for; the whole stands further down."""
    clause = re.split(r"[:;(]|\. ", reason, maxsplit=1)[0].strip().rstrip(".")
    words = clause.split()
    return clause if len(words) <= _BRIEF else " ".join(words[:_BRIEF]) + " …"
