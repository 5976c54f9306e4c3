"""The first screen of a folder: its best insight, then the answers of its flights, counted, with the worst named."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from core.quantity import counted, duration, number, uncertain
from pipeline.results.account import GRAVITY, gravity
from pipeline.results.answer import HOLDS, AnswerLine, Tone
from pipeline.results.drift import History, Step
from pipeline.results.model_report import ModelReport
from pipeline.results.report import CraftReport, FleetReport, FlightReport
from reports.views import log_words, summary
from reports.views.summary import thrust_known, thrust_of


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
            found.append((0.0, Insight(log_words.sentence(motors.sentence), craft)))
        for each in craft.drift.parameters:
            change = each.change
            if change is not None:
                found.append((change.p, Insight(_changed(each), craft, each)))
    return min(found, key=lambda each: each[0], default=(1.0, None))[1]


def called(craft: CraftReport, every: Sequence[CraftReport]) -> str:
    """Name a craft among others: by its number alone where all are of one kind."""
    kinds = {each.name.rpartition(", craft ")[0] for each in every}
    return craft.name.removeprefix(f"{kinds.pop()}, ") if len(kinds) == 1 else craft.name


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


def fleet_answer(numbers: FleetReport) -> list[AnswerLine]:
    """Sum all flights up, the best insight first, then a line for each purpose."""
    if not numbers.flights:
        return [_line("Happened", "no", Tone.UNKNOWN, "No log gave a flight.")]
    flights = [flight for flight in numbers.flights if flight.name not in numbers.again]
    changed, health = insight(numbers), _health(flights)
    first = health if changed is None else _line("Changed", "changed", Tone.CARE, changed.text)
    rest = [] if changed is None else [health]
    lines = [_flown(flights), _loops(flights), _parameters(numbers), _ahead(numbers)]
    return [first, *rest, *(each for each in lines if each is not None)]


def _line(purpose: str, word: str, tone: Tone, text: str) -> AnswerLine:
    return AnswerLine(purpose=purpose, word=word, tone=tone, text=text)


def _flown(flights: Sequence[FlightReport]) -> AnswerLine:
    flown = [flight.flight for flight in flights if flight.flight]
    high = max((each.height_m for each in flown if each.height_m is not None), default=None)
    fast = max((each.speed_max_m_s for each in flown if each.speed_max_m_s is not None), default=None)
    reach = [] if high is None else [f"{number(high, 2)} m high"]
    reach += [] if fast is None else [f"{number(fast, 2)} m/s"]
    text = duration(sum(each.duration_s for each in flown)) + (f", up to {' and '.join(reach)}" if reach else "")
    return _line("Flown", "", Tone.GOOD, text)


def _said(flights: Sequence[FlightReport], purpose: str) -> list[tuple[FlightReport, AnswerLine]]:
    """Return the answers for a purpose with their flights."""
    found = ((flight, None if flight.answer is None else flight.answer.line(purpose)) for flight in flights)
    return [(flight, line) for flight, line in found if line is not None]


def _health(flights: Sequence[FlightReport]) -> AnswerLine:
    """Answer with how many flights were in danger, and the worst."""
    tones = [(flight, line.tone) for flight, line in _said(flights, "Happened")]
    for tone, what in ((Tone.BAD, "ended badly or were in danger"), (Tone.CARE, "should be looked into")):
        worst = [flight for flight, its in tones if its is tone]
        if worst:
            many = f"{len(worst)} of {counted(len(flights), 'flight')} {what}"
            gravest = min(worst, key=_gravity)
            return _line("Happened", "", tone, f"{many}, such as {gravest.name}: {gravest.happened}.")
    known = [flight for flight, its in tones if its is Tone.GOOD]
    if not known:
        return _line("Happened", "", Tone.UNKNOWN, "What happened is not known of any flight.")
    return _line("Happened", "", Tone.GOOD, f"Nothing happened in {counted(len(known), 'flight')}.")


def _gravity(flight: FlightReport) -> int:
    """Return how grave what happened in a flight was; the last of a story is what it came to."""
    story = () if flight.account is None else flight.account.story
    return min((gravity(each) for each in story), default=len(GRAVITY))


def _loops(flights: Sequence[FlightReport]) -> AnswerLine | None:
    """Answer with an oscillation, else the least margin, else the slowest attitude; None where nothing is known."""
    said = [each for each in _said(flights, "Loops") if each[1].value is not None]
    swinging = [each for each in said if each[1].tone is Tone.BAD and each[1].unit == "Hz"]
    measured = [each for each in said if each[1].unit == "°"]
    for found in (swinging, measured, said):
        if found:
            flight, line = min(found, key=lambda each: each[1].value or 0.0)
            what = line.text.split(",")[0].split(";")[0]
            least = f", least of {len(found)}" if len(found) > 1 else ""
            return replace(line, text=f"{what} ({flight.name}{least})")
    return None


def furthest(numbers: FleetReport) -> tuple[CraftReport, ModelReport] | None:
    """Return the joint model that predicts furthest, with its craft; None where none predicts."""
    able = [(craft, model) for craft in numbers.groups for model in craft.models if model.uses.prediction.horizon_s]
    return max(able, key=lambda each: each[1].uses.prediction.horizon_s or 0.0, default=None)


def _ahead(numbers: FleetReport) -> AnswerLine:
    """Answer with the joint model that predicts furthest, else with the best flight."""
    joint = furthest(numbers)
    if joint is not None and (joint[1].uses.prediction.horizon_s or 0.0) >= HOLDS:
        craft, model = joint
        of = f" ({called(craft, numbers.groups)})" if len(numbers.groups) > 1 else ""
        text = f"by {model.title.partition(' →')[0]}, on {counted(len(model.held_out), 'flight')} held out{of}"
        use = model.uses.prediction
        reach, sigma = (use.horizon_s, None) if use.reach_s is None else (use.reach_s, use.reach_sigma_s)
    else:
        own = [each for each in _said(numbers.flights, "Predict ahead") if (each[1].value or 0.0) >= HOLDS]
        if not own:
            reasons = summary.alike([summary.clause(summary.first_reason(flight)) for flight in numbers.flights])
            return _line("Predict ahead", "no model holds", Tone.UNKNOWN, next(iter(reasons)))
        flight, line = max(own, key=lambda each: each[1].value or 0.0)
        reach, sigma = line.value, line.sigma
        text = f"by the model of {flight.name}; {len(own)} of {counted(len(numbers.flights), 'flight')} can"
    line = _line("Predict ahead", "yes", Tone.GOOD, text)
    return replace(line, value=reach, sigma=sigma, unit="s")


def _parameters(numbers: FleetReport) -> AnswerLine | None:
    for craft in numbers.groups:
        joint = thrust_known(craft.thrust, craft.parameters or ())
        if joint is not None:
            what = "thrust" if joint[2] == "N" else "thrust/mass"
            line = _line("Parameters", "partly", Tone.CARE, f"{what} per motor ({called(craft, numbers.groups)})")
            return replace(line, value=joint[0], sigma=joint[1], unit=joint[2])
    every = [found for flight in numbers.flights if (found := thrust_of(flight.answer)) is not None]
    if not every:
        return None
    unit = every[0][2]
    known = [(value, sigma or math.nan) for value, sigma, its_unit in every if its_unit == unit]
    shown = " to ".join(dict.fromkeys(uncertain(*each, unit) for each in (min(known), max(known))))
    what = "thrust" if unit == "N" else "thrust/mass"
    text = f"{shown} {what} per motor, by {len(known)} of {counted(len(numbers.flights), 'flight')}"
    return _line("Parameters", "partly", Tone.CARE, text)
