"""Canonical tables: one meaning, unit and frame per column, from the messages of any autopilot and age."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import pandas as pd

from core.findings import Finding, Severity
from logparse.canonical import dataflash, px4, telemetry
from logparse.canonical.remarks import Remarks
from logparse.craft.frames import Vehicle
from logparse.tables import COLUMNS, LongTable, Tables

__all__ = ["TOGETHER", "gather_tables"]

#: Messages that `gather_tables` reads wherever they are logged, but for those of the fast loop.
TOGETHER = dataflash.TOGETHER

#: Messages that hold servo outputs.
_OUTPUTS = ("RCOU", "MOT", "SERVO_OUTPUT_RAW", "actuator_outputs")


def gather_tables(
    messages: Mapping[str, pd.DataFrame],
    *,
    format: str,  # noqa: A002 -- the public argument's name
    parameters: Mapping[str, float],
    vehicle: Vehicle,
) -> tuple[Tables, Callable[[], tuple[Finding, ...]]]:
    """Return the canonical tables of one boot, the longest of which are built when they are asked for.

    Parameters
    ----------
    messages : mapping of str to DataFrame
        Decoded messages by name as logged, index `t` in seconds on the boot clock; only those needed are asked for.
    format : str
        ``"dataflash"``, ``"dataflash-text"``, ``"tlog"``, ``"mavlink-raw"`` or ``"ulog"``.
    parameters : mapping of str to float
        The autopilot's parameters.
    vehicle : Vehicle
        From `logparse.craft.vehicle.describe`.

    Returns
    -------
    tables : Tables
    findings : callable
        Gives what had to be left out or assumed, as a tuple of Finding; builds what is not yet built.
    """
    remarks = Remarks()
    said: dict[str, Remarks] = {}  # Of long tables, when they are built.
    long: Mapping[str, LongTable] = {}
    if format.startswith("dataflash"):
        long = dataflash.long_tables(messages, said)
        tables = dataflash.build(messages, parameters, vehicle, remarks, long)
    elif format == "ulog":
        tables = px4.build(messages, parameters, vehicle, remarks)
    else:
        tables = telemetry.build(messages, parameters, vehicle, remarks)
    # A table without a row says no more than a missing one.
    empty = {name: None for name in COLUMNS if (table := getattr(tables, name)) is not None and len(table) == 0}
    if empty:
        tables = replace(tables, **empty)  # type: ignore[arg-type]
    if long:
        tables = tables.with_long(long)
    if vehicle.frame_source == "outputs":
        remarks.add(
            Finding(
                id="frame-unknown",
                severity=Severity.WARNING,
                reason="The log does not name the frame's class; outputs 1 to 4 alone drive motors, so that it is "
                f"taken as a {vehicle.frame_class}.",
                advice="Check the number of motors: firmware before 3.2 does not log its frame class.",
            )
        )
    elif vehicle.frame_source == "MAV_TYPE" and vehicle.frame_type is None and vehicle.motors:
        remarks.add(
            Finding(
                id="frame-unknown",
                severity=Severity.WARNING,
                reason=f"The log says {vehicle.frame_class}, but not which type; motors are taken to sit as in an x.",
                advice="Check the frame: of another type what is said about roll, pitch and single motors is wrong.",
            )
        )
    other_craft = vehicle.other_craft
    if not vehicle.motors and (other_craft or any(name in messages for name in _OUTPUTS)):
        frame = "/".join(part for part in (vehicle.frame_class, vehicle.frame_type) if part)
        remarks.add(
            Finding(
                id="frame-unknown",
                severity=Severity.ERROR,
                reason=f"Servo outputs are logged, but no motor table is known for the frame {frame}."
                if vehicle.frame_class
                else f"The robot is no multirotor ({vehicle.firmware}): its outputs are not taken for motors."
                if other_craft
                else "Servo outputs are logged, but nothing says which of them drive motors (no FRAME_CLASS).",
                advice="Models are fitted to multirotors only; of this log there is the trajectory alone."
                if other_craft
                else "rotorid knows multirotors; their log needs the parameters, which are written when it starts.",
            )
        )

    def findings() -> tuple[Finding, ...]:
        if "imu" in long and "imu" not in said:
            tables.imu  # noqa: B018 -- kept for who asks for the table next
        together = Remarks()
        for each in (remarks, *said.values()):
            together.take(each)
        return together.findings()

    return tables, findings
