"""``rotorid inspect``, ``plot`` and ``export``: what is in a log."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rotorid.cli.options import Boot, End, Start, existing_log, folder_of, open_log, parted, power_up, stretch
from rotorid.cli.output import NOT_POSSIBLE, OK, console, prepare, show_page

if TYPE_CHECKING:
    from logparse import FlightLog


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
        from pipeline.flight.account import account_of_log

        asked = logparse.read_log(file, power_up(boot)) if flight is None else open_log(log)
        inspected = look_into(asked)
        several = flight is None and boot is None and (len(asked.flights) > 1 or len(asked.boots) > 1)
        accounts = [account_of_log(flown) for flown in (logparse.read_flights(file) if several else [asked])]
    if as_json:
        typer.echo(to_text(replace(inspected, happened=tuple(account.headline for account in accounts))), nl=False)
        return
    from reports.terminal import inspection

    console().print(inspection.overview(inspected, accounts))


def plot(
    log: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="A log of any format.")],
    signals: Annotated[
        list[str],
        typer.Argument(
            help="Fields as logged (ATT.Roll, IMU[1].GyrX), columns of canonical tables (motors.m1), or expressions of "
            "them ('ATT.Roll - ATT.DesRoll', 'deg(IMU[0].GyrX)')."
        ),
    ],
    out: Annotated[Path | None, typer.Option(help="Page to write. Default: out/NAME/plot.html, of the log.")] = None,
    boot: Boot = None,
    start: Start = None,
    end: End = None,
    open_page: Annotated[bool, typer.Option("--open", help="Show the page in the browser.")] = False,
) -> None:
    """Plot fields of a log over time as a page that opens offline, those of one unit over each other.

    Example: rotorid plot flight.bin ATT.Roll ATT.DesRoll --open
    """
    import logparse
    from logparse.expressions import evaluate
    from reports.pages.signals import write_signal_plot

    stretch(start, end)
    flight_log = logparse.read_log(log, power_up(boot))
    evaluated = [evaluate(flight_log, name) for name in signals]
    for signal in evaluated:
        first, last = float(signal.t[0]), float(signal.t[-1])
        if (start is not None and start > last) or (end is not None and end < first):
            raise typer.BadParameter(f"{signal.name} covers {first:.1f} to {last:.1f} s; --start or --end lies outside")
    page = out or folder_of(log) / "plot.html"
    page.parent.mkdir(parents=True, exist_ok=True)
    write_signal_plot(flight_log, evaluated, page, start, end)
    typer.echo(page)
    if open_page:
        show_page(page)


#: Most samples per second of a table of motion that nobody asked for otherwise.
_FASTEST_TABLE = 50.0


def export(
    logs: Annotated[
        list[Path], typer.Argument(callback=existing_log, help="A log of any format; with --autopilot all of a craft.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the files; made when missing. Default: out/NAME, of the log."),
    ] = None,
    table_format: Annotated[
        Literal["parquet", "csv", "mat"],
        typer.Option("--format", help="parquet and csv: a file for each table; mat: one file for MATLAB."),
    ] = "parquet",
    messages: Annotated[
        list[str] | None,
        typer.Option(
            help="Message as logged (RCOU) or canonical table (motors). Several: separated by commas, or the option "
            "given again. Default: everything."
        ),
    ] = None,
    boot: Boot = None,
    start: Start = None,
    end: End = None,
    table: Annotated[
        bool,
        typer.Option(
            "--table",
            help="Instead: estimated motion and motors of the longest flight on one clock, as parquet or csv, with the "
            "YAML that `analyze --columns` reads.",
        ),
    ] = False,
    rate: Annotated[
        float | None,
        typer.Option(min=1.0, max=1000.0, help="Samples per second of --table. Default: as motor outputs, at most 50."),
    ] = None,
    autopilot: Annotated[
        bool, typer.Option("--autopilot", help="Instead: parameters that the flights determined, as .param files.")
    ] = False,
) -> None:
    """Write messages as logged and canonical tables (SI units) as files for other programs.

    Example: rotorid export flight.bin --format csv --messages RCOU,imu --start 60 --end 120
    """
    if autopilot:
        _autopilot(logs, out or folder_of(parted(logs[0])[0]) / "autopilot")
        return
    if len(logs) > 1:
        raise typer.BadParameter("one log at a time, but for --autopilot", param_hint="LOGS")
    log = logs[0]
    from logparse.export import export as write_tables

    names = [name for part in messages or () for name in part.split(",") if name]
    stretch(start, end)
    folder = out or folder_of(log)
    flight_log = open_log(log, boot)
    first, last = flight_log.boot.t_start, flight_log.boot.t_end
    if (start is not None and start > last) or (end is not None and end < first):
        raise typer.BadParameter(f"the log covers {first:.1f} to {last:.1f} s; --start or --end lies outside it")
    prepare(folder)
    if table:
        for file in _table(flight_log, folder, table_format, (start, end), rate, bool(names)):
            typer.echo(file)
        return
    files = write_tables(flight_log, folder, format=table_format, messages=names or None, start=start, stop=end)
    for file in files:
        typer.echo(file)


def _table(
    log: "FlightLog",
    folder: Path,
    table_format: str,
    within: tuple[float | None, float | None],
    rate: float | None,
    messages: bool,
) -> tuple[Path, Path]:
    """Write the record of the longest flight as `Experiment.from_table` reads it."""
    import estimation
    from logparse.completeness import rate_of
    from sysid import Experiment
    from sysid.records.table_export import write_table

    if table_format == "mat" or messages:
        raise typer.BadParameter("--table writes parquet or csv, and no messages")
    trajectory = estimation.estimate(log.tables, date=log.start_utc)
    first, last = (
        (log.boot.t_start if within[0] is None else within[0]),
        (log.boot.t_end if within[1] is None else within[1]),
    )
    if rate is None:  # rows between those of the motors are nobody's measurements: a fit finds no thrust in them
        rate = _FASTEST_TABLE if log.tables.motors is None else min(rate_of(log.tables.motors), _FASTEST_TABLE)
    record = Experiment.from_flight(log, trajectory, rate, within=(first, last))
    return write_table(record, folder / f"{log.path.stem}.{table_format}")


def _autopilot(logs: list[Path], folder: Path) -> None:
    """Write what the flights of a craft tell its autopilot, and show it beside what flew."""
    from sysid.autopilot import autopilot_values
    from sysid.loops.controller import LoopError

    prepare(folder)
    try:
        proposal = autopilot_values([open_log(log) for log in logs])
    except LoopError as error:
        typer.echo(f"nothing is proposed: {error}")
        raise typer.Exit(NOT_POSSIBLE) from error
    files = proposal.write(folder)
    console().print(proposal.table().terminal("Parameters for the autopilot"))
    for remark in proposal.remarks:
        typer.echo(remark)
    for file in files:
        typer.echo(file)
    if not files:
        right = any(value.right for value in proposal.values)
        typer.echo("Nothing is to be changed." if right else "nothing is proposed")
        raise typer.Exit(OK if right else NOT_POSSIBLE)
    typer.echo("Load one file at a time, fly, and run this again: what proves right is then shown as right.")
