"""The pages of a craft: over all its flights, and of `rotorid craft`, its parameters by every method side by side."""

from __future__ import annotations

from collections.abc import Sequence

from core.quantity import counted, uncertain
from logparse import Finding, Vehicle
from pipeline.results.answer import AnswerLine, Tone
from pipeline.results.drift import CraftReview, Note
from pipeline.results.model_report import ParameterRow
from reports.figures.fleet import drift_figures
from reports.numbers.flight import parameter_rows
from reports.pages import html
from reports.pages.html import render
from reports.views import summary
from reports.views.drift import change_table, drift_sentences, drift_table
from reports.views.parameters import parameters
from reports.views.summary import ShownAnswer
from sysid.rigid_body.physical import HEADLINE, PhysicalParameters, quantity


def craft_page(review: CraftReview, name: str, notes: Sequence[Note] = ()) -> str:
    """Render the page."""
    whole = review.whole or review.drift
    courses, folded = drift_figures(whole, "craft-", notes)
    boundary = review.boundary
    return html.render(
        "craft.html",
        [*courses, *folded],
        title=name,
        facts=_facts(review),
        findings=() if review.drift is None else review.drift.findings,
        sentences=[
            *(summary.sentence(sentence) for sentence in _changed(review)),
            *(s for s in drift_sentences(review.drift) if s not in _reasons(review)),
        ],
        remarks=[summary.sentence(remark) for remark in review.remarks],
        notes=[
            (f"{note.at:%Y-%m-%d %H:%M} UTC", note.text, "flights before it are not pooled" if note.boundary else "")
            for note in sorted(notes, key=lambda note: note.at, reverse=True)
        ],
        since=change_table(review.since) if review.since else None,
        since_title="" if boundary is None else f"Since {boundary.at:%Y-%m-%d}: {boundary.text}",
        courses=courses,
        drift=drift_table(review.drift),
        folded=folded,
        autopilot=review.autopilot.table() if review.autopilot and review.autopilot.values else None,
    )


def _facts(review: CraftReview) -> str:
    text = counted(len(review.flights), "flight")
    if review.pooled != review.flights:
        text += f", of which {len(review.pooled)} are pooled"
        if review.boundary is not None:
            text += f": those since {review.boundary.at:%Y-%m-%d} ({review.boundary.text})"
    return text


def _reasons(review: CraftReview) -> set[str]:
    findings = () if review.drift is None else review.drift.findings
    return {summary.sentence(finding.reason) for finding in findings}


def _changed(review: CraftReview) -> list[str]:
    """Report what changed with the last boundary."""
    if review.boundary is None or not review.since:
        return []
    changed = [
        f"{each.parameter} went from {uncertain(each.a.value, each.a.sigma)} to "
        f"{uncertain(each.b.value, each.b.sigma)} {each.unit.partition(',')[0]}".rstrip()
        for each in review.since
        if each.significant
    ]
    since = f"since {review.boundary.text} ({review.boundary.at:%Y-%m-%d})"
    if not changed:
        return [f"{since}, none of the {len(review.since)} parameters known on both sides is seen to differ"]
    return [f"{since}, {each}" for each in changed]


#: What a craft is asked first, and the parameters that answer, the first that is known.
_ASKED = (
    ("Thrust of a motor", ("thrust over mass",)),
    ("Inertia in roll", ("roll inertia over mass and arm",)),
    ("Inertia in pitch", ("pitch inertia over mass and arm",)),
    ("Drag", ("linear drag over mass", "quadratic drag over mass")),
)


def parameters_page(
    found: PhysicalParameters,
    vehicle: Vehicle | None,
    logs: Sequence[str],
    mass: float | None = None,
    findings: Sequence[Finding] = (),
) -> str:
    """Render the page."""
    rows = parameter_rows(found)
    weight = "mass not given, so numbers are per mass" if mass is None else f"{mass:g} kg"
    return render(
        "parameters.html",
        [],
        title="Craft" if vehicle is None else summary.craft(vehicle),
        facts=f"{counted(len(logs), 'flight')} ({', '.join(logs)}) · {weight}",
        answer=[_answer(asked, names, rows) for asked, names in _ASKED],
        parameters=parameters(rows),
        findings=[*found.findings, *findings],
    )


def _answer(asked: str, names: Sequence[str], rows: Sequence[ParameterRow]) -> ShownAnswer:
    """Answer with the headline in SI where it is known, else per mass, else with the reason."""
    headlines = [row for name in names for row in rows if (row.parameter, row.method) == (name, HEADLINE)]
    for row in headlines:
        for value, sigma, unit in ((row.si_value, row.si_sigma, row.si_unit), (row.value, row.sigma, row.unit)):
            if value is not None and sigma is not None:
                bare, _, condition = unit.partition(" (")[0].partition(" at ")[0].partition(", ")
                divisor = quantity(row.parameter, unit)[1]
                text = ", ".join(each for each in (divisor and f"over {divisor}", condition) if each)
                line = AnswerLine(purpose=asked, word="known", tone=Tone.GOOD, text=text)
                return ShownAnswer(line, uncertain(value, sigma, bare.replace("^2", "²").replace(" ", "·")))
    reasons = [row.note for row in rows if row.parameter in names and row.note]
    reason = summary.clause(reasons[0]) if reasons else "no method determines it"
    return ShownAnswer(AnswerLine(purpose=asked, word="not determined", tone=Tone.UNKNOWN, text=reason), "")
