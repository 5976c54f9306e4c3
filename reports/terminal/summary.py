"""The summary that a person reads in ten seconds at the end of ``rotorid analyze``."""

from collections.abc import Sequence
from dataclasses import replace
from textwrap import shorten

from rich.console import Group, RenderableType
from rich.text import Text

from core.summary import listed
from core.table import TONES, Cell, Row, Table
from pipeline.results.answer import AnswerLine, clause
from pipeline.results.report import CraftReport, FleetReport, FlightReport
from reports.views import log_words, summary
from reports.views.fleet import fleet_answer, flight_cells
from reports.views.models import holding

#: What the columns of the table of flights hold.
_HEADS = (
    "predicts: how far ahead, better than half of what constant velocity errs. loops: phase margin where chirps "
    "measured it, else how fast (Hz) or closely (° RMS) the attitude follows. thrust: one motor's at full command, "
    "over the mass unless that is given."
)


def overview(numbers: FlightReport | FleetReport, width: int = 120) -> RenderableType:
    """Answer what one flight tells, or tabulate what many do, then each craft with what its joint model does."""
    return _one_flight(numbers) if isinstance(numbers, FlightReport) else _many_flights(numbers, width)


def _one_flight(numbers: FlightReport) -> Group:
    parts: list[RenderableType] = [Text(numbers.name, style="bold")]
    if numbers.answer is not None:
        first, *lines = numbers.answer.lines
        parts += [Text(first.text, style=TONES[first.tone]), Text(), *answer_rows(lines)]
        if numbers.answer.next:
            parts.append(Text(f"Next: {numbers.answer.next}"))
    return Group(*parts)


def _many_flights(numbers: FleetReport, width: int) -> Group:
    parts: list[RenderableType] = []
    if numbers.flights:
        parts += [Text(fleet_answer(numbers)[0].text, style="bold"), Text()]
        parts += [_flights(numbers.flights, narrow=width < 100), Text(_HEADS, style="dim")]
        parts += [Text(reason, style="dim") for reason in _reasons(numbers.flights)]
    for group in numbers.groups:
        parts += [Text(), Text(" ".join(summary.joint_sentences(group)[:1]))]
        parts += [Text(f"{title}: {uses}") for title, uses in holding(group.models)]
    unused = summary.left_out(numbers)
    if unused:
        parts.append(Text("\n" + "\n".join(unused), style="dim"))
    return Group(*parts)


def answer_rows(lines: Sequence[AnswerLine]) -> list[RenderableType]:
    """Tabulate lines of an answer, as the first screen of the report does."""
    if not lines:
        return []
    rows = [Row(Cell(line.purpose, line.tone), [line.said]) for line in lines]
    return [Table("", [""], rows, texts=[0]).terminal(), Text()]


def _flights(flights: Sequence[FlightReport], narrow: bool) -> RenderableType:
    """Tabulate what each flight tells, by purpose."""
    longest = 24 if narrow else 34
    rows = []
    for flight in flights:
        by_head = flight_cells(flight)
        shown = (by_head[head] for head in ("What happened", "Loops", "Predicts ahead", "Thrust of a motor"))
        cells: list[str | Cell] = [] if narrow else [log_words.frame(flight.vehicle)]
        cells.append(f"{flight.flight.duration_s:.0f} s" if flight.flight else "–")
        cells += [replace(cell, text=_cut(cell.text, longest)) if isinstance(cell, Cell) else cell for cell in shown]
        rows.append(Row(_shortened(flight.name, 18 if narrow else 24), cells))
    heads = ["flown", "happened", "loops", "predicts", "thrust"]
    return Table("flight", heads if narrow else ["craft", *heads], rows).terminal(fold_labels=False)


def _reasons(flights: Sequence[FlightReport]) -> list[str]:
    """Return why flights have no model, each reason once: ``No model: no GPS (march1 and 4 more)``."""
    without = [flight for flight in flights if not any(model.held_out for model in flight.models)]
    # The flight's own name, which some reasons begin with, stands in the row already.
    reasons = summary.alike(
        [clause(summary.first_reason(flight).removeprefix(f"{flight.name}: ")) for flight in without]
    )
    return [
        f"No model: {reason} ({listed([without[place].name for place in places], 1)})"
        for reason, places in reasons.items()
    ]


def _cut(text: str, most: int) -> str:
    """Shorten what happened to its end, a crash say, which matters more than what led to it."""
    return shorten(text if len(text) <= most else text.rpartition(", ")[2], most, placeholder=" …")


def _shortened(name: str, most: int) -> str:
    """Leave out the middle of a long name; its ends tell more."""
    return name if len(name) <= most else f"{name[: most // 2 - 1]}…{name[-most // 2 :]}"


def no_model(numbers: FlightReport | FleetReport) -> str:
    """Explain why no analysed log gave a thrust or a model; empty where one did, or all failed anyway."""
    if isinstance(numbers, FlightReport):
        flights: Sequence[FlightReport] = [numbers]
        every: Sequence[FlightReport | CraftReport] = flights
    else:
        flights, every = numbers.flights, [*numbers.flights, *numbers.groups]
    if not flights or any(entry.thrust is not None or any(result.kind for result in entry.models) for entry in every):
        return ""
    return f"no model could be identified: {summary.first_reason(flights[0])}"
