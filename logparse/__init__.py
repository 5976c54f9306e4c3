"""Flight logs of Pixhawk autopilots: any format in, messages, canonical tables and findings out.

What needs pandas is imported when it is first used: errors and findings are also for those who do without.
"""

from typing import TYPE_CHECKING

from core.errors import LogError, MissingDataError, RotoridError
from core.findings import Finding, Severity
from core.lazy import exports

if TYPE_CHECKING:
    from logparse.craft.frames import Motor, Vehicle
    from logparse.flights import Flight
    from logparse.log import FlightLog, GivenLogs, check_is_log, logs_of, read_flights, read_log, read_power_ups
    from logparse.messages import Messages
    from logparse.source import Boot, MessageSource
    from logparse.tables import COLUMNS, Geodetic, Tables

__all__ = [
    "COLUMNS",
    "Boot",
    "Finding",
    "Flight",
    "FlightLog",
    "Geodetic",
    "GivenLogs",
    "LogError",
    "MessageSource",
    "Messages",
    "MissingDataError",
    "Motor",
    "RotoridError",
    "Severity",
    "Tables",
    "Vehicle",
    "check_is_log",
    "logs_of",
    "read_flights",
    "read_log",
    "read_power_ups",
]

__getattr__, __dir__ = exports(__name__, __file__)
