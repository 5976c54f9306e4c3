"""The page on all flights, the answer first, and a page on the models of each craft."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from logparse import Severity
from pipeline.results.report import CraftReport, FleetReport
from reports.figures.drawn import CraftFigures
from reports.figures.figure import Figure
from reports.figures.fleet import (
    FIRST_HEIGHT,
    coverage_figures,
    drift_figures,
    flights_over_time,
    motors_over_flights,
    parameters_over_flights,
)
from reports.figures.models import horizon_figure
from reports.pages import html
from reports.views import fleet as fleet_views
from reports.views import log_words, summary
from reports.views import tables as views
from reports.views.coverage import coverage_table, outside
from reports.views.craft import (
    average_table,
    validation_table,
    vehicle_facts,
)
from reports.views.details import settings
from reports.views.drift import drift_sentences, drift_table
from reports.views.fleet_answer import Insight, called, fleet_answer, insight
from reports.views.models import MOST_ADVICE, holding

#: What the products of a craft hold: its report, and the plots that only its models could give.
Shown = tuple[CraftReport, CraftFigures]


def craft_file(place: int) -> str:
    """Return the file of the page of a craft, counted from 1, beside the page on all flights."""
    return f"craft{place}.html"


def craft_models_page(craft: Shown, numbers: FleetReport, place: int, script_file: str) -> str:
    """Render the page with everything about the models of a craft."""
    pages = fleet_views.links(numbers.flights)
    report, drawn = craft
    prefix = f"{place}-"
    ahead = horizon_figure(report.models, f"{prefix}horizons")
    covered = coverage_figures(report.coverage, prefix)
    courses, folded = drift_figures(report.drift, prefix)
    flown = {
        flight: replace(figure, id=f"{prefix}prediction-{number}", place=f"{prefix}prediction", time=False)
        for number, (flight, figure) in enumerate(drawn.predictions.items())
    }
    board = drawn.board.within(prefix)
    coverage_findings = () if report.coverage is None else report.coverage.findings
    drift_findings = () if report.drift is None else report.drift.findings
    told = [log_words.sentence(finding.reason) for finding in drift_findings]
    return html.render(
        "craft_models.html",
        [*([ahead] if ahead else []), *flown.values(), *covered, *courses, *folded, *board.figures],
        script_file,
        id=f"craft-{place}",
        report=report,
        sentences=[*summary.joint_sentences(report), *drift_sentences(report.drift)[:1]],
        average=average_table(report),
        ahead=ahead,
        validation=validation_table(report, pages),
        prediction=_choice(flown, report, pages),
        coverage=coverage_table(report.coverage),
        coverage_findings=coverage_findings,
        outside=outside(report.coverage),
        covered=covered,
        vehicle=vehicle_facts(report.vehicle),
        drift=drift_table(report.drift),
        drift_findings=drift_findings,
        drift_sentences=[sentence for sentence in drift_sentences(report.drift) if sentence not in told],
        courses=courses,
        courses_folded=folded,
        board=board,
        **views.of_models(report),
        findings=[finding for finding in report.findings if finding not in (*coverage_findings, *drift_findings)],
    )


def fleet_page(numbers: FleetReport, crafts: Sequence[CraftReport]) -> str:
    """Render the page on all flights; `crafts` are in the order of the report."""
    pages = fleet_views.links(numbers.flights)
    answer = fleet_answer(numbers)
    told = insight(numbers)
    first = _insight_figure(told) or flights_over_time(numbers.flights)
    firsts = [] if first is None else [first]
    courses = [drift_figures(each.drift, f"{place}-")[0] for place, each in enumerate(crafts, start=1)]
    drawn = zip(crafts, courses, strict=True)
    shown = [
        _shown(craft, called(craft, numbers.groups), place, figures)
        for place, (craft, figures) in enumerate(drawn, start=1)
    ]
    figures = [*firsts, *(figure for some in courses for figure in some)]
    # Tables of more flights are folded.
    return html.render(
        "fleet.html",
        figures,
        title=fleet_views.title(numbers),
        facts=fleet_views.facts(numbers),
        headline=answer[0],
        answer=answer[1:],
        first_figures=firsts,
        crafts=shown,
        health=fleet_views.health_table(numbers),
        flights=fleet_views.flights_table(numbers, pages),
        unfolded=len(numbers.flights) <= 60,
        serious=[each for each in numbers.findings if each.severity is Severity.ERROR],
        notes=[each for each in numbers.findings if each.severity is not Severity.ERROR],
        failures=[(each.file, log_words.sentence(each.reason)) for each in numbers.failures],
        left_out=summary.left_out(numbers),
        unused=[
            (each.file, log_words.sentence(each.reason)) for kind in summary.not_used(numbers).values() for each in kind
        ],
        config=settings(numbers.config),
    )


def _insight_figure(told: Insight | None) -> Figure | None:
    """Draw what the first line is about, flight by flight."""
    if told is None or told.craft.drift is None:
        return None
    drift = told.craft.drift
    if told.history is None:
        figure = motors_over_flights(drift, "first-motors", [])
    else:
        figure = parameters_over_flights([told.history], drift, "first-course", [])
    return None if figure is None else replace(figure, caption="Flight by flight.", height=FIRST_HEIGHT)


def _shown(report: CraftReport, short: str, place: int, courses: Sequence[Figure]) -> dict[str, object]:
    """Return what the page on all flights shows of a craft; its own page has the rest."""
    findings = () if report.drift is None else report.drift.findings
    told = [log_words.sentence(finding.reason) for finding in findings]
    changes = [sentence for sentence in drift_sentences(report.drift) if sentence not in told]
    return {
        "id": f"craft-{place}",
        "name": report.name,
        "called": short,
        "page": craft_file(place),
        "sentences": [*summary.joint_sentences(report)[:1], *changes],
        "holding": holding(report.models),
        "drift_findings": findings,
        "courses": courses,
        "advice": report.advice[:MOST_ADVICE],
        "autopilot": report.autopilot.table() if report.autopilot and report.autopilot.values else None,
    }


def _choice(
    figures: Mapping[str, Figure], report: CraftReport, pages: Mapping[str, str]
) -> list[tuple[str, list[tuple[Figure, str, str]]]]:
    """Offer the flights to choose from with their plots and pages, those that judge first."""
    parts = [
        (label, [(figures[name], name, pages.get(name, "")) for name in names if name in figures])
        for label, names in (("judge the models", report.held_out), ("fitted", report.training))
    ]
    return [(label, options) for label, options in parts if options]
