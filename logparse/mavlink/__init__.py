"""MAVLink telemetry: what a ground station recorded, read and written."""
