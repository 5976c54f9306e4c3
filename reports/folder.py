"""The products of one flight or of one craft as a folder: a page for people, the same numbers for machines."""

from __future__ import annotations

import csv
import io
import json
import logging
from collections.abc import Callable
from pathlib import Path

from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult
from reports import html
from reports.cells import as_cell
from reports.exports import write_exports
from reports.model_figures import response_figures
from reports.numbers import flight_numbers, group_numbers, models
from reports.parameter_files import write_parameters
from reports.prediction_figures import joint_predictions
from reports.rows import Numbers
from reports.track_files import write_track

_LOG = logging.getLogger("rotorid.reports")

#: Plotly's script where the pages of flights share it, at the root of a folder of flights and crafts.
SHARED_SCRIPT = "plotly.min.js"
#: The page on all flights, seen from that of one.
_BACK = "../../"


def write(result: FlightResult | GroupResult, folder: str | Path) -> Path:
    """Write what is known of one flight or of one craft.

    ``report.json``, ``rmse.csv``; ``models.json`` (``models.schema.json`` of this package describes it), ``models.mat``
    and ``coefficients.csv``, ``parameters.csv``; of a flight whose position is known ``track.geojson``, ``track.kml``
    and ``track.gpx``, and the page ``report.html``, complete in itself; of a craft ``figures.json``, the
    plots that the page on all flights shows of it.

    Parameters
    ----------
    result : FlightResult or GroupResult
    folder : str or Path
        Made when missing; files of the same names are replaced.

    Returns
    -------
    Path
        Of ``report.html``, or of a craft's ``report.json``.
    """
    return _write(result, Path(folder), shared=False)


def write_for_fleet(result: FlightResult | GroupResult, folder: str | Path) -> Path:
    """Write the same as `write` for a folder ``flights/NAME`` or ``crafts/NAME`` that `write_fleet` composes from.

    A flight's page reads Plotly from one file beside the page on all flights instead of carrying it, 2.5 MB each, and
    links there.
    """
    return _write(result, Path(folder), shared=True)


def _write(result: FlightResult | GroupResult, folder: Path, *, shared: bool) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    numbers = flight_numbers(result) if isinstance(result, FlightResult) else group_numbers(result)
    report = folder / "report.json"
    report.write_text(as_json(numbers), encoding="utf-8")
    (folder / "models.json").write_text(as_json(models(result)), encoding="utf-8")
    (folder / "rmse.csv").write_text(rmse_table(numbers["rmse"]), encoding="utf-8", newline="")
    write_exports(result, folder)
    write_parameters(result, folder)
    if isinstance(result, FlightResult):
        write_track(result, folder)
    if isinstance(result, GroupResult):
        (folder / "figures.json").write_text(as_json(_figures(result, numbers), indent=None), encoding="utf-8")
        return report
    page = folder / "report.html"
    back, script_file = (f"{_BACK}report.html", _BACK + SHARED_SCRIPT) if shared else (None, "")
    write_page(page, lambda: html.flight_page(result, numbers, back, script_file))
    return page


def _figures(group: GroupResult, numbers: Numbers) -> Numbers:
    """Draw what needs the models and their free runs themselves; all else is drawn from numbers."""
    trust = {model["key"]: model["verdict"]["trust"] for model in numbers["models"]}
    return {
        "responses": {
            result.key: {
                output: [figure.to_dict() for figure in figures] for output, figures in response_figures(result).items()
            }
            for result in group.models
        },
        "predictions": {flight: figure.to_dict() for flight, figure in joint_predictions(group, trust).items()},
    }


def write_page(path: Path, render: Callable[[], str]) -> None:
    """Write a page; where it cannot be drawn, one that says so: a bug there must not cost numbers and other pages."""
    path.write_text(page_or_excuse(render, str(path)), encoding="utf-8")


def page_or_excuse(render: Callable[[], str], where: str) -> str:
    """Render a page; where that fails, one that says so."""
    try:
        return render()
    except Exception as error:
        _LOG.exception("drawing %s failed", where)
        return html.failed_page(error)


def as_json(value: object, indent: int | None = 1) -> str:
    """Write strict JSON."""
    return json.dumps(value, indent=indent, allow_nan=False, ensure_ascii=False) + "\n"


def rmse_table(rows: list[Numbers]) -> str:
    """Write CSV with a line per flight, part and model; an error that could not be computed is an empty cell."""
    outputs = list(dict.fromkeys(output for row in rows for output in row["rmse_m"]))
    kinds = {"rmse_m": "rmse_{}_m", "fit_percent": "fit_{}_percent", "rmse_mean_m": "rmse_mean_{}_m"}
    heads = [pattern.format(output) for pattern in kinds.values() for output in outputs]
    text = io.StringIO(newline="")
    table = csv.writer(text)
    names = ("flight", "part", "scope", "model", "craft", "start_s", "duration_s")
    table.writerow([*names, *heads])
    for row in rows:
        cells = [row[kind].get(output) for kind in kinds for output in outputs]
        facts = [as_cell(fact) if isinstance(fact := row[name], str) else fact for name in names]
        table.writerow(["" if cell is None else cell for cell in (*facts, *cells)])
    return text.getvalue()
