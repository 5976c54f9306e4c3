"""The summary that a person reads in ten seconds at the end of ``rotorid analyze``."""

import math
import re
from collections.abc import Iterable

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from logparse.quantity import column, number
from reports import summary
from reports.health_views import sentence
from reports.rotation_line import rotation_line
from reports.rows import Numbers, average, held_out

#: Longest reason that stands in a cell.
_LONGEST_CELL = 24
_TONES = {"good": "green", "care": "yellow", "bad": "red", "unknown": "dim"}
_STYLES = {"yes": "green", "limited": "yellow", "no": "red", "unknown": "dim"}


def overview(numbers: Numbers, width: int = 120) -> RenderableType:
    """Tabulate flights with what their own models achieve, then each craft with what its joint model does.

    Parameters
    ----------
    numbers : dict
        Of a flight or a fleet.
    width : int
        Columns of the terminal; on a narrow one names are shortened and the craft is left out.
    """
    flights = [numbers] if numbers["kind"] == "flight" else numbers["flights"]
    parts: list[RenderableType] = []
    if flights:
        what = (
            "The best model of each flight: free-run RMSE on the last part of the flight, which the fit has not seen."
        )
        table, notes = _flights(flights, narrow=width < 100)
        parts += [Text(what, style="dim"), table]
        parts += [Text(f"[{number}] {reason}", style="dim") for reason, number in notes.items()]
    for group in numbers.get("groups", []):
        parts += [Text(), Text(" ".join(summary.joint_sentences(group))), *_models(group["models"])]
        parts.append(_sentence(group["verdict"]))
    unused = summary.left_out(numbers)
    if unused:
        parts.append(Text("\n" + "\n".join(unused), style="dim"))
    if numbers["kind"] == "flight":
        parts = [*_answer(numbers["answer"]), *parts]
        if numbers["health"] is not None and any(event["severity"] != "info" for event in numbers["health"]["events"]):
            parts += [Text(), Text(sentence(numbers["health"]), style="yellow")]
        if line := rotation_line(numbers["rotation"]):
            parts += [Text(), Text(line)]
        if sum(result["model"] is not None for result in numbers["models"]) > 1:
            parts += [Text(), *_models(numbers["models"])]
        parts.append(_sentence(numbers["verdict"]))
    return Group(*parts)


def _answer(answer: Numbers | None) -> list[RenderableType]:
    """Tabulate the answer for each purpose, as the first screen of the report does."""
    lines = summary.answer_lines(answer)
    if not lines:
        return []
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), show_header=False)
    for line in lines:
        text = f"{line['number']} {line['text']}".strip()
        table.add_row(Text(line["purpose"]), Text(line["word"], style=_TONES[line["tone"]]), Text(text))
    return [table, Text()]


def _sentence(verdict: Numbers) -> Text:
    return Text(verdict["sentence"], style=_STYLES[verdict["trust"]])


def _flights(flights: list[Numbers], narrow: bool) -> tuple[Table, dict[str, int]]:
    """Tabulate flights; reasons too long for a cell become notes, each named once by its number."""
    table = _table()
    notes: dict[str, int] = {}
    table.add_column("log", no_wrap=True)
    if not narrow:
        table.add_column("craft", no_wrap=True)
    table.add_column("airborne", justify="right", no_wrap=True)
    table.add_column("k/m" if narrow else "k/m (m/s²)", justify="right", no_wrap=True)
    for output in "xyz":
        table.add_column(f"{output} (m)", justify="right", no_wrap=True)
    table.add_column("model")
    table.add_column("verdict")
    chosen = [summary.best(flight["models"]) for flight in flights]
    held = [None if result is None else held_out(result)[0] for result in chosen]
    errors = [column([row["rmse_m"].get(output) if row else None for row in held]) for output in "xyz"]
    for place, (flight, result) in enumerate(zip(flights, chosen, strict=True)):
        vehicle = flight["vehicle"]
        table.add_row(
            Text(_shortened(flight["name"], 18 if narrow else 28)),
            *([] if narrow else [Text(summary.frame(vehicle))]),
            f"{flight['flight']['duration_s']:.0f} s" if flight["flight"] else "–",
            _per_mass(flight["thrust"]),
            *(cells[place] for cells in errors),
            Text("–" if result is None else result["key"].replace("_", " ")),
            _why(_first_clause(summary.first_reason(flight), flight["name"]), notes)
            if result is None
            else _word(result),
        )
    return table, notes


def _why(reason: str, notes: dict[str, int]) -> Text:
    """Write a reason where it is short; else the number of the note that holds it, which is added where it is new."""
    if len(reason) <= _LONGEST_CELL:
        return Text(reason, style="dim")
    return Text(f"no model [{notes.setdefault(reason, len(notes) + 1)}]", style="dim")


def _models(models: list[Numbers]) -> list[RenderableType]:
    """Set models side by side with their errors on held-out flight, averaged, and the guess that they must beat."""
    judged = [result for result in models if held_out(result)]
    if not judged:
        return []
    table = _table()
    table.add_column("model, on flight time held out", overflow="fold")
    outputs = list(judged[0]["rmse_average_m"])
    for output in outputs:
        table.add_column(f"{output} (m)", justify="right", no_wrap=True)
    table.add_column("predicts", justify="right", no_wrap=True)
    table.add_column("free run")
    mean = average(held_out(judged[0]), "rmse_mean_m")
    rows = [*(result["rmse_average_m"] for result in judged), mean]
    columns = [column([row[output] for row in rows]) for output in outputs]
    for place, result in enumerate(judged):
        table.add_row(
            Text(result["title"]), *(cells[place] for cells in columns), summary.predicts(result), _word(result)
        )
    table.add_row("always predicting the mean", *(cells[-1] for cells in columns), "", "", style="dim")
    return [table]


def _word(result: Numbers) -> Text:
    trust = result["verdict"]["trust"]
    return Text(summary.TRUST_WORDS[trust], style=_STYLES[trust])


def _table() -> Table:
    return Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")


def _per_mass(thrust: Numbers | None) -> str:
    if not thrust or not thrust["common"]["determined"]:
        return "–"
    value, sigma = thrust["common"]["per_mass"], thrust["common"]["sigma"]
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


def failures(numbers: Numbers) -> Iterable[str]:
    """Name each log that gave nothing with its reason, one line for each."""
    for failure in numbers.get("failures", []):
        file, reason = failure["file"], failure["reason"]
        yield reason if reason.startswith(file) else f"{file}: {reason}"


def no_model(numbers: Numbers) -> str:
    """Explain why no analysed log gave a thrust or a model; empty where one did, or all failed anyway."""
    flights = [numbers] if numbers["kind"] == "flight" else numbers["flights"]
    every = [*flights, *numbers.get("groups", [])]
    if not flights or any(
        each["thrust"] is not None or any(result["model"] is not None for result in each["models"]) for each in every
    ):
        return ""
    return f"no model could be identified: {summary.first_reason(flights[0])}"
