"""Options that several commands share, and logs as they are named on the command line."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.config import SETTINGS
from pipeline.names import is_url

if TYPE_CHECKING:
    from logparse import FlightLog

#: Number of a flight behind the name of a file: FLIGHT.bin#2.
_NUMBERED = re.compile(r"(.+)#(\d+)")

#: Which power-up of a log with several; shared by the commands that look into one log.
Boot = Annotated[
    int | None,
    typer.Option(
        min=1, help="Which power-up of a file with several, from 1. Default: the one with the longest flight."
    ),
]


def setting(name: str, *flags: str) -> Any:
    """Return the option of a setting of `AnalysisConfig`, in its words."""
    return typer.Option(*flags, help=SETTINGS[name].help)


def folder_of(path: str | Path) -> Path:
    """Return where results of a log or folder go when nobody says: out/NAME."""
    named = Path(path) if is_url(str(path)) else Path(path).resolve()
    return Path("out") / (named.name if named.is_dir() else named.stem)


def stretch(start: float | None, end: float | None) -> tuple[float | None, float | None]:
    """Check a time span on the log's clock; None where the log's own end is meant."""
    for option, value in (("--start", start), ("--end", end)):
        if value is not None and not math.isfinite(value):
            raise typer.BadParameter(f"{option} {value:g} is no time")
    if start is not None and end is not None and end < start:
        raise typer.BadParameter(f"--end {end:g} is before --start {start:g}")
    return start, end


#: A time span; shared by the commands that show or write one.
Start = Annotated[float | None, typer.Option(help="Leave out what was before, s on the log's clock.")]
End = Annotated[float | None, typer.Option(help="Leave out what was after, s on the log's clock.")]


def power_up(boot: int | None) -> int | None:
    """Index of a power-up that the user counts from 1."""
    return None if boot is None else boot - 1


def parted(name: Path) -> tuple[Path, int | None]:
    """Part a file and the number of one of its flights; a file whose own name ends so is that file."""
    numbered = _NUMBERED.fullmatch(str(name))
    if numbered is None or name.exists():
        return name, None
    return Path(numbered[1]), int(numbered[2])


def existing_log(given: Path | list[Path] | None) -> Path | list[Path] | None:
    """Check that logs on the command line are files, with or without the number of a flight."""
    for name in given if isinstance(given, list) else [given] if given is not None else []:
        file, _ = parted(name)
        if not file.is_file():
            raise typer.BadParameter(f"File '{file}' does not exist." if not file.exists() else f"'{file}' is no file.")
    return given


def open_power_ups(name: Path) -> tuple[FlightLog, ...]:
    """Read all power-ups of a log from the command line, or one of its flights, as `open_log` does."""
    from logparse import read_power_ups

    file, number = parted(name)
    return read_power_ups(file) if number is None else (open_log(name),)


def open_log(name: Path, boot: int | None = None) -> FlightLog:
    """Read a log from the command line, or one of its flights: FLIGHT.bin#2 is the second of all its power-ups.

    Without a number the longest flight counts; that there are others is said on the standard error.
    """
    from logparse import read_log

    file, number = parted(name)
    if number is None:
        log = read_log(file, power_up(boot))
        if len(log.flights) > 1 and log.flight is not None:
            longest = log.flights.index(log.flight) + 1
            typer.echo(
                f"{file.name} holds {len(log.flights)} flights; the longest, {file.name}#{longest}, is looked at",
                err=True,
            )
        return log
    return flight_of(file, number)


def flight_of(file: Path, number: int) -> FlightLog:
    """Read one of the flights of all power-ups of a log, 1 for the first."""
    from logparse import LogError, read_flights

    flights = read_flights(file)
    if flights[0].flight is None or not 1 <= number <= len(flights):
        count = 0 if flights[0].flight is None else len(flights)
        raise LogError(f"{file.name} holds {count} flight{'' if count == 1 else 's'}, not {number}")
    return flights[number - 1]
