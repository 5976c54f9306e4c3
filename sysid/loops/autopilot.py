"""Settings of the loops of whichever autopilot wrote a log."""

from __future__ import annotations

from logparse import FlightLog
from sysid.loops.errors import LoopError
from sysid.loops.px4 import check_version, read_px4
from sysid.loops.settings import AXES, LoopSettings, firmware_version, read_copter


def read_settings(log: FlightLog, axis: str) -> LoopSettings:
    """Read an axis' loop from the parameters of a log.

    Raises
    ------
    LoopError
        For an unknown axis or firmware, or where parameters are missing.
    """
    if axis not in AXES:
        raise LoopError(f"there is no rate loop {axis!r}; the axes are {', '.join(AXES)}")
    return read_px4(log, axis) if log.vehicle.firmware == "PX4" else read_copter(log, axis)


def check_firmware(log: FlightLog) -> None:
    """Raise where the loops of a log's firmware are not known."""
    if log.vehicle.firmware == "PX4":
        check_version(log)
    else:
        firmware_version(log)
