"""What happened in a flight, by time: reports of the autopilot, and what its sensors and outputs show."""
