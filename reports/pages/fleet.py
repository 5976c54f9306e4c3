"""The page on all flights: the answer first, then every craft, then flights and logs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from core.table import Table
from pipeline.results.report import CraftReport, FleetReport
from reports.figures.coverage import coverage_figures
from reports.figures.drift import drift_figures
from reports.figures.figure import Figure
from reports.figures.models import horizon_figure
from reports.pages import html
from reports.views import fleet as fleet_views
from reports.views import summary
from reports.views import tables as views
from reports.views.coverage import coverage_table, outside
from reports.views.craft import (
    Choice,
    CraftSection,
    average_table,
    residual_table,
    validation_table,
    vehicle_facts,
)
from reports.views.details import settings
from reports.views.drift import drift_sentences, drift_table
from reports.views.fleet import FlightRow, ShownFinding
from reports.views.fleet_answer import fleet_answer, furthest
from reports.views.model_board import Board
from reports.views.models import identified, judgements, thrust_coefficients
from reports.views.parameters import coherence, parameters
from reports.views.summary import ShownAnswer

#: Tables of more flights are folded.
MOST_UNFOLDED = 60
_FIRST_HEIGHT = 430
_AHEAD = "Error of predictions on flights held out; grey: without a model."


@dataclass(frozen=True, slots=True)
class Craft:
    """What the products of a craft hold: its report, and plots that only its models could give."""

    report: CraftReport
    board: Board | None = None
    predictions: Mapping[str, Figure] = field(default_factory=dict)  #: Measured and predicted position by flight.


@dataclass(frozen=True, slots=True, kw_only=True)
class FleetPage:
    """What fleet.html shows."""

    numbers: FleetReport
    title: str
    facts: str
    crafts: Sequence[CraftSection]
    answer: Sequence[ShownAnswer]  #: The first screen, a line for each purpose.
    first_figures: Sequence[Figure]  #: What matters most, of the craft whose models predict furthest.
    health: Table | None
    flights: Sequence[FlightRow]
    unfolded: bool  #: Whether the table of flights is short enough to stand open.
    serious: Sequence[ShownFinding]
    notes: Sequence[ShownFinding]
    failures: Sequence[tuple[str, str]]
    left_out: Sequence[str]
    unused: Sequence[tuple[str, str]]
    config: Sequence[tuple[str, str]]


def fleet_page(numbers: FleetReport, crafts: Sequence[Craft]) -> str:
    """Render the page.

    Parameters
    ----------
    numbers : FleetReport
    crafts : sequence of Craft
        In the order of the report.
    """
    pages = fleet_views.links(numbers.flights)
    figures: list[Figure] = []
    sections = []
    for place, each in enumerate(crafts, start=1):
        section, drawn = _section(each, place, pages)
        figures += drawn
        sections.append(section)
    told = furthest(numbers)
    named = sections[:1] if told is None else [each for each in sections if each.name == told[0].name][:1]
    of = f" {named[0].name}." if named and len(sections) > 1 else ""
    first = [
        replace(each.ahead, id="first-ahead", height=_FIRST_HEIGHT, caption=_AHEAD + of) for each in named if each.ahead
    ]
    figures = [*first, *figures]
    serious, notes = fleet_views.common_findings(numbers)
    page = FleetPage(
        numbers=numbers,
        title=fleet_views.title(numbers),
        facts=fleet_views.facts(numbers),
        crafts=sections,
        answer=fleet_answer(numbers),
        first_figures=first,
        health=fleet_views.health_table(numbers),
        flights=fleet_views.flight_rows(numbers, pages),
        unfolded=len(numbers.flights) <= MOST_UNFOLDED,
        serious=serious,
        notes=notes,
        failures=[(each.file, summary.sentence(each.reason)) for each in numbers.failures],
        left_out=summary.left_out(numbers),
        unused=[
            (each.file, summary.sentence(each.reason)) for kind in summary.not_used(numbers).values() for each in kind
        ],
        config=settings(numbers.config),
    )
    return html.render("fleet.html", figures, page)


def _section(craft: Craft, place: int, pages: Mapping[str, str]) -> tuple[CraftSection, list[Figure]]:
    """Gather what is shown of a craft, and all its plots."""
    report, prefix = craft.report, f"{place}-"
    ahead = horizon_figure(report.models, f"{prefix}horizons")
    covered = coverage_figures(report.coverage, prefix)
    courses, folded = drift_figures(report.drift, prefix)
    flown = {
        flight: replace(figure, id=f"{prefix}prediction-{number}", place=f"{prefix}prediction", time=False)
        for number, (flight, figure) in enumerate(craft.predictions.items())
    }
    board = None if craft.board is None else craft.board.within(prefix)
    boarded = [] if board is None else board.every
    coverage_findings = () if report.coverage is None else report.coverage.findings
    drift_findings = () if report.drift is None else report.drift.findings
    told = [summary.sentence(finding.reason) for finding in drift_findings]
    section = CraftSection(
        id=f"craft-{place}",
        name=report.name,
        verdict=report.verdict,
        verdicts=views.verdicts(report.models),
        sentences=[*summary.joint_sentences(report), *drift_sentences(report.drift)[:1]],
        split=summary.sentence(report.split),
        missing=views.missing_stages(report),
        average=average_table(report),
        ahead=ahead,
        horizons=views.horizons(report.models),
        judgements=judgements(report.models),
        residuals=residual_table(report.models),
        coherence=coherence(report.models),
        validation=validation_table(report, pages),
        prediction=_choice(f"{prefix}prediction", flown, report, pages),
        coverage=coverage_table(report.coverage),
        coverage_findings=coverage_findings,
        outside=outside(report.coverage),
        covered=covered,
        vehicle=vehicle_facts(report.vehicle),
        thrust=thrust_coefficients(report.thrust, report.missing),
        parameters=parameters(report.parameters),
        drift=drift_table(report.drift),
        drift_findings=drift_findings,
        drift_sentences=[sentence for sentence in drift_sentences(report.drift) if sentence not in told],
        courses=courses,
        courses_folded=folded,
        models=identified(report.models),
        board=board,
        findings=[finding for finding in report.findings if finding not in (*coverage_findings, *drift_findings)],
        advice=report.advice,
    )
    return section, [*([ahead] if ahead else []), *flown.values(), *covered, *courses, *folded, *boarded]


def _choice(place: str, figures: Mapping[str, Figure], report: CraftReport, pages: Mapping[str, str]) -> Choice | None:
    """Offer the flights to choose from, those that judge first."""
    if not figures:
        return None
    parts = [
        (label, [(figures[name].id, name, pages.get(name, "")) for name in names if name in figures])
        for label, names in (("judge the models", report.held_out), ("fitted", report.training))
    ]
    first = next(iter(figures.values()))
    return Choice(
        place=place,
        parts=[(label, options) for label, options in parts if options],
        caption=first.caption,
        height=first.height,
        page=next(options[0][2] for _, options in parts if options),
    )
