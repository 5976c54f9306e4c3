"""The first screen of a folder: the answers of its flights, counted, with the worst or the best one named."""

from __future__ import annotations

from collections.abc import Sequence

from core.quantity import counted, duration, number, uncertain
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.model_report import ModelReport
from pipeline.results.report import CraftReport, FleetReport, FlightInShort
from pipeline.results.verdict import PredictionUse
from reports.views import summary
from reports.views.summary import ShownAnswer, thrust_known, thrust_of

#: Shortest prediction that a person can act on, s: as of one flight.
_USEFUL = 1.0


def fleet_answer(numbers: FleetReport) -> list[ShownAnswer]:
    """Sum all flights up, a line for each purpose.

    Parameters
    ----------
    numbers : FleetReport
    """
    if not numbers.flights:
        return [_line("Flown", "no", Tone.UNKNOWN, "", "No log gave a flight.")]
    return [_flown(numbers), _healthy(numbers.flights), _loops(numbers.flights), _ahead(numbers), _parameters(numbers)]


def _line(purpose: str, word: str, tone: Tone, shown: str, text: str) -> ShownAnswer:
    return ShownAnswer(AnswerLine(purpose=purpose, word=word, tone=tone, text=text), shown)


def _flown(numbers: FleetReport) -> ShownAnswer:
    airborne = sum(flight.flight.duration_s for flight in numbers.flights if flight.flight)
    joint = sum(len(craft.training) + len(craft.held_out) for craft in numbers.groups)
    known = [flight.flight for flight in numbers.flights if flight.flight]
    heights = [shown.line for _, shown in _said(numbers.flights, "Flown") if shown.line.value is not None]
    high = max(heights, key=lambda each: each.value or 0.0, default=None)
    fast = max((each.speed_max_m_s for each in known if each.speed_max_m_s is not None), default=None)
    reach = [f"{uncertain(high.value, high.sigma, high.unit)} high"] if high is not None else []
    reach += [f"{number(fast, 2)} m/s"] if fast is not None else []
    text = f"up to {' and '.join(reach)}" if reach else ""
    text += ", " if joint and reach else ""
    text += f"{joint} identified together" if joint else ""
    return _line("Flown", duration(airborne), Tone.GOOD, counted(len(numbers.flights), "flight"), text)


def _said(flights: Sequence[FlightInShort], purpose: str) -> list[tuple[str, ShownAnswer]]:
    """Return the answers for a purpose with the names of their flights."""
    found = ((flight.name, summary.answers(flight.answer).get(purpose)) for flight in flights)
    return [(name, shown) for name, shown in found if shown is not None]


def _healthy(flights: Sequence[FlightInShort]) -> ShownAnswer:
    said = _said(flights, "Happened")
    bad, care, good = (
        [(name, shown) for name, shown in said if shown.line.tone is tone] for tone in (Tone.BAD, Tone.CARE, Tone.GOOD)
    )
    total = len(flights)
    if not bad and not care:
        word, tone = ("yes", Tone.GOOD) if len(good) == total else ("not known of all", Tone.UNKNOWN)
        return _line("Happened", word, tone, f"{len(good)} of {total}", "flights without an event")
    worst = bad or care
    name, shown = worst[0]
    what = summary.brief_health(shown).text
    kind = "in danger" if bad else "to look into"
    more = f"; {len(care)} more to look into" if bad and care else ""
    word, tone = ("no", Tone.BAD) if bad else ("check", Tone.CARE)
    return _line("Happened", word, tone, f"{len(worst)} of {total}", f"{kind}, such as {name}: {what}{more}")


def _loops(flights: Sequence[FlightInShort]) -> ShownAnswer:
    """Answer with the least margin that was measured, else with the slowest attitude."""
    said = [(name, shown) for name, shown in _said(flights, "Loops") if shown.line.value is not None]
    measured = [each for each in said if each[1].line.unit == "°" and each[1].line.tone is not Tone.UNKNOWN]
    swinging = [each for each in said if each[1].line.tone is Tone.BAD and each[1].line.unit == "Hz"]
    for found in (swinging, measured, [each for each in said if each[1].line.unit == "rad/s"], said):
        if found:
            # Of margins and bandwidths the least is worst, of errors the largest.
            sign = -1.0 if found is said else 1.0
            name, shown = min(found, key=lambda each: sign * (each[1].line.value or 0.0))
            what = shown.line.text.split(",")[0].split(";")[0]
            count = f"the worst of {counted(len(found), 'flight')} ({name})" if len(found) > 1 else f"({name})"
            return _line("Loops", shown.line.word, shown.line.tone, shown.number, f"{what}, {count}")
    return _line("Loops", "not known", Tone.UNKNOWN, "", "no flight shows how the attitude follows")


def furthest(numbers: FleetReport) -> tuple[CraftReport, ModelReport] | None:
    """Return the joint model that predicts furthest, with its craft; None where none predicts."""
    able = [(craft, model) for craft in numbers.groups for model in craft.models if model.uses.prediction.horizon_s]
    return max(able, key=lambda each: each[1].uses.prediction.horizon_s or 0.0, default=None)


def _ahead(numbers: FleetReport) -> ShownAnswer:
    """Answer with the joint model that predicts furthest, else with the best flight."""
    joint = furthest(numbers)
    if joint is not None:
        craft, model = joint
        use = model.uses.prediction
        of = f" ({craft.name})" if len(numbers.groups) > 1 else ""
        longest, reach = use.horizon_s or 0.0, _reach(use)
        text = f"by {model.title.partition(' →')[0]}, on {counted(len(model.held_out), 'flight')} held out{of}"
    else:
        own = [(name, shown) for name, shown in _said(numbers.flights, "Predict ahead") if shown.line.value is not None]
        if not own:
            reasons = summary.alike([summary.clause(summary.first_reason(flight)) for flight in numbers.flights])
            return _line("Predict ahead", "no model", Tone.UNKNOWN, "", next(iter(reasons)))
        name, shown = max(own, key=lambda each: each[1].line.value or 0.0)
        longest, reach = shown.line.value or 0.0, shown.number
        text = f"by the model of {name}; {len(own)} of {counted(len(numbers.flights), 'flight')} can"
    word, tone = ("yes", Tone.GOOD) if longest >= _USEFUL else ("briefly", Tone.CARE)
    return _line("Predict ahead", word, tone, reach, text)


def _reach(use: PredictionUse) -> str:
    return f"{use.horizon_s:g} s" if use.reach_s is None else uncertain(use.reach_s, use.reach_sigma_s, "s")


def _parameters(numbers: FleetReport) -> ShownAnswer:
    for craft in numbers.groups:
        joint = thrust_known(craft.thrust, craft.parameters or ())
        if joint is not None:
            what = "thrust" if joint[2] == "N" else "thrust/mass"
            return _line("Parameters", "partly", Tone.CARE, uncertain(*joint), f"{what} per motor ({craft.name})")
    every = [found for flight in numbers.flights if (found := thrust_of(flight.answer)) is not None]
    if not every:
        return _outputs(numbers.flights)
    unit = every[0][2]
    known = [(value, sigma) for value, sigma, its_unit in every if its_unit == unit]
    span = [uncertain(*each, unit) for each in (min(known, key=_value), max(known, key=_value))]
    shown = " to ".join(dict.fromkeys(span))
    what = "thrust" if unit == "N" else "thrust/mass"
    text = f"{what} per motor, by {len(known)} of {counted(len(numbers.flights), 'flight')}"
    return _line("Parameters", "partly", Tone.CARE, shown, text)


def _value(known: tuple[float, float | None]) -> float:
    return known[0]


def _outputs(flights: Sequence[FlightInShort]) -> ShownAnswer:
    """Answer with what the motors were told in the air, where nothing tells what they gave."""
    means = [
        (shown.line.value, shown.line.sigma)
        for _, shown in _said(flights, "Parameters")
        if shown.line.value is not None and shown.line.unit == "µs"
    ]
    if not means:
        return _line("Parameters", "not known", Tone.UNKNOWN, "", "no flight gives the thrust of a motor")
    span = [uncertain(*each, "") for each in (min(means), max(means))]
    shown = f"{' to '.join(dict.fromkeys(span))} µs"
    text = f"mean motor output, in {len(means)} of {counted(len(flights), 'flight')}; no thrust"
    return _line("Parameters", "hardly", Tone.UNKNOWN, shown, text)
