"""What happened in a flight, by time: reports of the autopilot, and what its sensors and outputs show."""

from logparse.events.event import FlightEvent
from logparse.events.timeline import flight_events

__all__ = ["FlightEvent", "flight_events"]
