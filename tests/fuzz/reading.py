"""Read a damaged log as a whole: everything that a user may ask of it, with LogError and its like as the only end."""

from __future__ import annotations

from pathlib import Path

import logparse
from logparse import RotoridError, completeness
from logparse.inspection import inspect


def read_whole(path: Path) -> str:
    """Return how reading ended: ``"read"``, or the message of the error that a user would see.

    Any other exception is a bug, and passes.
    """
    try:
        log = logparse.read_log(path)
        for name in log.messages:
            _ = log.messages[name]
        _ = (log.parameters, log.vehicle, log.tables, log.flights, log.findings, log.start_utc, log.duration, repr(log))
        completeness.check(log)
        inspect(log)
    except RotoridError as error:
        return str(error)
    return "read"
