"""DataFlash logs, the autopilot's own: read as binary or text, and written."""
