"""`flight_events`: all that happened in a log, in the order of time."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import chain

import pandas as pd

from logparse.events.attitude import attitude_error, attitude_events
from logparse.events.battery import battery_events
from logparse.events.event import FlightEvent
from logparse.events.impact import impact_events
from logparse.events.motors import motor_events
from logparse.events.navigation import navigation_events
from logparse.events.recording import recording_events
from logparse.events.reported import reported_events
from logparse.events.vibration import vibration_events
from logparse.flights import Flight
from logparse.numeric import NumericMessages
from logparse.tables import Tables

#: Events that follow from a crash and are not told again after it.
_AFTERMATH = {
    "attitude-deviation",
    "loss-of-control",
    "loss-of-yaw-authority",
    "oscillation",
    "motor-at-limit",
    "loss-of-lift",
    "free-fall",
    "gps-glitch",
    "gps-lost",
    "estimator-doubt",
    "vibration-high",
    "vibration-rise",
    "battery-sag",
    "battery-low",
}


def flight_events(
    tables: Tables, messages: Mapping[str, pd.DataFrame], flights: tuple[Flight, ...]
) -> tuple[FlightEvent, ...]:
    """Return the events of a log in the order of time.

    Parameters
    ----------
    tables : Tables
    messages : mapping of str to DataFrame
        As logged, for what has no canonical table (VIBE, DSF, XKF4).
    flights : tuple of Flight
        Airborne intervals; most events are looked for in them only.

    Returns
    -------
    tuple of FlightEvent
        Events that only follow from a crash of the same flight are left out.
    """
    error = attitude_error(tables)
    messages = NumericMessages(messages)
    found = chain(
        reported_events(tables, flights),
        attitude_events(tables, flights, error),
        impact_events(tables, flights, error),
        motor_events(tables, flights),
        navigation_events(tables, messages, flights),
        vibration_events(messages, flights, tables.imu),
        battery_events(tables, flights),
        recording_events(messages, flights),
    )
    events = sorted(found, key=lambda event: event.t)
    crashes = [event.t for event in events if event.id == "crash"]
    return tuple(
        _until_crash(event, crashes)
        for event in events
        if not (event.id in _AFTERMATH and _after(event.t, crashes, flights))
    )


def _until_crash(event: FlightEvent, crashes: list[float]) -> FlightEvent:
    """End an event at a crash that it would outlast."""
    end = min((crash for crash in crashes if event.t < crash < event.end), default=event.end)
    return replace(event, end=end) if event.id in _AFTERMATH and end < event.end else event


def _after(t: float, crashes: list[float], flights: tuple[Flight, ...]) -> bool:
    """Return whether a time lies after a crash with no flight beginning in between."""
    last = max((crash for crash in crashes if crash - 0.3 <= t), default=None)
    return last is not None and not any(last < flight.start <= t for flight in flights)
