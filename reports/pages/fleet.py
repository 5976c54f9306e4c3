"""Pages on many flights: of a folder, the answer first; of the models of a craft; of a craft over all its flights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from core.quantity import counted, uncertain
from logparse import Finding, Severity
from pipeline.results.drift import CraftNote, CraftReview, Drift
from pipeline.results.report import CraftReport, FleetReport
from reports.figures.figure import Figure
from reports.figures.fleet import (
    FIRST_HEIGHT,
    coverage_figures,
    drift_figures,
    flights_over_time,
    motors_over_flights,
    parameters_over_flights,
)
from reports.figures.flight import CraftFigures
from reports.figures.models import horizon_figure
from reports.pages import html
from reports.views import fleet as fleet_views
from reports.views import log_words, summary
from reports.views import models as views
from reports.views.fleet import Insight, called, change_table, drift_sentences, drift_table, fleet_answer, insight
from reports.views.flight import coverage_table, outside, settings, vehicle_details
from reports.views.models import (
    MOST_ADVICE,
    average_table,
    holding,
    validation_table,
)

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
    drift_findings, drift_said = _found_and_said(report.drift)
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
        vehicle=vehicle_details(report.vehicle),
        drift=drift_table(report.drift),
        drift_findings=drift_findings,
        drift_sentences=drift_said,
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
    leading = insight(numbers)
    first = _insight_figure(leading) or flights_over_time(numbers.flights)
    firsts = [] if first is None else [first]
    courses = [drift_figures(craft.drift, f"{place}-")[0] for place, craft in enumerate(crafts, start=1)]
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
        serious=[finding for finding in numbers.findings if finding.severity is Severity.ERROR],
        notes=[finding for finding in numbers.findings if finding.severity is not Severity.ERROR],
        failures=[(failure.file, log_words.sentence(failure.reason)) for failure in numbers.failures],
        left_out=summary.left_out(numbers),
        unused=[
            (out.file, log_words.sentence(out.reason)) for kind in summary.not_used(numbers).values() for out in kind
        ],
        config=settings(numbers.config),
    )


def _insight_figure(leading: Insight | None) -> Figure | None:
    """Draw what the first line is about, flight by flight."""
    if leading is None or leading.craft.drift is None:
        return None
    drift = leading.craft.drift
    if leading.history is None:
        figure = motors_over_flights(drift, "first-motors", [])
    else:
        figure = parameters_over_flights([leading.history], drift, "first-course", [])
    return None if figure is None else replace(figure, caption="Flight by flight.", height=FIRST_HEIGHT)


def _shown(report: CraftReport, short: str, place: int, courses: Sequence[Figure]) -> dict[str, object]:
    """Return what the page on all flights shows of a craft; its own page has the rest."""
    findings, changes = _found_and_said(report.drift)
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


def _found_and_said(drift: Drift | None) -> tuple[tuple[Finding, ...], list[str]]:
    """Return what was found over flights, and what there is to say besides."""
    findings = () if drift is None else drift.findings
    reasons = {log_words.sentence(finding.reason) for finding in findings}
    return findings, [sentence for sentence in drift_sentences(drift) if sentence not in reasons]


def _choice(
    figures: Mapping[str, Figure], report: CraftReport, pages: Mapping[str, str]
) -> list[tuple[str, list[tuple[Figure, str, str]]]]:
    """Offer the flights to choose from with their plots and pages, those that judge first."""
    parts = [
        (label, [(figures[name], name, pages.get(name, "")) for name in names if name in figures])
        for label, names in (("judge the models", report.held_out), ("fitted", report.training))
    ]
    return [(label, options) for label, options in parts if options]


def craft_page(review: CraftReview, name: str, notes: Sequence[CraftNote] = ()) -> str:
    """Render the page."""
    whole = review.whole or review.drift
    courses, folded = drift_figures(whole, "craft-", notes)
    boundary = review.boundary
    findings, said = _found_and_said(review.drift)
    return html.render(
        "craft.html",
        [*courses, *folded],
        title=name,
        facts=_facts(review),
        findings=findings,
        sentences=[*(log_words.sentence(sentence) for sentence in _changed(review)), *said],
        remarks=[log_words.sentence(remark) for remark in review.remarks],
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


def _changed(review: CraftReview) -> list[str]:
    """Report what changed with the last boundary."""
    if review.boundary is None or not review.since:
        return []
    changed = [
        f"{change.parameter} went from {uncertain(change.a.value, change.a.sigma)} to "
        f"{uncertain(change.b.value, change.b.sigma)} {change.unit.partition(',')[0]}".rstrip()
        for change in review.since
        if change.significant
    ]
    since = f"since {review.boundary.text} ({review.boundary.at:%Y-%m-%d})"
    if not changed:
        return [f"{since}, none of the {len(review.since)} parameters known on both sides is seen to differ"]
    return [f"{since}, {change}" for change in changed]
