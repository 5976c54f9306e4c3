"""``rotorid inspect``: what is in a log."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.options import Boot, existing_log, open_log, parted, power_up
from rotorid.cli.output import console


def inspect(
    log: Annotated[
        Path, typer.Argument(callback=existing_log, help="A log of any format; LOG#2 is the second flight of LOG.")
    ],
    boot: Boot = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write everything as JSON to stdout.")] = False,
) -> None:
    """Show what happened in a log and what is in it: craft, flights, tables with their rates and gaps.

    Example: rotorid inspect flight.bin
    """
    from pipeline.execution.progress import shown
    from pipeline.names import file_name

    file, flight = parted(log)
    with shown(quiet=as_json) as progress:
        # The numerical packages take a second to import: the terminal shows first that something happens.
        progress(f"reading {file_name(str(file))}", 0.0)
        import logparse
        from core.serialization import as_json as to_text
        from logparse.inspection import inspect as look_into
        from pipeline.flight.account import tell_each

        asked = logparse.read_log(file, power_up(boot)) if flight is None else open_log(log)
        found = look_into(asked)
        several = flight is None and boot is None and (len(asked.flights) > 1 or len(asked.boots) > 1)
        told = [account for _, account in tell_each(logparse.read_flights(file) if several else [asked])]
    if as_json:
        typer.echo(to_text(replace(found, happened=tuple(each.headline for each in told))), nl=False)
        return
    from reports.terminal import inspection

    console().print(inspection.overview(found, told))
