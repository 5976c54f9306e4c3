"""The first screen of a folder: its best insight, then the answers of its flights, counted, with the worst named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime

from core.quantity import counted, duration, number, uncertain
from pipeline.results.account import GRAVITY, gravity
from pipeline.results.answer import HOLDS, AnswerLine, Tone
from pipeline.results.drift import History, Step
from pipeline.results.model_report import ModelReport
from pipeline.results.report import CraftReport, FleetReport, FlightReport
from pipeline.results.verdict import PredictionUse
from reports.views import summary
from reports.views.summary import ShownAnswer, thrust_known, thrust_of


@dataclass(frozen=True, slots=True)
class Insight:
    """What changed over the flights of a craft, in a sentence."""

    text: str
    craft: CraftReport
    history: History | None = None  #: None where it is about its motors.


def insight(numbers: FleetReport) -> Insight | None:
    """Return the change over flights that is least likely chance; a weakening motor before all; None without one."""
    found: list[tuple[float, Insight]] = []
    for craft in numbers.groups:
        if craft.drift is None:
            continue
        motors = craft.drift.motors
        if motors is not None and motors.weakening:
            found.append((0.0, Insight(summary.sentence(motors.sentence), craft)))
        for each in craft.drift.parameters:
            change = each.change
            if change is not None:
                found.append((change.p, Insight(_changed(each), craft, each)))
    return min(found, key=lambda each: each[0], default=(1.0, None))[1]


def _changed(history: History) -> str:
    """Write a step, or a trend from the first flight to the last, in percent of what was before."""
    change, points = history.change, history.flights
    if isinstance(change, Step):
        before = [each.value for each in points if each.number < change.number]
        whole, sigma = change.change, change.sigma
        first, last = (next(each for each in points if each.flight == name) for name in (change.before, change.after))
    else:
        assert change is not None
        first, last = points[0], points[-1]
        flights = last.number - first.number
        before, whole, sigma = [first.value], flights * change.per_flight, flights * change.per_flight_sigma
    name = f"{history.parameter[:1].upper()}{history.parameter[1:]}"
    base = abs(sum(before) / len(before)) if before else 0.0
    verb = "fell" if whole < 0.0 else "rose"
    by = uncertain(abs(whole), sigma) if not base else uncertain(100.0 * abs(whole) / base, 100.0 * sigma / base, "%")
    days = [_day(each.start_utc) for each in (first, last)]
    told = all(days) and days[0] != days[1]
    between = f"{days[0]} and {days[1]}" if told else f"{first.flight} and {last.flight}"
    return f"{name} {verb} by {by} between {between}."


def _day(start: str | None) -> str:
    return "" if start is None else f"{(day := datetime.fromisoformat(start)).day} {day:%B %Y}"


def fleet_answer(numbers: FleetReport) -> list[ShownAnswer]:
    """Sum all flights up, the best insight first, then a line for each purpose."""
    if not numbers.flights:
        return [_line("Happened", "no", Tone.UNKNOWN, "", "No log gave a flight.")]
    flights = [flight for flight in numbers.flights if flight.name not in numbers.again]
    changed, health = insight(numbers), _health(flights)
    first = health if changed is None else _line("Changed", "changed", Tone.CARE, "", changed.text)
    rest = [] if changed is None else [health]
    lines = [_flown(flights), _loops(flights), _parameters(numbers), _ahead(numbers)]
    return [first, *rest, *(each for each in lines if each is not None)]


def _line(purpose: str, word: str, tone: Tone, shown: str, text: str) -> ShownAnswer:
    return ShownAnswer(AnswerLine(purpose=purpose, word=word, tone=tone, text=text), shown)


def _flown(flights: Sequence[FlightReport]) -> ShownAnswer:
    flown = [flight.flight for flight in flights if flight.flight]
    high = max((each.height_m for each in flown if each.height_m is not None), default=None)
    fast = max((each.speed_max_m_s for each in flown if each.speed_max_m_s is not None), default=None)
    reach = [] if high is None else [f"{number(high, 2)} m high"]
    reach += [] if fast is None else [f"{number(fast, 2)} m/s"]
    text = duration(sum(each.duration_s for each in flown)) + (f", up to {' and '.join(reach)}" if reach else "")
    return _line("Flown", "", Tone.GOOD, f"{counted(len(flights), 'flight')},", text)


def _said(flights: Sequence[FlightReport], purpose: str) -> list[tuple[str, ShownAnswer]]:
    """Return the answers for a purpose with the names of their flights."""
    found = ((flight.name, summary.answers(flight.answer).get(purpose)) for flight in flights)
    return [(name, shown) for name, shown in found if shown is not None]


def _health(flights: Sequence[FlightReport]) -> ShownAnswer:
    """Answer with how many flights were in danger, and the worst."""
    said = [(flight, summary.answers(flight.answer).get("Happened")) for flight in flights]
    tones = [(flight, shown.line.tone) for flight, shown in said if shown is not None]
    for tone, what in ((Tone.BAD, "ended badly or were in danger"), (Tone.CARE, "are to look into")):
        worst = [flight for flight, its in tones if its is tone]
        if worst:
            many = f"{len(worst)} of {counted(len(flights), 'flight')} {what}"
            gravest = min(worst, key=_gravity)
            return _line("Happened", "", tone, "", f"{many}, such as {gravest.name}: {gravest.happened}.")
    known = [flight for flight, its in tones if its is Tone.GOOD]
    if not known:
        return _line("Happened", "", Tone.UNKNOWN, "", "What happened is not known of any flight.")
    return _line("Happened", "", Tone.GOOD, "", f"Nothing happened in {counted(len(known), 'flight')}.")


def _gravity(flight: FlightReport) -> int:
    """Return how grave what happened in a flight was; the last of a story is what it came to."""
    story = () if flight.account is None else flight.account.story
    return min((gravity(each) for each in story), default=len(GRAVITY))


def _loops(flights: Sequence[FlightReport]) -> ShownAnswer | None:
    """Answer with an oscillation, else the least margin, else the slowest attitude; None where nothing is known."""
    said = [(name, shown) for name, shown in _said(flights, "Loops") if shown.line.value is not None]
    swinging = [each for each in said if each[1].line.tone is Tone.BAD and each[1].line.unit == "Hz"]
    measured = [each for each in said if each[1].line.unit == "°"]
    for found in (swinging, measured, said):
        if found:
            name, shown = min(found, key=lambda each: each[1].line.value or 0.0)
            what = shown.line.text.split(",")[0].split(";")[0]
            least = f", least of {len(found)}" if len(found) > 1 else ""
            return _line("Loops", shown.line.word, shown.line.tone, shown.number, f"{what} ({name}{least})")
    return None


def furthest(numbers: FleetReport) -> tuple[CraftReport, ModelReport] | None:
    """Return the joint model that predicts furthest, with its craft; None where none predicts."""
    able = [(craft, model) for craft in numbers.groups for model in craft.models if model.uses.prediction.horizon_s]
    return max(able, key=lambda each: each[1].uses.prediction.horizon_s or 0.0, default=None)


def _ahead(numbers: FleetReport) -> ShownAnswer:
    """Answer with the joint model that predicts furthest, else with the best flight."""
    joint = furthest(numbers)
    if joint is not None and (joint[1].uses.prediction.horizon_s or 0.0) >= HOLDS:
        craft, model = joint
        of = f" ({craft.name})" if len(numbers.groups) > 1 else ""
        text = f"by {model.title.partition(' →')[0]}, on {counted(len(model.held_out), 'flight')} held out{of}"
        reach = _reach(model.uses.prediction)
    else:
        own = [
            (name, shown)
            for name, shown in _said(numbers.flights, "Predict ahead")
            if (shown.line.value or 0.0) >= HOLDS
        ]
        if not own:
            reasons = summary.alike([summary.clause(summary.first_reason(flight)) for flight in numbers.flights])
            return _line("Predict ahead", "no model holds", Tone.UNKNOWN, "", next(iter(reasons)))
        name, shown = max(own, key=lambda each: each[1].line.value or 0.0)
        reach = shown.number
        text = f"by the model of {name}; {len(own)} of {counted(len(numbers.flights), 'flight')} can"
    return _line("Predict ahead", "yes", Tone.GOOD, reach, text)


def _reach(use: PredictionUse) -> str:
    return f"{use.horizon_s:g} s" if use.reach_s is None else uncertain(use.reach_s, use.reach_sigma_s, "s")


def _parameters(numbers: FleetReport) -> ShownAnswer | None:
    for craft in numbers.groups:
        joint = thrust_known(craft.thrust, craft.parameters or ())
        if joint is not None:
            what = "thrust" if joint[2] == "N" else "thrust/mass"
            return _line("Parameters", "partly", Tone.CARE, uncertain(*joint), f"{what} per motor ({craft.name})")
    every = [found for flight in numbers.flights if (found := thrust_of(flight.answer)) is not None]
    if not every:
        return None
    unit = every[0][2]
    known = [(value, sigma or math.nan) for value, sigma, its_unit in every if its_unit == unit]
    shown = " to ".join(dict.fromkeys(uncertain(*each, unit) for each in (min(known), max(known))))
    what = "thrust" if unit == "N" else "thrust/mass"
    text = f"{what} per motor, by {len(known)} of {counted(len(numbers.flights), 'flight')}"
    return _line("Parameters", "partly", Tone.CARE, shown, text)
