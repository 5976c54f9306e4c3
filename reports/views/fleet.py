"""What is shown of many flights: the answer first, tables of flights and logs, and parameters over flights.

The first screen of a folder is its best insight, then the answers of its flights, counted, with the worst named.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from urllib.parse import quote

from core.quantity import counted, duration, number, per_degree, uncertain, with_unit
from core.table import Cell, Row, Table
from pipeline.results.account import GRAVITY, Account, gravity
from pipeline.results.answer import AnswerLine, Tone, clause
from pipeline.results.drift import Drift, History, ParameterChange, Step
from pipeline.results.model import ModelReport
from pipeline.results.report import CraftReport, FleetReport, FlightReport
from reports.views import log_words, summary
from reports.views.summary import thrust_known, thrust_of
from sysid.validation.uses import REACTION_SECONDS


def links(flights: Sequence[FlightReport]) -> dict[str, str]:
    """Return the page of every flight, by its name."""
    return {flight.name: f"{quote(flight.folder)}/report.html" for flight in flights}


def title(numbers: FleetReport) -> str:
    """Name the report: by its craft where all flights are of one, else by its logs."""
    if not numbers.flights:
        return "No flight"
    # Two recordings of a flight are one flight, here as in the first sentence.
    flights, crafts = counted(len(numbers.flights) - len(numbers.again), "flight"), numbers.groups
    names = {flight.log.file for flight in numbers.flights}
    if len(names) == 1 and _logs(numbers) == 1:
        return f"{names.pop()}: {flights}"
    if len(crafts) == 1 and len(crafts[0].training) + len(crafts[0].held_out) == len(numbers.flights):
        return f"{crafts[0].name}: {flights}"
    return f"{flights}, {len(crafts)} craft identified" if crafts else flights


def facts(numbers: FleetReport) -> str:
    """One line under the title: how many logs, from when to when."""
    flights = numbers.flights
    starts = sorted(flight.log.start_utc for flight in flights if flight.log.start_utc)
    parts = [f"{counted(_logs(numbers), 'log')} analysed"]
    for logs, words in (
        (numbers.failures, "gave nothing"),
        (numbers.duplicates, "copies"),
        (numbers.passed_over, "passed over"),
    ):
        if logs:
            parts.append(f"{len(logs)} {words}")
    if starts:
        days = sorted({start[:10] for start in (starts[0], starts[-1])})
        parts.append(" to ".join(days))
    return " · ".join(parts)


def _logs(numbers: FleetReport) -> int:
    """Count the files that flights are of."""
    return len({flight.log.sha256 for flight in numbers.flights})


def flight_cells(flight: FlightReport) -> dict[str, str | Cell]:
    """Return by column what was flown, what happened, and what it tells of the craft, in as few words as cells hold."""
    flown, answer = flight.flight, flight.answer
    happened, loops, ahead = (
        None if answer is None else answer.line(purpose) for purpose in ("Happened", "Loops", "Predict ahead")
    )
    unknown = Cell("–", Tone.UNKNOWN)
    # The least phase margin with its word where it was measured, else how well the attitude followed.
    margin = "" if loops is None else f"{loops.word} " * (loops.tone is not Tone.UNKNOWN) + loops.number
    return {
        "Day": (flight.log.start_utc or "–")[:10],
        "Airborne": "–" if flown is None else duration(flown.duration_s),
        "Height (m)": "–" if flown is None else _digits(flown.height_m),
        "Speed (m/s)": "–" if flown is None else _digits(flown.speed_max_m_s),
        "What happened": unknown if happened is None else Cell(flight.happened or "not known", happened.tone),
        "Loops": unknown if loops is None or not loops.number else Cell(margin, loops.tone),
        "Predicts ahead": unknown if ahead is None or ahead.value is None else Cell(ahead.number, ahead.tone),
        "Thrust of a motor": _thrust(flight),
    }


def _thrust(flight: FlightReport) -> str:
    """Write the thrust of a motor, over the mass unless that was given, as its error allows; four digits at most."""
    known = summary.thrust_of(flight.answer)
    if known is None:
        return "–"
    value, sigma, unit = known
    digits = 3
    if value and sigma and sigma > 0.0:
        digits = min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(sigma)) + 1, 1), 4)
    return f"{number(value, digits)} {unit}"


def flights_table(numbers: FleetReport, pages: Mapping[str, str]) -> Table | None:
    """Tabulate every flight with its page; None without any."""
    parts = {
        name: word
        for craft in numbers.groups
        for names, word in ((craft.training, "fitted jointly"), (craft.held_out, "judges the joint fit"))
        for name in names
    }
    shown = [(flight, flight_cells(flight)) for flight in numbers.flights]
    rows = []
    for flight, cells in shown:
        under = ", ".join(part for part in (log_words.frame(flight.vehicle), parts.get(flight.name, "")) if part)
        rows.append(Row(Cell(flight.name, under=under), list(cells.values()), link=pages[flight.name]))
    if not rows:
        return None
    heads = list(shown[0][1])
    texts = [heads.index(head) for head in ("Day", "What happened", "Loops")]
    roomy = [place for place, head in enumerate(heads) if head != "What happened"]
    return Table("Flight", heads, rows, texts=texts, style="flights", roomy=roomy)


def _digits(value: float | None) -> str:
    return "–" if value is None else number(value, 2)


def health_table(numbers: FleetReport) -> Table | None:
    """Tabulate how well each flight was logged: rates, satellites, vibration, battery, known position."""
    known = [
        (flight.name, flight.coverage.health, flight.account or Account(flight=None))
        for flight in numbers.flights
        if flight.coverage is not None
    ]
    if not known:
        return None
    return Table(
        label="Flight",
        heads=[
            *("IMU (Hz)", "motors (Hz)", "attitude (Hz)", "GPS (Hz)"),
            *("satellites", "vibration (m/s²)", "clips", "battery (V)", "position (m)"),
        ],
        rows=[
            Row(
                name,
                [
                    *(
                        _digits(health.rates[table].rate if table in health.rates else None)
                        for table in ("imu", "motors", "attitude", "gps")
                    ),
                    _whole(None if account.gps is None else account.gps.satellites_median),
                    _digits(None if account.vibration is None else account.vibration.p95),
                    _whole(None if account.vibration is None else account.vibration.clips),
                    "–" if account.battery is None else f"{account.battery.start:.1f}, {account.battery.lowest:.1f}",
                    _digits(health.position_sigma.median),
                ],
            )
            for name, health, account in known
        ],
        caption="How well each flight was logged: samples per second, satellites, vibration exceeded for 5 % of the "
        "time, clipped accelerations, voltage at take-off and least, and the median 1-sigma of the horizontal "
        "position.",
    )


def _whole(value: float | None) -> str:
    return "–" if value is None else f"{value:.0f}"


@dataclass(frozen=True, slots=True)
class Insight:
    """What changed over the flights of a craft, in a sentence."""

    text: str
    craft: CraftReport
    history: History | None = None  #: None where it is about its motors.


def insight(numbers: FleetReport) -> Insight | None:
    """Return the change over flights that is least likely chance; a weakening motor before all; None without one."""
    candidates: list[tuple[float, Insight]] = []
    for craft in numbers.groups:
        if craft.drift is None:
            continue
        motors = craft.drift.motors
        if motors is not None and motors.weakening:
            candidates.append((0.0, Insight(log_words.sentence(motors.sentence), craft)))
        for parameter in craft.drift.parameters:
            change = parameter.change
            if change is not None:
                candidates.append((change.p, Insight(_changed(parameter), craft, parameter)))
    return min(candidates, key=lambda candidate: candidate[0], default=(1.0, None))[1]


def called(craft: CraftReport, every: Sequence[CraftReport]) -> str:
    """Name a craft among others: by its number alone where all are of one kind."""
    kinds = {craft.name.rpartition(", craft ")[0] for craft in every}
    return craft.name.removeprefix(f"{kinds.pop()}, ") if len(kinds) == 1 else craft.name


def _changed(history: History) -> str:
    """Write a step, or a trend from the first flight to the last, in percent of what was before."""
    change, points = history.change, history.flights
    if isinstance(change, Step):
        before = [point.value for point in points if point.number < change.number]
        whole, sigma = change.change, change.sigma
        first, last = (
            next(point for point in points if point.flight == name) for name in (change.before, change.after)
        )
    else:
        assert change is not None
        first, last = points[0], points[-1]
        flights = last.number - first.number
        before, whole, sigma = [first.value], flights * change.per_flight, flights * change.per_flight_sigma
    name = f"{history.parameter[:1].upper()}{history.parameter[1:]}"
    base = abs(sum(before) / len(before)) if before else 0.0
    verb = "fell" if whole < 0.0 else "rose"
    by = uncertain(abs(whole), sigma) if not base else uncertain(100.0 * abs(whole) / base, 100.0 * sigma / base, "%")
    days = [_day(point.start_utc) for point in (first, last)]
    dated = all(days) and days[0] != days[1]
    between = f"{days[0]} and {days[1]}" if dated else f"{first.flight} and {last.flight}"
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
    return [first, *rest, *(line for line in lines if line is not None)]


def _line(purpose: str, word: str, tone: Tone, text: str) -> AnswerLine:
    return AnswerLine(purpose=purpose, word=word, tone=tone, text=text)


def _flown(flights: Sequence[FlightReport]) -> AnswerLine:
    flown = [flight.flight for flight in flights if flight.flight]
    high = max((report.height_m for report in flown if report.height_m is not None), default=None)
    fast = max((report.speed_max_m_s for report in flown if report.speed_max_m_s is not None), default=None)
    reach = [] if high is None else [f"{number(high, 2)} m high"]
    reach += [] if fast is None else [f"{number(fast, 2)} m/s"]
    text = duration(sum(report.duration_s for report in flown)) + (f", up to {' and '.join(reach)}" if reach else "")
    return _line("Flown", "", Tone.GOOD, text)


def _said(flights: Sequence[FlightReport], purpose: str) -> list[tuple[FlightReport, AnswerLine]]:
    """Return the answers for a purpose with their flights."""
    answers = ((flight, None if flight.answer is None else flight.answer.line(purpose)) for flight in flights)
    return [(flight, line) for flight, line in answers if line is not None]


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
    return min((gravity(finding) for finding in story), default=len(GRAVITY))


def _loops(flights: Sequence[FlightReport]) -> AnswerLine | None:
    """Answer with an oscillation, else the least margin, else the slowest attitude; None where nothing is known."""
    said = [answer for answer in _said(flights, "Loops") if answer[1].value is not None]
    swinging = [answer for answer in said if answer[1].tone is Tone.BAD and answer[1].unit == "Hz"]
    measured = [answer for answer in said if answer[1].unit == "°"]
    for answers in (swinging, measured, said):
        if answers:
            flight, line = min(answers, key=lambda answer: answer[1].value or 0.0)
            what = line.text.split(",")[0].split(";")[0]
            least = f", least of {len(answers)}" if len(answers) > 1 else ""
            return replace(line, text=f"{what} ({flight.name}{least})")
    return None


def furthest(numbers: FleetReport) -> tuple[CraftReport, ModelReport] | None:
    """Return the joint model that predicts furthest, with its craft; None where none predicts."""
    able = [(craft, model) for craft in numbers.groups for model in craft.models if model.uses.prediction.horizon_s]
    return max(able, key=lambda pair: pair[1].uses.prediction.horizon_s or 0.0, default=None)


def _ahead(numbers: FleetReport) -> AnswerLine:
    """Answer with the joint model that predicts furthest, else with the best flight."""
    joint = furthest(numbers)
    if joint is not None and joint[1].uses.prediction.holds:
        craft, model = joint
        of = f" ({called(craft, numbers.groups)})" if len(numbers.groups) > 1 else ""
        text = f"by {model.short}, on {counted(len(model.held_out), 'flight')} held out{of}"
        reach, sigma = model.uses.prediction.ahead
    else:
        own = [
            answer for answer in _said(numbers.flights, "Predict ahead") if (answer[1].value or 0.0) >= REACTION_SECONDS
        ]
        if not own:
            reasons = summary.alike([clause(summary.first_reason(flight)) for flight in numbers.flights])
            return _line("Predict ahead", "no model holds", Tone.UNKNOWN, next(iter(reasons)))
        flight, line = max(own, key=lambda answer: answer[1].value or 0.0)
        reach, sigma = line.value, line.sigma
        text = f"by the model of {flight.name}; {len(own)} of {counted(len(numbers.flights), 'flight')} can"
    line = _line("Predict ahead", "yes", Tone.GOOD, text)
    return replace(line, value=reach, sigma=sigma, unit="s")


def _parameters(numbers: FleetReport) -> AnswerLine | None:
    for craft in numbers.groups:
        joint = thrust_known(craft.thrust, craft.parameters)
        if joint is not None:
            what = "thrust" if joint[2] == "N" else "thrust/mass"
            line = _line("Parameters", "partly", Tone.CARE, f"{what} per motor ({called(craft, numbers.groups)})")
            return replace(line, value=joint[0], sigma=joint[1], unit=joint[2])
    every = [thrust for flight in numbers.flights if (thrust := thrust_of(flight.answer)) is not None]
    if not every:
        return None
    unit = every[0][2]
    known = [(value, sigma or math.nan) for value, sigma, its_unit in every if its_unit == unit]
    shown = " to ".join(dict.fromkeys(uncertain(*estimate, unit) for estimate in (min(known), max(known))))
    what = "thrust" if unit == "N" else "thrust/mass"
    text = f"{shown} {what} per motor, by {len(known)} of {counted(len(numbers.flights), 'flight')}"
    return _line("Parameters", "partly", Tone.CARE, text)


def drift_table(drift: Drift | None) -> Table | None:
    """Tabulate each parameter over the flights, those that change first."""
    if drift is None or not drift.parameters:
        return None
    rows = []
    for parameter in sorted(drift.parameters, key=lambda history: history.change is None):
        degrees, unit = per_degree(parameter.unit.partition(",")[0])
        trend, step = parameter.trend, parameter.step
        cells = [
            str(len(parameter.flights)),
            _written(parameter.mean, parameter.mean_sigma, degrees),
            number(parameter.between * degrees, 2),
            "–" if trend is None else _written(trend.per_flight, trend.per_flight_sigma, degrees),
            "–" if trend is None else chance(trend.p_adjusted),
            "–" if step is None else _written(step.change, step.sigma, degrees),
            "–" if step is None else chance(step.p_adjusted),
        ]
        label = with_unit(f"{parameter.parameter[:1].upper()}{parameter.parameter[1:]}, {parameter.method}", unit)
        rows.append(Row(label, cells, "" if parameter.change is None else "strong"))
    return Table(
        label="Parameter",
        heads=["flights", "mean", "scatter", "trend per flight", "p", "step", "p"],
        rows=rows,
        caption="Mean over flights with one standard error, scatter between flights beyond their own errors, trend "
        "per flight and change at once between two flights, each with the chance of it where nothing changes, "
        "corrected for the number of questions asked.",
    )


def drift_sentences(drift: Drift | None) -> list[str]:
    """Report what changes over the flights, the gravest first; of what does not, only that."""
    if drift is None:
        return []
    motors = drift.motors
    about_motors = [] if motors is None else [motors.sentence]
    said = [parameter.sentence for parameter in drift.parameters if parameter.change is not None]
    said = [*about_motors, *said] if motors is not None and motors.weakening else [*said, *about_motors]
    steady = sum(parameter.change is None for parameter in drift.parameters)
    if steady and steady == len(drift.parameters):
        said.append(f"None of the {steady} parameters followed over {len(drift.flights)} flights is seen to change")
    return [log_words.sentence(text) for text in said if text]


def _written(value: float, sigma: float, factor: float) -> str:
    return uncertain(factor * value, factor * sigma)


def chance(p: float | None) -> str:
    """Write a probability: three digits are more than anybody needs."""
    if p is None:
        return "–"
    return "< 0.001" if p < 0.001 else f"{p:.2g}" if p < 0.1 else f"{p:.2f}"


def change_table(changes: Sequence[ParameterChange]) -> Table:
    """Tabulate parameters: before, after, difference, and whether it is significant."""
    rows = []
    for change in changes:
        degrees, unit = per_degree(change.unit.partition(",")[0])
        cells = [_written(side.value, side.sigma, degrees) for side in (change.a, change.b)]
        percent = change.difference_percent is not None
        cells.append(change.written if percent else _written(change.difference, change.difference_sigma, degrees))
        label = with_unit(f"{change.parameter[:1].upper()}{change.parameter[1:]}, {change.method}", unit)
        cells += [chance(change.p_adjusted), "changed" if change.significant else "no change seen"]
        rows.append(Row(label, cells, "strong" if change.significant else ""))
    return Table(
        label="Parameter",
        heads=["before", "after", "difference", "p", "verdict"],
        rows=rows,
        caption="Means over the flights of each side with one standard error, which holds how much flights differ. "
        "p is the chance of such a difference when nothing changed, corrected for the number of parameters.",
    )
