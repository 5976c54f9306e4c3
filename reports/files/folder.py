"""The products of one flight or of one craft as a folder: a page for people, the same numbers for machines."""

from __future__ import annotations

import csv
import io
import logging
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path

import pandas as pd

from core.serialization import as_json, from_json
from core.table import as_cell
from pipeline.flight.summary import flight_report, models_file
from pipeline.results.craft import GroupResult
from pipeline.results.flight import FlightResult, ModelResult
from pipeline.results.model import RmseRow
from pipeline.results.report import CraftReport, FlightReport
from reports import SHARED_SCRIPT
from reports.figures.flight import FlightFigures, draw_craft, draw_flight
from reports.files.plot_images import ImageFormat, write_images
from reports.files.tracks import write_track
from reports.pages import html
from reports.pages.flight import MODELS_PAGE, flight_page, models_page
from sysid.rigid_body.physical import quantity
from sysid.transfer_functions.export import TransferMatrix, coefficients, write_mat

_LOG = logging.getLogger("rotorid.reports")

#: The page of a flight, and the plots of a flight or craft that need the result itself.
PAGE, FIGURES = "report.html", "figures.json"
#: The folder of the page on all flights, seen from that of one.
_BACK = "../../"
#: Columns of ``coefficients.csv``.
_COEFFICIENTS = ["owner", "model", "output", "input", "part", "power", "value", "std", "relative", "determined"]
#: Columns of ``parameters.csv``: every physical parameter by every method, a row each.
PARAMETERS = ("craft", "flight", "parameter", "value", "sigma", "unit", "method", "determined", "reason")


def write(result: FlightResult | GroupResult, folder: str | Path, plots: ImageFormat | None = None) -> Path:
    """Write what is known of one flight or of one craft.

    ``report.json``, ``rmse.csv``; ``models.json`` (``rotorid schema models`` describes it), ``models.mat``
    and ``coefficients.csv``, ``parameters.csv``; of a flight whose position is known ``track.geojson``, ``track.kml``
    and ``track.gpx``, and the pages ``report.html`` and ``models.html``, complete in themselves; of a craft
    ``figures.json``, the plots that the page on all flights shows of it.

    Parameters
    ----------
    result : FlightResult or GroupResult
    folder : str or Path
        Made when missing; files of the same names are replaced.
    plots : {"png", "svg"}, optional
        Format in which to write the plots of a flight as files too.

    Returns
    -------
    Path
        Of ``report.html``, or of a craft's ``report.json``.
    """
    return _write(result, Path(folder), plots, shared=False)


def write_for_fleet(result: FlightResult | GroupResult | None, folder: Path, plots: ImageFormat | None) -> Path:
    """Write the same for a folder ``flights/NAME`` or ``crafts/NAME`` that `write_fleet` composes from.

    A flight's page reads Plotly from one file beside the page on all flights instead of carrying it, 2.5 MB each, and
    links there. Without a result the pages are drawn of the report.json and figures.json that this wrote before.
    """
    if result is not None:
        return _write(result, folder, plots, shared=True)
    report, drawn = (folder / name for name in ("report.json", FIGURES))
    if not (folder / PAGE).exists():
        return report
    figures = from_json(drawn.read_bytes(), FlightFigures)
    return _show(from_json(report.read_bytes(), FlightReport), lambda: figures, folder, plots, shared=True)


def write_account(result: FlightResult, folder: Path, failed: str = "") -> Path:
    """Write the page of a flight of which no more than its account is known, yet or because the rest failed."""
    folder.mkdir(parents=True, exist_ok=True)
    numbers = flight_report(result)
    _write_page(folder / PAGE, lambda: flight_page(numbers, draw_flight(result, numbers), failed=failed))
    return folder / PAGE


def _write(result: FlightResult | GroupResult, folder: Path, plots: ImageFormat | None, *, shared: bool) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    report: FlightReport | CraftReport
    if isinstance(result, FlightResult):
        report = own = flight_report(result)
        draw = cache(lambda: draw_flight(result, own))
        path = _show(own, draw, folder, plots, shared=shared)
        if shared:
            with suppress(Exception):  # the page says it
                (folder / FIGURES).write_text(as_json(draw(), indent=None), encoding="utf-8")
        write_track(result, folder)
    else:
        report, path = result.report, folder / "report.json"
        (folder / FIGURES).write_text(as_json(draw_craft(result), indent=None), encoding="utf-8")
    (folder / "report.json").write_text(as_json(report), encoding="utf-8")
    (folder / "models.json").write_text(as_json(models_file(report, result.models)), encoding="utf-8")
    (folder / "rmse.csv").write_text(rmse_table(report.rmse), encoding="utf-8", newline="")
    _write_exports(report.name, result.models, folder)
    _write_parameters(report, folder)
    return path


def _show(
    numbers: FlightReport,
    draw: Callable[[], FlightFigures],
    folder: Path,
    plots: ImageFormat | None,
    *,
    shared: bool,
) -> Path:
    """Write the pages of a flight, and its plots as files where they are wanted."""
    back, script_file = (f"{_BACK}{PAGE}", _BACK + SHARED_SCRIPT) if shared else (None, "")
    _write_page(folder / PAGE, lambda: flight_page(numbers, draw(), back, script_file))
    _write_page(folder / MODELS_PAGE, lambda: models_page(numbers, draw(), script_file))
    if plots is not None:
        drawn = draw()
        write_images([*drawn.first, *drawn.flight, *drawn.predicted, *drawn.signals], folder, plots)
    return folder / PAGE


def _write_page(path: Path, render: Callable[[], str]) -> None:
    """Write a page; where it cannot be drawn, one that says so: a bug there must not cost numbers and other pages."""
    path.write_text(page_or_excuse(render, str(path)), encoding="utf-8")


def page_or_excuse(render: Callable[[], str], where: str) -> str:
    """Render a page; where that fails, one that says so."""
    try:
        return render()
    except Exception as error:
        _LOG.exception("drawing %s failed", where)
        return html.failed_page(error)


def rmse_table(rows: Sequence[RmseRow]) -> str:
    """Write CSV with a line per flight, part and model; an error that could not be computed is an empty cell."""
    outputs = list(dict.fromkeys(output for row in rows for output in row.rmse_m))
    kinds = {"rmse_m": "rmse_{}_m", "fit_percent": "fit_{}_percent", "rmse_mean_m": "rmse_mean_{}_m"}
    heads = [pattern.format(output) for pattern in kinds.values() for output in outputs]
    text = io.StringIO(newline="")
    table = csv.writer(text)
    table.writerow(["flight", "part", "scope", "model", "craft", "start_s", "duration_s", *heads])
    for row in rows:
        cells = [errors.get(output) for errors in (row.rmse_m, row.fit_percent, row.rmse_mean_m) for output in outputs]
        names = (
            None if name is None else as_cell(name) for name in (row.flight, row.part, row.scope, row.model, row.craft)
        )
        table.writerow(["" if cell is None else cell for cell in (*names, row.start_s, row.duration_s, *cells)])
    return text.getvalue()


def _write_exports(owner: str, models: Sequence[ModelResult], folder: Path) -> None:
    """Write every model that is a matrix of transfer functions.

    In ``models.mat`` they are variables by their kind: ``motors``, ``mixer``, ``reference``.
    """
    matrices = {model.key: model.model for model in models if isinstance(model.model, TransferMatrix)}
    tables = [coefficients(model).assign(owner=as_cell(owner), model=key) for key, model in matrices.items()]
    table = pd.concat(tables)[_COEFFICIENTS] if tables else pd.DataFrame(columns=_COEFFICIENTS)
    table.to_csv(folder / "coefficients.csv", index=False, float_format="%.9g")
    write_mat(matrices, folder / "models.mat")


def _write_parameters(report: FlightReport | CraftReport, folder: Path) -> None:
    """Write ``parameters.csv``; only its head where no method could be applied.

    A parameter comes in SI units where mass (and arm) were given, otherwise in those in which motion alone gives it,
    and is called accordingly: thrust in newtons, thrust over mass in m/s^2.
    """
    own = isinstance(report, FlightReport)
    frame = " ".join(part for part in (report.vehicle.frame_class, report.vehicle.frame_type) if part)
    owner = as_cell(frame if own else report.name), as_cell(report.name) if own else ""
    rows = []
    for row in report.parameters or ():
        si = row.si_value is not None
        value, sigma, unit = (row.si_value, row.si_sigma, row.si_unit) if si else (row.value, row.sigma, row.unit)
        name, divisor = quantity(row.parameter, unit)
        called = row.parameter if not si else f"{name} over {divisor}" if divisor else name
        known = value is not None
        rows.append((*owner, called, value, sigma if known else None, unit, row.method, known, row.note))
    pd.DataFrame(rows, columns=list(PARAMETERS)).to_csv(folder / "parameters.csv", index=False, float_format="%.9g")
