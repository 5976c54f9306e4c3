"""Flight logs of Pixhawk autopilots: any format in, messages, canonical tables and findings out."""

from logparse.errors import LogError, MissingDataError, RotoridError
from logparse.findings import Finding, Severity
from logparse.source import Boot, MessageSource
from logparse.tables import COLUMNS, Geodetic, Tables
from logparse.vehicle import Motor, Vehicle

__all__ = [
    "COLUMNS",
    "Boot",
    "Finding",
    "Geodetic",
    "LogError",
    "MessageSource",
    "MissingDataError",
    "Motor",
    "RotoridError",
    "Severity",
    "Tables",
    "Vehicle",
]
