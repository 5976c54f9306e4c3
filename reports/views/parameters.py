"""What pages show of physics: parameters by every method side by side, and how much the inputs can tell."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from core.quantity import joined, number, uncertain
from core.table import Row, Table
from pipeline.results.coverage import Linearity
from pipeline.results.model import CoherenceReport, ModelReport, ParameterRow
from reports.views import log_words

#: What stands in a cell whose note, below the table, says why there is no number.
EMPTY = "–"
_CAPTION = (
    "From the same flight time, with one standard error; where only part of a motor’s effect can be known, per mass "
    "or per arm. Methods that agree within their errors are worth more than each alone; standard errors do not include "
    "what a method leaves out, such as wind. A dash means not determined: the reasons are below."
)


@dataclass(frozen=True, slots=True)
class ShownParameters:
    """Physical parameters, a column for each method, and why some are not there."""

    table: Table
    notes: Sequence[tuple[str, str]]


def parameters(rows: Sequence[ParameterRow] | None) -> ShownParameters | None:
    """Tabulate physical parameters; nothing when no method was applied.

    With the mass given each parameter that the mass turns into SI has a second line.
    """
    if not rows:
        return None
    methods = list(dict.fromkeys(row.method for row in rows))
    lines, notes = [], []
    for parameter in dict.fromkeys(row.parameter for row in rows):
        by_method = {row.method: row for row in rows if row.parameter == parameter}
        unit, _, condition = next(iter(by_method.values())).unit.partition(", ")
        label = _capital(parameter) + (f", {_written(unit)}" if unit.partition(" ")[0] != "1" else "")
        under = condition or _bracket(unit)
        known = {method: uncertain(row.value, row.sigma) for method, row in by_method.items() if row.value is not None}
        lines.append(Row(f"{label} ({under})" if under else label, [known.get(method, EMPTY) for method in methods]))
        si_unit = next((row.si_unit for row in by_method.values() if row.si_value is not None), "")
        if si_unit:
            si = {
                name: uncertain(row.si_value, row.si_sigma)
                for name, row in by_method.items()
                if row.si_value is not None
            }
            lines.append(Row(f"… in {_written(si_unit)}", [si.get(method, EMPTY) for method in methods]))
        reasons: dict[str, list[str]] = {}
        for method, row in by_method.items():
            if row.note:
                reasons.setdefault(row.note, []).append(method)
        notes += [
            (f"{_capital(parameter)}: {', '.join(who)}", log_words.sentence(reason)) for reason, who in reasons.items()
        ]
    return ShownParameters(Table("", methods, lines, _CAPTION), notes)


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _bracket(unit: str) -> str:
    return unit.partition("(")[2].rstrip(")") if "(" in unit else ""


def _written(unit: str) -> str:
    return unit.replace("^2", "²").replace("kg m²", "kg·m²")


@dataclass(frozen=True, slots=True)
class ShownCoherence:
    """How much of each output is a linear answer to the inputs: a table, sentences, and the band in rad/s."""

    table: Table | None
    sentences: Sequence[str]
    band: str


def coherence(models: Sequence[ModelReport]) -> ShownCoherence | None:
    """Tabulate how much of each output is a linear answer to the inputs of each model."""
    reports = [(result.title, result.coherence) for result in models if result.coherence is not None]
    known = [(title, report) for title, report in reports if not report.missing]
    if not reports:
        return None
    outputs = list(dict.fromkeys(output for _, report in known for output in report.outputs))
    rows = [
        (Row(title), [*(report.outputs.get(output, Linearity()).multiple_median for output in outputs), report.chance])
        for title, report in known
    ]
    band = known[0][1].band_rad_s if known else None
    return ShownCoherence(
        table=Table.of_numbers("Inputs", [*outputs, "chance"], rows, digits=(3, 2)) if known else None,
        sentences=[_worth(title, report) for title, report in known]
        + [f"{_capital(title)}: {log_words.sentence(report.missing)}" for title, report in reports if report.missing],
        band=" to ".join(number(edge, 2) for edge in band or ()),
    )


def _worth(title: str, report: CoherenceReport) -> str:
    """Report of which outputs the inputs tell something at most frequencies of the band, and of which they do not."""
    outputs = report.outputs
    good = [name for name, output in outputs.items() if (output.above_chance or 0.0) > 0.5]
    poor = [name for name in outputs if name not in good]
    title = _capital(title.partition(" → ")[0])
    if not poor:
        return f"{title}: {joined(good)} answer to them at most frequencies."
    if not good:
        return f"{title}: at most frequencies no answer that chance would not give; slower motion may still follow."
    answers = f"{joined(good)} answer{'s' if len(good) == 1 else ''} to them at most frequencies"
    return f"{title}: {answers}, {joined(poor)} hardly more than by chance."
