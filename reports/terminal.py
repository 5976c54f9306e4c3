"""The summary that a person reads in ten seconds at the end of ``rotorid analyze``."""

import math
import re
from collections.abc import Mapping, Sequence
from textwrap import shorten

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from logparse.quantity import column, number
from pipeline.results.answer import Answer
from pipeline.results.model_report import ByOutput, ModelInShort, ModelReport
from pipeline.results.report import CraftReport, FleetReport, FlightInShort, FlightReport
from pipeline.results.verdict import Verdict
from reports import summary
from reports.health_views import sentence
from reports.rotation_line import rotation_line
from reports.rows import average
from sysid.rotors.thrust_record import ThrustCoefficient

#: Longest text of a cell, and of what happened to a craft on a wide terminal.
_LONGEST_CELL, _LONGEST_HEALTH = 24, 36
#: What the columns of the table of flights hold.
_HEADS = (
    "predicts: how far ahead, better than half of what constant velocity errs. loops: phase margin where chirps "
    "measured it, else bandwidth (rad/s) or RMS error (°) of the attitude."
)
_TONES: Mapping[str, str] = {"good": "green", "care": "yellow", "bad": "red", "unknown": "dim"}
_STYLES: Mapping[str, str] = {"yes": "green", "limited": "yellow", "no": "red", "unknown": "dim"}


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
    if numbers.health is not None and any(event.notable for event in numbers.health.events):
        parts += [Text(sentence(numbers.health), style="yellow"), Text()]
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
    table = _table()
    table.show_header = False
    for shown in lines:
        line, text = shown.line, f"{shown.number} {shown.line.text}".strip()
        table.add_row(Text(line.purpose), Text(line.word, style=_TONES[line.tone]), Text(text))
    return [table, Text()]


def _sentence(verdict: Verdict) -> Text:
    return Text(verdict.sentence, style=_STYLES[verdict.trust])


def _flights(flights: Sequence[FlightInShort], narrow: bool) -> Table:
    """Tabulate what each flight tells, by purpose."""
    table = _table()
    table.add_column("flight", no_wrap=True)
    if not narrow:
        table.add_column("craft", no_wrap=True)
    table.add_column("flown", justify="right", no_wrap=True)
    table.add_column("healthy", no_wrap=True)
    table.add_column("loops", no_wrap=True)
    table.add_column("predicts", justify="right", no_wrap=True)
    table.add_column("k/m" if narrow else "k/m (m/s²)", justify="right", no_wrap=True)
    longest = _LONGEST_CELL if narrow else _LONGEST_HEALTH
    for flight in flights:
        said = summary.brief(flight.answer)
        answers = [
            Text(shorten(each.text, longest, placeholder=" …"), _TONES[each.tone])
            for each in (said.healthy, said.loops, said.ahead)
        ]
        table.add_row(
            Text(_shortened(flight.name, 18 if narrow else 28)),
            *([] if narrow else [Text(summary.frame(flight.vehicle))]),
            f"{flight.flight.duration_s:.0f} s" if flight.flight else "–",
            *answers,
            "–" if flight.thrust is None else _per_mass(flight.thrust.common),
        )
    return table


def _reasons(flights: Sequence[FlightInShort]) -> list[str]:
    """Return why flights have no model, each reason once, numbers aside: ``No model: no GPS (march1 and 4 more)``."""
    names: dict[str, list[str]] = {}
    said: dict[str, str] = {}
    for flight in flights:
        if summary.best(flight.models) is None:
            reason = _first_clause(summary.first_reason(flight), flight.name)
            kind = re.sub(r"[0-9][0-9.]*", "0", reason)
            said.setdefault(kind, reason)
            names.setdefault(kind, []).append(flight.name)
    return [
        f"No model: {said[kind]} ({each[0]}{f' and {len(each) - 1} more' if len(each) > 1 else ''})"
        for kind, each in sorted(names.items(), key=lambda pair: -len(pair[1]))
    ]


def _models(models: Sequence[ModelReport]) -> list[RenderableType]:
    """Set models side by side with their errors on held-out flight, averaged, and the guess that they must beat."""
    judged = [result for result in models if result.held_out]
    if not judged:
        return []
    table = _table()
    table.add_column("model, on flight time held out", overflow="fold")
    outputs = list(judged[0].rmse_average_m)
    for output in outputs:
        table.add_column(f"{output} (m)", justify="right", no_wrap=True)
    table.add_column("predicts", justify="right", no_wrap=True)
    table.add_column("free run")
    rows: list[ByOutput] = [result.rmse_average_m for result in judged]
    rows.append(average([row.rmse_mean_m for row in judged[0].held_out]))
    columns = [column([row[output] for row in rows]) for output in outputs]
    for place, result in enumerate(judged):
        table.add_row(Text(result.title), *(cells[place] for cells in columns), summary.predicts(result), _word(result))
    table.add_row("always predicting the mean", *(cells[-1] for cells in columns), "", "", style="dim")
    return [table]


def _word(result: ModelInShort) -> Text:
    trust = result.verdict.trust
    return Text(summary.TRUST_WORDS[trust], style=_STYLES[trust])


def _table() -> Table:
    return Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")


def _per_mass(common: ThrustCoefficient) -> str:
    value, sigma = common.per_mass, common.sigma
    if value is None:
        return "–"
    if not value or not sigma or sigma < 0.0:
        return number(value)
    # As many digits as sigma leaves, four at most: the report has the rest.
    known = math.floor(math.log10(abs(value))) - math.floor(math.log10(sigma)) + 1
    return number(value, min(max(known, 1), 4))


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
