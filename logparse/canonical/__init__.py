"""Canonical tables: one meaning, unit and frame per column, from the messages of any autopilot and age."""

from collections.abc import Mapping
from dataclasses import replace

import pandas as pd

from logparse.canonical import dataflash, px4, telemetry
from logparse.canonical.remarks import Remarks
from logparse.findings import Finding, Severity
from logparse.tables import COLUMNS, Tables
from logparse.vehicle import Vehicle

__all__ = ["build_tables"]

#: Messages that hold servo outputs.
_OUTPUTS = ("RCOU", "MOT", "SERVO_OUTPUT_RAW", "actuator_outputs")


def build_tables(
    messages: Mapping[str, pd.DataFrame],
    *,
    format: str,  # noqa: A002 -- the word of the door
    parameters: Mapping[str, float],
    vehicle: Vehicle,
) -> tuple[Tables, tuple[Finding, ...]]:
    """Build the canonical tables of one boot.

    Parameters
    ----------
    messages : mapping of str to DataFrame
        Decoded messages by name as logged, index `t` in seconds on the boot clock; only those needed are asked for.
    format : str
        ``"dataflash"``, ``"dataflash-text"``, ``"tlog"``, ``"mavlink-raw"`` or ``"ulog"``.
    parameters : mapping of str to float
        The autopilot's parameters.
    vehicle : Vehicle
        From `logparse.vehicle.describe`.

    Returns
    -------
    tables : Tables
    findings : tuple of Finding
        What had to be left out or assumed.
    """
    remarks = Remarks()
    if format.startswith("dataflash"):
        tables = dataflash.build(messages, parameters, vehicle, remarks)
    elif format == "ulog":
        tables = px4.build(messages, parameters, vehicle, remarks)
    else:
        tables = telemetry.build(messages, parameters, vehicle, remarks)
    # A table without a row says no more than a missing one.
    for name in COLUMNS:
        table = getattr(tables, name)
        if table is not None and len(table) == 0:
            tables = replace(tables, **{name: None})  # type: ignore[arg-type]
    if vehicle.frame_source == "assumed":
        remarks.add(
            Finding(
                id="frame-assumed",
                severity=Severity.WARNING,
                reason=f"The log names the frame type but not its class; taken as {vehicle.frame_class}.",
                advice="Check the number of motors: firmware before 3.2 does not log its frame class.",
            )
        )
    if not vehicle.motors and any(name in messages for name in _OUTPUTS):
        frame = "/".join(part for part in (vehicle.frame_class, vehicle.frame_type) if part)
        remarks.add(
            Finding(
                id="frame-unknown",
                severity=Severity.ERROR,
                reason=f"Servo outputs are logged, but no motor table is known for the frame {frame}."
                if vehicle.frame_class
                else "Servo outputs are logged, but nothing says which of them drive motors (no FRAME_CLASS).",
                advice="rotorid knows multirotors; their log needs the parameters, which are written when it starts.",
            )
        )
    return tables, remarks.findings()
