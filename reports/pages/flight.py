"""The two pages of a flight: what happened to the craft, and beside it everything about its models."""

from __future__ import annotations

from core.findings import Severity
from pipeline.results.answer import Answer
from pipeline.results.report import FlightReport
from reports.figures.flight import FlightFigures
from reports.figures.models import horizon_figure, off_by_default
from reports.pages.html import render
from reports.views import models as views
from reports.views import summary
from reports.views.flight import estimate_details, excitation, flight_coverage, happened, log_details, reported
from reports.views.models import MOST_ADVICE, failing, holding
from reports.views.rotation import loop_table, loop_warnings, rotation_view

#: The page on models, beside report.html.
MODELS_PAGE = "models.html"


def flight_page(
    numbers: FlightReport, drawn: FlightFigures, back: str | None = None, script_file: str = "", failed: str = ""
) -> str:
    """Render the page of one flight.

    `back` links to the page of the fleet; Plotly's script is in `script_file`, or in the page itself where that is "";
    `failed` says why no more than the account could be made.
    """
    rotation, lines = numbers.rotation, () if numbers.answer is None else numbers.answer.lines
    return render(
        "flight.html",
        [*drawn.first, *drawn.flight, *drawn.signals],
        script_file,
        name=numbers.name,
        failed=failed,
        back=back,
        facts=summary.facts(numbers),
        headline=lines[0] if lines else None,
        answer=lines[1:],
        next_step="" if numbers.answer is None else numbers.answer.next,
        first_figures=drawn.first,
        account=numbers.account,
        happened=happened(numbers.account),
        reported=reported(numbers.account),
        flight_figures=drawn.flight,
        signal_figures=drawn.signals,
        loops=None if rotation is None or not _margins_known(numbers.answer) else loop_table(rotation),
        loop_warnings=() if rotation is None else loop_warnings(rotation),
        holding=holding(numbers.models),
        others=failing(numbers.models),
        findings=[finding for finding in numbers.findings if finding.severity is not Severity.INFO],
        advice=numbers.advice[:MOST_ADVICE],
        more_advice=numbers.advice[MOST_ADVICE:],
        missing=views.missing_stages(numbers),
        details=log_details(numbers),
    )


def models_page(numbers: FlightReport, drawn: FlightFigures, script_file: str = "") -> str:
    """Render the page with all models of a flight and how they were judged."""
    ahead = horizon_figure(numbers.models, hidden=off_by_default(numbers.models))
    turning = rotation_view(numbers.rotation, numbers.log.file)
    turned = [] if turning is None else turning.figures
    figures = [*([] if ahead is None else [ahead]), *drawn.predicted, *drawn.board.figures, *turned]
    return render(
        "models.html",
        figures,
        script_file,
        name=numbers.name,
        facts=summary.facts(numbers),
        predicted=drawn.predicted,
        ahead=ahead,
        rmse=views.flight_rmse(numbers.models),
        board=drawn.board,
        turning=turning,
        covered=flight_coverage(numbers.coverage),
        excitation=excitation(numbers.coverage),
        findings=numbers.findings,
        details=estimate_details(numbers),
        **views.of_models(numbers),
    )


def _margins_known(answer: Answer | None) -> bool:
    """Return whether the first screen has a margin: what its sigma covers is not known."""
    return answer is not None and any(line.purpose == "Loops" and line.unit == "°" for line in answer.lines)
