"""``rotorid plot``: any fields of a log over time."""

import math
from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.options import Boot, power_up
from rotorid.cli.output import show_page


def plot(
    log: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="A log of any format.")],
    signals: Annotated[
        list[str],
        typer.Argument(
            help="Fields as logged (ATT.Roll, IMU[1].GyrX), columns of canonical tables (motors.m1), or expressions of "
            "them ('ATT.Roll - ATT.DesRoll', 'deg(IMU[0].GyrX)')."
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="Page to write. Default: named after the log, in this folder.")
    ] = None,
    boot: Boot = None,
    start: Annotated[float | None, typer.Option(help="Leave out what was before, s on the log's clock.")] = None,
    end: Annotated[float | None, typer.Option(help="Leave out what was after, s on the log's clock.")] = None,
    open_page: Annotated[bool, typer.Option("--open", help="Show the page in the browser.")] = False,
) -> None:
    """Plot fields of a log over time as a page that opens offline, those of one unit over each other.

    Example: rotorid plot flight.bin ATT.Roll ATT.DesRoll --open
    """
    import logparse
    from logparse.expressions import evaluate
    from reports.pages.signals import write_signal_plot

    for option, value in (("--start", start), ("--end", end)):
        if value is not None and not math.isfinite(value):
            raise typer.BadParameter(f"{option} {value:g} is no time")
    if start is not None and end is not None and end <= start:
        raise typer.BadParameter(f"--end {end:g} is not after --start {start:g}")
    flight_log = logparse.read_log(log, power_up(boot))
    found = [evaluate(flight_log, name) for name in signals]
    for signal in found:
        first, last = float(signal.t[0]), float(signal.t[-1])
        if (start is not None and start > last) or (end is not None and end < first):
            raise typer.BadParameter(f"{signal.name} covers {first:.1f} to {last:.1f} s; --start or --end lies outside")
    page = write_signal_plot(flight_log, found, out or Path(f"{log.stem}-plot.html"), start, end)
    typer.echo(page)
    if open_page:
        show_page(page)
