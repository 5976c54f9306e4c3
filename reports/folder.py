"""Results as a folder: a page for people, JSON and CSV with the same numbers for machines."""

import csv
import json
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path

from pipeline.names import folder_names
from pipeline.results import FleetResult, FlightResult
from reports import html
from reports.exports import write_exports
from reports.numbers import Numbers, models, numbers_of, rmse_rows

_LOG = logging.getLogger("rotorid.reports")


#: Plotly's script where the pages of flights share it.
SHARED_SCRIPT = "plotly.min.js"


def write(result: FlightResult | FleetResult, folder: str | Path, *, share_script: bool = False) -> Path:
    """Write the report as a page and as numbers, and the models; for a fleet a page per flight as well.

    ``report.html``, ``report.json``, ``rmse.csv``; ``models.json`` (``models.schema.json`` of this package describes
    it), ``models.mat`` and ``coefficients.csv``.

    Parameters
    ----------
    result : FlightResult or FleetResult
    folder : str or Path
        Made when missing; files of the same names are replaced.
    share_script : bool
        Of a fleet: the pages of flights read Plotly from one file beside ``report.html`` instead of carrying it, 2.5 MB
        each. Such pages cannot be sent one by one.

    Returns
    -------
    Path
        Of ``report.html``.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    numbers = numbers_of(result)
    (folder / "report.json").write_text(_json(numbers), encoding="utf-8")
    (folder / "models.json").write_text(_json(models(result)), encoding="utf-8")
    _write_rmse(rmse_rows(numbers), folder / "rmse.csv")
    write_exports(result, folder)
    report = folder / "report.html"
    if isinstance(result, FlightResult):
        _write_page(report, lambda: html.flight_page(result, numbers))
    else:
        folders = folder_names([flight.name for flight in result.flights])
        _write_page(report, lambda: html.fleet_page(result, numbers, folders))
        if share_script and result.flights:
            (folder / SHARED_SCRIPT).write_bytes(html.plotly_script())
        _write_flight_pages(result, numbers, folder, folders, f"../../{SHARED_SCRIPT}" if share_script else "")
    return report


def _write_page(path: Path, render: Callable[[], str]) -> None:
    """Write a page; where it cannot be drawn, one that says so: a bug there must not cost numbers and other pages."""
    try:
        page = render()
    except Exception as error:
        _LOG.exception("drawing %s failed", path)
        page = html.failed_page(error)
    path.write_text(page, encoding="utf-8")


def _write_flight_pages(
    result: FleetResult, numbers: Numbers, folder: Path, folders: dict[str, str], script_file: str
) -> None:
    for flight, flight_numbers_ in zip(result.flights, numbers["flights"], strict=True):
        path = folder / "flights" / folders[flight.name] / "report.html"
        path.parent.mkdir(parents=True, exist_ok=True)
        render = partial(html.flight_page, flight, flight_numbers_, "../../report.html", script_file)
        _write_page(path, render)


def _json(value: object) -> str:
    return json.dumps(value, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def _write_rmse(rows: list[Numbers], path: Path) -> None:
    """Write a line per flight, part and model; an error that could not be computed is an empty cell."""
    outputs = list(dict.fromkeys(output for row in rows for output in row["rmse_m"]))
    kinds = {"rmse_m": "rmse_{}_m", "fit_percent": "fit_{}_percent", "rmse_mean_m": "rmse_mean_{}_m"}
    heads = [pattern.format(output) for pattern in kinds.values() for output in outputs]
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        names = ("flight", "part", "scope", "model", "craft", "start_s", "duration_s")
        table.writerow([*names, *heads])
        for row in rows:
            cells = [row[kind].get(output) for kind in kinds for output in outputs]
            facts = [row[name] for name in names]
            table.writerow(["" if cell is None else cell for cell in (*facts, *cells)])
