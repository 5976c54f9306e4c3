"""A folder of logs as one report, composed from the products of its flights and crafts alone."""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any, Protocol

from scipy.io import loadmat, savemat

from pipeline.fleet.result import FleetResult
from pipeline.names import printable
from pipeline.results.fleet import Failure
from reports import html
from reports.figure import Figure
from reports.fleet_markdown import fleet_markdown
from reports.fleet_numbers import fleet_numbers, flight_summary, rmse_rows
from reports.fleet_page import fleet_page
from reports.folder import SHARED_SCRIPT, as_json, page_or_excuse, rmse_table
from reports.rows import Numbers


class Products(Protocol):
    """Files by their paths, such as ``flights/paper01/report.json``."""

    def read(self, path: str) -> bytes:
        """Read a file."""
        ...

    def write(self, path: str, content: bytes) -> None:
        """Write a file in place of what was there."""
        ...


@dataclass(frozen=True, slots=True)
class Craft:
    """What the products of a craft hold: numbers, and plots that only its models could give."""

    numbers: Numbers
    responses: dict[str, dict[str, list[Figure]]] = field(default_factory=dict)
    predictions: dict[str, Figure] = field(default_factory=dict)


def write_fleet(fleet: FleetResult) -> None:
    """Compose the report on all flights in the store of a fleet.

    ``report.html`` (complete in itself but for the pages of flights, which it links), ``report.json`` (crafts in full,
    flights in short), ``report.md``; ``rmse.csv``, ``coefficients.csv`` and ``parameters.csv`` of all; ``models.json``
    and ``models.mat`` with the models of crafts and of those flights that belong to none; ``plotly.min.js`` for the
    pages of flights.
    """
    compose(
        fleet.store,
        [f"flights/{entry.folder}" for entry in fleet.flights],
        [f"crafts/{entry.folder}" for entry in fleet.groups],
        failures=_reasons(fleet.failures),
        passed_over=_reasons(fleet.passed_over),
        duplicates=_reasons(fleet.duplicates),
        removed=_reasons(fleet.removed),
        config={name: getattr(fleet.config, name) for name in fleet.config.__slots__},
        timings_s=dict(fleet.timings),
    )


def _reasons(failures: Iterable[Failure]) -> list[Numbers]:
    return [{"file": printable(each.file), "reason": printable(each.reason)} for each in failures]


def compose(store: Products, flights: Sequence[str], crafts: Sequence[str], **facts: Any) -> Numbers:
    """Compose the report on all flights from the folders of their products; give its numbers.

    Parameters
    ----------
    store : Products
    flights, crafts : sequence of str
        Folders.
    **facts
        Whatever else `fleet_numbers` takes.
    """
    summaries, rows = [], []
    for folder in flights:
        numbers = json.loads(store.read(f"{folder}/report.json"))
        summaries.append(flight_summary(numbers, folder))
        rows += numbers["rmse"]
    found = [_craft(store, folder) for folder in crafts]
    numbers = fleet_numbers([craft.numbers for craft in found], summaries, **facts)
    joint = {name for craft in found for name in (*craft.numbers["training"], *craft.numbers["held_out"])}
    alone = [folder for folder, summary in zip(flights, summaries, strict=True) if summary["name"] not in joint]
    store.write("report.json", as_json(numbers).encode())
    store.write("rmse.csv", rmse_table([*rmse_rows(numbers["groups"], []), *rows]).encode())
    store.write("coefficients.csv", _joined(store, [*crafts, *flights], "coefficients.csv"))
    store.write("parameters.csv", _joined(store, [*crafts, *flights], "parameters.csv"))
    store.write("models.json", as_json(_models(store, [*crafts, *alone]), indent=None).encode())
    store.write("models.mat", _matlab(store, crafts, alone))
    store.write("report.md", fleet_markdown(numbers).encode())
    if flights:
        store.write(SHARED_SCRIPT, html.plotly_script())
    store.write("report.html", page_or_excuse(lambda: fleet_page(numbers, found), "report.html").encode())
    return numbers


def _craft(store: Products, folder: str) -> Craft:
    numbers = json.loads(store.read(f"{folder}/report.json"))
    drawn = json.loads(store.read(f"{folder}/figures.json"))
    return Craft(
        numbers | {"folder": folder},
        {
            key: {output: [Figure(**each) for each in figures] for output, figures in outputs.items()}
            for key, outputs in drawn["responses"].items()
        },
        {flight: Figure(**each) for flight, each in drawn["predictions"].items()},
    )


def _models(store: Products, folders: Iterable[str]) -> Numbers:
    every = [json.loads(store.read(f"{folder}/models.json")) for folder in folders]
    return {"rotorid": version("rotorid")} | {
        kind: [owner for models in every for owner in models[kind]] for kind in ("joint", "flights")
    }


def _matlab(store: Products, crafts: Sequence[str], flights: Sequence[str]) -> bytes:
    """Write the models of crafts as structs ``craft1 ...`` and of flights as ``flight1 ...``, in the report's order."""
    structs = {}
    for kind, folders in (("craft", crafts), ("flight", flights)):
        for number, folder in enumerate(folders, start=1):
            variables = _loaded(store.read(f"{folder}/models.mat"))
            models = {name: value for name, value in variables.items() if not name.startswith("__")}
            if models:
                structs[f"{kind}{number}"] = models
    file: Any = io.BytesIO()  # scipy's annotations know paths only
    savemat(file, structs, long_field_names=True, oned_as="row")
    return bytes(file.getvalue())


def _loaded(content: bytes) -> dict[str, Any]:
    file: Any = io.BytesIO(content)
    return dict(loadmat(file))


def _joined(store: Products, folders: Sequence[str], name: str) -> bytes:
    """Join tables that have the same head."""
    lines: list[bytes] = []
    for folder in folders:
        head, *rows = store.read(f"{folder}/{name}").splitlines(keepends=True)
        lines += [head, *rows] if not lines else rows
    return b"".join(lines)
