"""From Pixhawk/ArduPilot flight logs to identified models of the craft, and what they are worth."""
