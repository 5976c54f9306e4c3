"""Models in the forms that other tools read: ``models.mat`` and ``coefficients.csv``, beside ``models.json``."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from logparse.cells import as_cell
from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult
from sysid.transfer_functions.export import TransferMatrix, coefficients, write_mat

_COLUMNS = ["owner", "model", "output", "input", "part", "power", "value", "std", "relative", "determined"]


def write_exports(result: FlightResult | GroupResult, folder: Path) -> None:
    """Write every model that is a matrix of transfer functions.

    In ``models.mat`` they are variables by their kind: ``motors``, ``mixer``, ``reference``.
    """
    matrices = {each.key: each.model for each in result.models if isinstance(each.model, TransferMatrix)}
    tables = [coefficients(model).assign(owner=as_cell(result.name), model=key) for key, model in matrices.items()]
    table = pd.concat(tables)[_COLUMNS] if tables else pd.DataFrame(columns=_COLUMNS)
    table.to_csv(folder / "coefficients.csv", index=False, float_format="%.9g")
    write_mat(matrices, folder / "models.mat")
