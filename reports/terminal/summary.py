"""The summary that a person reads in ten seconds at the end of ``rotorid analyze``."""

import math
import re
from collections.abc import Mapping, Sequence
from textwrap import shorten

from rich.console import Group, RenderableType
from rich.text import Text

from core.quantity import column, joined, number, uncertain
from core.table import TONES, Cell, Row, Table
from pipeline.results.answer import Answer
from pipeline.results.model_report import ByOutput, ModelInShort, ModelReport
from pipeline.results.report import CraftReport, FleetReport, FlightInShort, FlightReport
from pipeline.results.rotation_report import RotationReport
from pipeline.results.verdict import Verdict
from reports.numbers.rows import average
from reports.views import summary

#: Longest text of a cell, and of what happened to a craft on a wide terminal.
_LONGEST_CELL, _LONGEST_HEALTH = 24, 34
#: What the columns of the table of flights hold.
_HEADS = (
    "predicts: how far ahead, better than half of what constant velocity errs. loops: phase margin where chirps "
    "measured it, else how fast (Hz) or closely (° RMS) the attitude follows. thrust: one motor's at full command, "
    "over the mass unless that is given."
)
#: What trust in a model is as a tone.
_TRUST: Mapping[str, str] = {"yes": "good", "limited": "care", "no": "bad", "unknown": "unknown"}


def overview(numbers: FlightReport | FleetReport, width: int = 120) -> RenderableType:
    """Answer what one flight tells, or tabulate what many do, then each craft with what its joint model does.

    Parameters
    ----------
    numbers : FlightReport or FleetReport
    width : int
        Columns of the terminal; on a narrow one names are shortened and the craft is left out.
    """
    return _one_flight(numbers) if isinstance(numbers, FlightReport) else _many_flights(numbers, width)


def _one_flight(numbers: FlightReport) -> Group:
    parts: list[RenderableType] = [Text(numbers.name, style="bold"), *answer_rows(numbers.answer)]
    if numbers.answer is not None and numbers.answer.next:
        parts += [Text(f"Next: {numbers.answer.next}"), Text()]
    if line := rotation_line(numbers.rotation):
        parts += [Text(line), Text()]
    models = _models(numbers.models)
    if not models and (reason := summary.first_reason(numbers)):
        parts.append(Text(f"No model: {reason}", style="dim"))
    return Group(*parts, *models, _sentence(numbers.verdict))


def _many_flights(numbers: FleetReport, width: int) -> Group:
    parts: list[RenderableType] = []
    if numbers.flights:
        parts += [_flights(numbers.flights, narrow=width < 100), Text(_HEADS, style="dim")]
        parts += [Text(reason, style="dim") for reason in _reasons(numbers.flights)]
    for group in numbers.groups:
        parts += [Text(), Text(" ".join(summary.joint_sentences(group))), *_models(group.models)]
        parts.append(_sentence(group.verdict))
    unused = summary.left_out(numbers)
    if unused:
        parts.append(Text("\n" + "\n".join(unused), style="dim"))
    return Group(*parts)


def answer_rows(answer: Answer | None) -> list[RenderableType]:
    """Tabulate the answer for each purpose, as the first screen of the report does."""
    lines = summary.answer_lines(answer)
    if not lines:
        return []
    rows = [
        Row(each.line.purpose, [Cell(each.line.word, each.line.tone), f"{each.number} {each.line.text}".strip()])
        for each in lines
    ]
    return [Table("", ["", ""], rows, texts=[0, 1]).terminal(), Text()]


def _sentence(verdict: Verdict) -> Text:
    return Text(verdict.sentence, style=TONES[_TRUST[verdict.trust]])


def _flights(flights: Sequence[FlightInShort], narrow: bool) -> RenderableType:
    """Tabulate what each flight tells, by purpose."""
    longest = _LONGEST_CELL if narrow else _LONGEST_HEALTH
    rows = []
    for flight in flights:
        said = summary.brief(flight.answer)
        cells: list[str | Cell] = [] if narrow else [summary.frame(flight.vehicle)]
        cells.append(f"{flight.flight.duration_s:.0f} s" if flight.flight else "–")
        cells += [Cell(_cut(each.text, longest), each.tone) for each in (said.healthy, said.loops, said.ahead)]
        cells.append(_thrust(flight.answer))
        rows.append(Row(_shortened(flight.name, 18 if narrow else 24), cells))
    heads = ["flown", "healthy", "loops", "predicts", "thrust"]
    return Table("flight", heads if narrow else ["craft", *heads], rows).terminal(fold_labels=False)


def _reasons(flights: Sequence[FlightInShort]) -> list[str]:
    """Return why flights have no model, each reason once: ``No model: no GPS (march1 and 4 more)``."""
    without = [flight for flight in flights if summary.best(flight.models) is None]
    reasons = summary.alike([_first_clause(summary.first_reason(flight), flight.name) for flight in without])
    return [
        f"No model: {reason} ({without[each[0]].name}{f' and {len(each) - 1} more' if len(each) > 1 else ''})"
        for reason, each in reasons.items()
    ]


def _models(models: Sequence[ModelReport]) -> list[RenderableType]:
    """Set models side by side with their errors on held-out flight, averaged, and the guess that they must beat."""
    judged = [result for result in models if result.held_out]
    if not judged:
        return []
    outputs = list(judged[0].rmse_average_m)
    errors: list[ByOutput] = [result.rmse_average_m for result in judged]
    errors.append(average([row.rmse_mean_m for row in judged[0].held_out]))
    columns = [column([row[output] for row in errors]) for output in outputs]
    rows = [
        Row(result.title, [*(cells[place] for cells in columns), summary.predicts(result), _word(result)])
        for place, result in enumerate(judged)
    ]
    rows.append(Row("always predicting the mean", [*(cells[-1] for cells in columns), "", ""], kind="baseline"))
    heads = [*(f"{output} (m)" for output in outputs), "predicts", "free run"]
    return [Table("model, on flight time held out", heads, rows, texts=[len(outputs) + 1]).terminal()]


def _word(result: ModelInShort) -> Cell:
    trust = result.verdict.trust
    return Cell(summary.TRUST_WORDS[trust], _TRUST[trust])


def _cut(text: str, most: int) -> str:
    """Shorten what happened to its end, a crash say, which matters more than what led to it."""
    return shorten(text if len(text) <= most else text.rpartition(", ")[2], most, placeholder=" …")


def _thrust(answer: Answer | None) -> str:
    """Write the thrust of a motor with as many digits as its error leaves, four at most: the report has the rest."""
    known = summary.thrust_of(answer)
    if known is None:
        return "–"
    value, sigma, unit = known
    digits = 3
    if value and sigma and sigma > 0.0:
        digits = min(max(math.floor(math.log10(abs(value))) - math.floor(math.log10(sigma)) + 1, 1), 4)
    return f"{number(value, digits)} {unit}"


def _shortened(name: str, most: int) -> str:
    """Leave out the middle of a long name; its ends tell more."""
    return name if len(name) <= most else f"{name[: most // 2 - 1]}…{name[-most // 2 :]}"


def _first_clause(reason: str, name: str) -> str:
    """Return what fits a cell of a reason; the flight's own name, which some begin with, stands in the row already."""
    reason = reason.removeprefix(f"{name}: ")
    return re.split(r"[:;]", reason, maxsplit=1)[0]


def no_model(numbers: FlightReport | FleetReport) -> str:
    """Explain why no analysed log gave a thrust or a model; empty where one did, or all failed anyway."""
    if isinstance(numbers, FlightReport):
        flights: Sequence[FlightReport | FlightInShort] = [numbers]
        every: Sequence[FlightReport | FlightInShort | CraftReport] = flights
    else:
        flights, every = numbers.flights, [*numbers.flights, *numbers.groups]
    if not flights or any(each.thrust is not None or any(result.kind for result in each.models) for each in every):
        return ""
    return f"no model could be identified: {summary.first_reason(flights[0])}"


def rotation_line(rotation: RotationReport | None) -> str:
    """Sum up in a line what a flight tells of how its craft turns; empty where nothing."""
    if rotation is None:
        return ""
    known = [axis.axis for axis in rotation.axes if axis.determined]
    parts = ["determined in " + joined(known)] if known else []
    for axis in rotation.axes:
        if axis.loop is not None:
            margins = axis.loop.computed
            told = [
                f"{title} {uncertain(each.value, each.sigma, each.unit)}"
                for title, each in (("gain margin", margins.gain_db), ("phase margin", margins.phase_deg))
                if each.value is not None
            ]
            parts.append(f"{axis.axis} loop {axis.loop.state}" + (f" ({', '.join(told)})" if told else ""))
    return f"How it turns: {'; '.join(parts)}." if parts else ""
