"""Logs of simulated rate loops, written and read again."""

from pathlib import Path
from typing import Any

from logparse import FlightLog, read_log
from simulation.axis_loop import AxisRun, write_rate_log


def logged(folder: Path, axes: AxisRun | dict[str, AxisRun], *, rate: float = 100.0, **how: Any) -> FlightLog:
    """Log axes by name, or one that rolled, in a file of its own in the folder; `how` as for `write_rate_log`."""
    path = folder / f"{len(list(folder.iterdir()))}.BIN"
    write_rate_log(path, axes if isinstance(axes, dict) else {"roll": axes}, rate=rate, **how)
    return read_log(path)
