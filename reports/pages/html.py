"""Results as pages that open offline: everything inside, everything from a log escaped."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cache
from importlib.metadata import version
from importlib.resources import files
from typing import TYPE_CHECKING

import jinja2
from markupsafe import Markup, escape

from core.table import Table
from pipeline.results.failure import present
from pipeline.results.flight import FlightResult
from pipeline.results.report import FlightReport
from reports.figures.figure import Figure
from reports.figures.flight import flight_figures
from reports.figures.models import horizon_figure, off_by_default
from reports.figures.signals import signal_figures
from reports.views import summary
from reports.views import tables as views
from reports.views.account import ShownAccount, shown_account
from reports.views.coverage import excitation, flight_coverage
from reports.views.details import details
from reports.views.first_screen import first_figures
from reports.views.model_board import Board, model_board
from reports.views.models import Judgement, ShownModel, ShownThrust, identified, judgements, thrust_coefficients
from reports.views.parameters import ShownCoherence, ShownParameters, coherence, parameters
from reports.views.rotation import Turning, rotation_view

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightPage:
    """What flight.html shows."""

    numbers: FlightReport
    back: str | None  #: Link to the page of the fleet.
    withdrawn: str  #: Why there is no trajectory; empty where there is one.
    facts: str
    board: Board
    answer: Sequence[summary.ShownAnswer]
    next_step: str
    first_figures: Sequence[Figure]
    predicted: Sequence[Figure]
    flight_figures: Sequence[Figure]
    signal_figures: Sequence[Figure]
    account: ShownAccount | None
    sentences: Sequence[str]
    verdicts: Sequence[views.ShownVerdict]
    missing: Sequence[tuple[str, str]]
    rmse: Table | None
    ahead: Figure | None
    horizons: Table | None
    judgements: Sequence[Judgement]
    thrust: ShownThrust
    parameters: ShownParameters | None
    coherence: ShownCoherence | None
    models: Sequence[ShownModel]
    turning: Turning | None
    covered: Table | None
    excitation: Sequence[str]
    details: Sequence[tuple[str, Sequence[tuple[str, str]]]]


def flight_page(result: FlightResult, numbers: FlightReport, back: str | None = None, script_file: str = "") -> str:
    """Render the page of one flight.

    Parameters
    ----------
    result : FlightResult
        For the plots.
    numbers : FlightReport
        Of the same result, for everything else.
    back : str, optional
        Link to the page of the fleet.
    script_file : str
        Where Plotly's script is, seen from the page; inside the page itself when empty.
    """
    first = first_figures(result)
    shown = {figure.id for figure in first}
    hidden = off_by_default(numbers.models)
    figures = [figure for figure in flight_figures(result, hidden) if figure.id not in shown]
    predicted = [figure for figure in figures if figure.id == "prediction"]
    figures = [figure for figure in figures if figure.id != "prediction"]
    signals = signal_figures(result)
    ahead = horizon_figure(numbers.models, hidden=hidden)
    board = model_board(result.models, hidden)
    turning = rotation_view(present(result.rotation), result.log.path.name)
    turned = [] if turning is None else turning.figures
    page = FlightPage(
        numbers=numbers,
        back=back,
        withdrawn=views.withdrawn(numbers),
        facts=summary.facts(numbers),
        board=board,
        answer=summary.answer_lines(numbers.answer),
        next_step="" if numbers.answer is None else numbers.answer.next,
        first_figures=first,
        predicted=predicted,
        flight_figures=figures,
        signal_figures=signals,
        account=shown_account(numbers.account),
        sentences=summary.sentences(numbers),
        verdicts=views.verdicts(numbers.models),
        missing=views.missing_stages(numbers),
        rmse=views.flight_rmse(numbers.models),
        ahead=ahead,
        horizons=views.horizons(numbers.models),
        judgements=judgements(numbers.models),
        thrust=thrust_coefficients(numbers.thrust, numbers.missing),
        parameters=parameters(numbers.parameters),
        coherence=coherence(numbers.models),
        models=identified(numbers.models),
        turning=turning,
        covered=flight_coverage(numbers.coverage),
        excitation=excitation(numbers.coverage),
        details=details(numbers),
    )
    every = [*first, *predicted, *figures, *signals, *([] if ahead is None else [ahead]), *board.every, *turned]
    return render("flight.html", every, page, script_file)


def failed_page(error: Exception) -> str:
    """Stand in for a page that could not be drawn, and say where its numbers are."""
    return (
        '<!DOCTYPE html><html lang="en"><head><meta charset="utf-8"><title>rotorid</title></head><body>'
        f"<p>This page could not be drawn ({escape(type(error).__name__)}: {escape(str(error))}). "
        "This is a bug in rotorid; please report it. All numbers are in report.json, models.json and rmse.csv.</p>"
        "</body></html>\n"
    )


def plotly_script() -> bytes:
    """Return Plotly's script, for a file that several pages share."""
    return (files("plotly") / "package_data" / "plotly.min.js").read_bytes()


def render(template: str, figures: Sequence[Figure], page: DataclassInstance, script_file: str = "") -> str:
    """Fill a template in with the figures that it shows and the fields of its page.

    Parameters
    ----------
    template : str
        File name in `templates/`.
    figures : sequence of Figure
        Figures of the page.
    page : dataclass
        The template's variables.
    script_file : str
        Where Plotly is, for pages that share one copy; "" to put it inside.
    """
    return (
        _environment()
        .get_template(template)
        .render(
            figures=figures,
            rotorid=version("rotorid"),
            figures_json=script_json([figure.packed() for figure in figures]),
            plotly=_packed_plotly() if figures and not script_file else "",
            script_file=script_file,
            style=Markup(_text("style.css")),
            script=Markup(_text("plots.js")) if figures else Markup(),
            **{each.name: getattr(page, each.name) for each in fields(page)},
        )
    )


def script_json(value: object) -> Markup:
    """Write JSON that may stand inside a script element whatever text it holds."""
    text = json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    for unsafe in "<>&\u2028\u2029":
        text = text.replace(unsafe, f"\\u{ord(unsafe):04x}")
    return Markup(text)


@cache
def _environment() -> jinja2.Environment:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("reports", "templates"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        bytecode_cache=_bytecode_cache(),
    )
    environment.filters["sentence"] = summary.sentence
    return environment


class _CompiledTemplates(jinja2.FileSystemBytecodeCache):
    """Compiled templates in a folder of the user's own among temporary files: compiling takes longer than a page."""

    def dump_bytecode(self, bucket: jinja2.bccache.Bucket) -> None:
        """Keep a template; a full disk is no reason to lose the page."""
        with suppress(OSError):
            super().dump_bytecode(bucket)


def _bytecode_cache() -> _CompiledTemplates | None:
    """Return the cache; None where there is no folder that only the user can write to."""
    try:
        return _CompiledTemplates()
    except (OSError, RuntimeError):
        return None


def _text(name: str) -> str:
    return (files("reports") / "templates" / name).read_text(encoding="utf-8")


@cache
def _packed_plotly() -> Markup:
    """Pack Plotly's script as base64 of gzip: 2 MB instead of 5 in every page (level 9: 1 % less in twice the time)."""
    return Markup(base64.b64encode(gzip.compress(plotly_script(), compresslevel=5, mtime=0)).decode("ascii"))
