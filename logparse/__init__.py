"""Flight logs of Pixhawk autopilots: any format in, messages, canonical tables and findings out.

What needs pandas is imported when it is first used: errors and findings are also for those who do without.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from logparse.errors import LogError, MissingDataError, RotoridError
from logparse.findings import Finding, Severity

if TYPE_CHECKING:
    from logparse.events import FlightEvent, flight_events
    from logparse.flights import Flight
    from logparse.log import FlightLog, Messages, read_flights, read_log
    from logparse.source import Boot, MessageSource
    from logparse.tables import COLUMNS, Geodetic, Tables
    from logparse.vehicle import Motor, Vehicle

__all__ = [
    "COLUMNS",
    "Boot",
    "Finding",
    "Flight",
    "FlightEvent",
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
    "flight_events",
    "read_flights",
    "read_log",
]

_HOME = {
    "COLUMNS": "logparse.tables",
    "Boot": "logparse.source",
    "Flight": "logparse.flights",
    "FlightEvent": "logparse.events",
    "FlightLog": "logparse.log",
    "Geodetic": "logparse.tables",
    "MessageSource": "logparse.source",
    "Messages": "logparse.log",
    "Motor": "logparse.vehicle",
    "Tables": "logparse.tables",
    "Vehicle": "logparse.vehicle",
    "flight_events": "logparse.events",
    "read_flights": "logparse.log",
    "read_log": "logparse.log",
}


def __getattr__(name: str) -> object:
    if name not in _HOME:
        raise AttributeError(f"module 'logparse' has no attribute {name!r}")
    globals()[name] = value = getattr(import_module(_HOME[name]), name)
    return value
