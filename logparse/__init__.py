"""Flight logs of Pixhawk autopilots: any format in, messages, canonical tables and findings out."""

from logparse.errors import LogError, MissingDataError, RotoridError
from logparse.findings import Finding, Severity
from logparse.log import FlightLog, Messages, read_log
from logparse.source import Boot, MessageSource
from logparse.tables import COLUMNS, Geodetic, Tables
from logparse.vehicle import Motor, Vehicle

__all__ = [
    "COLUMNS",
    "Boot",
    "Finding",
    "FlightLog",
    "Geodetic",
    "LogError",
    "MessageSource",
    "Messages",
    "MissingDataError",
    "Motor",
    "RotoridError",
    "Severity",
    "Tables",
    "Vehicle",
    "read_log",
]
