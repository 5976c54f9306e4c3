"""Models in the forms that other tools read: ``models.mat`` and ``coefficients.csv``, beside ``models.json``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pandas as pd

from pipeline.results import FleetResult, FlightResult, ModelResult
from sysid.export import TransferMatrix, coefficients, write_mat


def write_exports(result: FlightResult | FleetResult, folder: Path) -> None:
    """Write every model that is a matrix of transfer functions.

    In ``models.mat`` those of a flight are variables by their kind (``motors``, ``mixer``, ``reference``), those of a
    folder are structs of them: ``craft1 ...`` for joint models and ``flight1 ...`` for flights, in the report's order.
    """
    owners = list(_owners(result))
    tables = [
        coefficients(model).assign(owner=owner, model=key)
        for _, owner, models in owners
        for key, model in models.items()
    ]
    columns = ["owner", "model", "output", "input", "part", "power", "value", "std", "relative", "determined"]
    table = pd.concat(tables)[columns] if tables else pd.DataFrame(columns=columns)
    table.to_csv(folder / "coefficients.csv", index=False, float_format="%.9g")
    if isinstance(result, FlightResult):
        write_mat(owners[0][2], folder / "models.mat")
    else:
        write_mat({name: models for name, _, models in owners if models}, folder / "models.mat")


def _owners(result: FlightResult | FleetResult) -> Iterator[tuple[str, str, dict[str, TransferMatrix]]]:
    """Give for each flight and craft its variable, its name and its models by kind."""
    if isinstance(result, FlightResult):
        yield "flight1", result.name, _matrices(result.models)
        return
    for number, group in enumerate(result.groups, start=1):
        yield f"craft{number}", group.name, _matrices(group.models)
    for number, flight in enumerate(result.flights, start=1):
        yield f"flight{number}", flight.name, _matrices(flight.models)


def _matrices(models: tuple[ModelResult, ...]) -> dict[str, TransferMatrix]:
    return {result.key: result.model for result in models if isinstance(result.model, TransferMatrix)}
