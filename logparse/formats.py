"""Formats of logs by the names that results have of them, for those who go without the numerical packages."""

#: Formats that were received by radio, whose every message has a checksum.
TELEMETRY = ("tlog", "mavlink-raw")
