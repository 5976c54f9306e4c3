"""Logs as a caller has them: read already, or as paths; one or several."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from core.errors import LogError
from logparse.log import FlightLog, read_log

#: What every function that asks for logs takes.
GivenLogs = FlightLog | str | Path | Sequence[FlightLog | str | Path]


def logs_of(given: GivenLogs) -> list[FlightLog]:
    """Return the logs, read where only their paths were given.

    Parameters
    ----------
    given : FlightLog, path-like, or a sequence of either

    Raises
    ------
    LogError
        Where something is neither a log nor the path of one.
    """
    several = [given] if isinstance(given, FlightLog | str | Path) else given
    if not isinstance(several, Sequence):
        raise LogError(f"a flight log, its path or a list of them is needed, not {type(given).__name__}")
    return [_log_of(each) for each in several]


def _log_of(given: object) -> FlightLog:
    if isinstance(given, FlightLog):
        return given
    if isinstance(given, str | Path):
        return read_log(given)
    raise LogError(f"a flight log or its path is needed, not {type(given).__name__}")
