"""The page of `rotorid craft`: what the flights determine of a craft, by every method side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from core.quantity import counted
from logparse import Finding, Vehicle
from pipeline.flight.identification import parameter_rows
from pipeline.results.answer import AnswerLine, Tone, clause
from pipeline.results.model import ParameterRow, bare_unit, headlines
from reports.pages.html import render
from reports.views import log_words
from reports.views.parameters import parameters
from sysid.rigid_body.physical import PhysicalParameters, quantity

#: What a craft is asked first, and the parameters that answer, the first that is known.
_ASKED = (
    ("Thrust of a motor", ("thrust over mass",)),
    ("Inertia in roll", ("roll inertia over mass and arm",)),
    ("Inertia in pitch", ("pitch inertia over mass and arm",)),
    ("Drag", ("linear drag over mass", "quadratic drag over mass")),
)


def parameters_page(
    physical: PhysicalParameters,
    vehicle: Vehicle | None,
    logs: Sequence[str],
    mass: float | None = None,
    findings: Sequence[Finding] = (),
) -> str:
    """Render the page."""
    rows = parameter_rows(physical) or ()
    weight = "mass not given, so numbers are per mass" if mass is None else f"{mass:g} kg"
    return render(
        "parameters.html",
        [],
        title="Craft" if vehicle is None else log_words.craft(vehicle),
        facts=f"{counted(len(logs), 'flight')} ({', '.join(logs)}) · {weight}",
        answer=[_answer(asked, names, rows) for asked, names in _ASKED],
        parameters=parameters(rows),
        findings=[*physical.findings, *findings],
    )


def _answer(asked: str, names: Sequence[str], rows: Sequence[ParameterRow]) -> AnswerLine:
    """Answer with the headline in SI where it is known, else per mass, else with the reason."""
    determined = headlines(rows)
    for name in names:
        if name not in determined:
            continue
        value, sigma, unit = determined[name]
        divisor = quantity(name, unit)[1]
        line = AnswerLine(purpose=asked, word="known", tone=Tone.GOOD, text=f"over {divisor}" if divisor else "")
        return replace(line, value=value, sigma=sigma, unit=bare_unit(unit))
    reasons = [row.note for row in rows if row.parameter in names and row.note]
    reason = clause(reasons[0]) if reasons else "no method determines it"
    return AnswerLine(purpose=asked, word="not determined", tone=Tone.UNKNOWN, text=reason)
