"""``parameters.csv``: every physical parameter by every method, a row each, with why it is not determined."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from core.cells import as_cell
from pipeline.results.failure import Failure
from pipeline.results.fleet import GroupResult
from pipeline.results.flight import FlightResult
from sysid.rigid_body.physical import quantity

COLUMNS = ("craft", "flight", "parameter", "value", "sigma", "unit", "method", "determined", "reason")


def write_parameters(result: FlightResult | GroupResult, folder: Path) -> Path:
    """Write the table; only its head where no method could be applied.

    A parameter comes in SI units where mass (and arm) were given, otherwise in those in which motion alone gives it,
    and is called accordingly: thrust in newtons, thrust over mass in m/s^2.
    """
    own = isinstance(result, FlightResult)
    vehicle = result.log.vehicle if isinstance(result, FlightResult) else None
    frame = " ".join(part for part in (vehicle.frame_class, vehicle.frame_type) if part) if vehicle else ""
    craft = frame if isinstance(result, FlightResult) else result.name
    rows = []
    if not isinstance(result.parameters, Failure):
        for row in result.parameters.table.reset_index().to_dict("records"):
            si = pd.notna(row["si_value"])
            value = row["si_value"] if si else row["value"]
            known = pd.notna(value)
            name, divisor = quantity(row["parameter"], row["si_unit"] if si else row["unit"])
            rows.append(
                {
                    "craft": as_cell(craft),
                    "flight": as_cell(result.name) if own else "",
                    "parameter": f"{name} over {divisor}" if divisor and si else name if si else row["parameter"],
                    "value": value if known else None,
                    "sigma": (row["si_sigma"] if si else row["sigma"]) if known else None,
                    "unit": row["si_unit"] if si else row["unit"],
                    "method": row["method"],
                    "determined": bool(known),
                    "reason": str(row["note"] or "") if pd.notna(row["note"]) else "",
                }
            )
    file = folder / "parameters.csv"
    pd.DataFrame(rows, columns=list(COLUMNS)).to_csv(file, index=False, float_format="%.9g")
    return file
