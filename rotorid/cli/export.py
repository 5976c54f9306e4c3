"""``rotorid export``: messages and tables as files for other programs."""

import math
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.options import Boot, power_up
from rotorid.cli.output import prepare

if TYPE_CHECKING:
    from logparse import FlightLog


class TableFormat(StrEnum):
    """Formats that tables are exported to."""

    PARQUET = "parquet"
    CSV = "csv"
    MAT = "mat"


def export(
    log: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="A log of any format.")],
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the files; made when missing. Default: a new one named after the log."),
    ] = None,
    table_format: Annotated[
        TableFormat, typer.Option("--format", help="parquet and csv: a file for each table; mat: one file for MATLAB.")
    ] = TableFormat.PARQUET,
    messages: Annotated[
        list[str] | None,
        typer.Option(
            help="Message as logged (RCOU) or canonical table (motors). Several: separated by commas, or the option "
            "given again. Default: everything."
        ),
    ] = None,
    boot: Boot = None,
    start: Annotated[float | None, typer.Option(help="Leave out what was before, s on the log's clock.")] = None,
    end: Annotated[float | None, typer.Option(help="Leave out what was after, s on the log's clock.")] = None,
    table: Annotated[
        bool,
        typer.Option(
            "--table",
            help="Instead: estimated motion and motors of the longest flight on one clock, as parquet or csv, with the "
            "YAML that `analyze --columns` reads.",
        ),
    ] = False,
    rate: Annotated[float, typer.Option(min=1.0, max=1000.0, help="Samples per second of --table.")] = 50.0,
) -> None:
    """Write messages as logged and canonical tables (SI units) as files for other programs.

    Example: rotorid export flight.bin --format csv --messages RCOU,imu --start 60 --end 120
    """
    import logparse
    from logparse.export import export as write_tables

    names = [name for part in messages or () for name in part.split(",") if name]
    for option, value in (("--start", start), ("--end", end)):
        if value is not None and not math.isfinite(value):
            raise typer.BadParameter(f"{option} {value:g} is no time")
    if start is not None and end is not None and end < start:
        raise typer.BadParameter(f"--end {end:g} is before --start {start:g}")
    folder = out or Path(f"{log.stem}-tables")
    flight_log = logparse.read_log(log, power_up(boot))
    first, last = flight_log.boot.t_start, flight_log.boot.t_end
    if (start is not None and start > last) or (end is not None and end < first):
        raise typer.BadParameter(f"the log covers {first:.1f} to {last:.1f} s; --start or --end lies outside it")
    prepare(folder)
    if table:
        for file in _table(flight_log, folder, table_format, (start, end), rate, bool(names)):
            typer.echo(file)
        return
    files = write_tables(flight_log, folder, format=table_format.value, messages=names or None, start=start, stop=end)
    for file in files:
        typer.echo(file)


def _table(
    log: "FlightLog",
    folder: Path,
    table_format: TableFormat,
    within: tuple[float | None, float | None],
    rate: float,
    messages: bool,
) -> tuple[Path, Path]:
    """Write the record of the longest flight as `Experiment.from_table` reads it."""
    import estimation
    from sysid import Experiment
    from sysid.records.table_export import write_table

    if table_format is TableFormat.MAT or messages:
        raise typer.BadParameter("--table writes parquet or csv, and no messages")
    trajectory = estimation.estimate(log.tables, date=log.start_utc)
    first, last = (
        (log.boot.t_start if within[0] is None else within[0]),
        (log.boot.t_end if within[1] is None else within[1]),
    )
    record = Experiment.from_flight(log, trajectory, rate, within=(first, last))
    return write_table(record, folder / f"{log.path.stem}.{table_format.value}")
