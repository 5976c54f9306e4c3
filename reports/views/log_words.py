"""What logs, firmware and frames are called: all that showing a log needs, without the results of an analysis."""

from core import findings
from logparse import Vehicle

FORMATS = {
    "dataflash": "DataFlash log",
    "dataflash-text": "DataFlash text log",
    "tlog": "MAVLink telemetry log",
    "mavlink-raw": "MAVLink stream without time stamps",
    "ulog": "PX4 log",
}


def craft(vehicle: Vehicle) -> str:
    """Name a craft: ``ArduCopter 4.7.0, octa plus``, or ``ArduPlane 4.5, frame unknown``."""
    return ", ".join(
        part for part in (firmware(vehicle), frame(vehicle) if vehicle.frame_class else "frame unknown") if part
    )


def firmware(vehicle: Vehicle) -> str:
    """Name the firmware: ``ArduCopter 4.7.0``; empty when the log does not tell."""
    return " ".join(part for part in (vehicle.firmware or vehicle.autopilot, vehicle.version) if part)


def frame(vehicle: Vehicle) -> str:
    """Name the frame: ``octa plus``; ``unknown`` when the log does not tell."""
    # What a frame is called that the log does not tell.
    return " ".join(part for part in (vehicle.frame_class or "unknown", vehicle.frame_type) if part)


def sentence(text: str) -> str:
    """Make a clause of plain text, which writes ``m/s^2``, a sentence with raised powers."""
    return findings.sentence(text.replace("^2", "²").replace("^3", "³"))
