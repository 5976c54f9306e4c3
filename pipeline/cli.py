"""The command line: ``rotorid analyze | inspect | export | simulate | serve``.

Heavy rooms are imported inside the commands, so that help and usage errors come at once.
"""

import json
import logging
import math
import os
import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NoReturn

import typer

from pipeline.config import AnalysisConfig

if TYPE_CHECKING:
    from rich.console import Console

    from reports.numbers import Numbers

#: All went well; some logs failed or none gave a model; the command was used in a wrong way.
OK, SOME_FAILED, WRONG_USAGE = 0, 1, 2

app = typer.Typer(
    name="rotorid",
    help="From Pixhawk/ArduPilot flight logs to models of the craft, with a report that says what they are worth.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

_DEFAULT = AnalysisConfig()


class TableFormat(StrEnum):
    """Formats that tables are exported to."""

    PARQUET = "parquet"
    CSV = "csv"
    MAT = "mat"


def main() -> NoReturn:
    """Run the command line; whatever happens, the user reads a sentence and not a traceback."""
    # Our matrices are small: more BLAS threads than one only get in each other's way.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    debug = bool(os.environ.get("ROTORID_DEBUG"))
    logging.basicConfig(level=logging.DEBUG if debug else logging.CRITICAL, stream=sys.stderr)
    try:
        app()
    except BrokenPipeError:
        # Whoever read our output has seen enough; nothing may be written at exit either.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(SOME_FAILED)
    except OSError as error:
        _fail(f"{error.filename or 'output'}: {error.strerror or error}", SOME_FAILED)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except Exception as error:
        from logparse import RotoridError
        from pipeline.errors import ConfigError

        if isinstance(error, RotoridError):
            _fail(str(error), WRONG_USAGE if isinstance(error, ConfigError) else SOME_FAILED)
        if debug:
            raise
        _fail(
            f"unexpected {type(error).__name__}: {error}. This is a bug in rotorid; please report it "
            "(ROTORID_DEBUG=1 shows where it happened).",
            SOME_FAILED,
        )
    sys.exit(OK)


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        typer.echo(f"rotorid {version('rotorid')}")
        raise typer.Exit


@app.callback()
def rotorid(
    _: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")
    ] = False,
) -> None:
    """From Pixhawk/ArduPilot flight logs to models of the craft, with a report that says what they are worth."""


@app.command()
def analyze(
    paths: Annotated[
        list[Path],
        typer.Argument(exists=True, help="Logs (.bin, .log, .tlog, .ulg, told by content) and folders of logs."),
    ],
    out: Annotated[Path, typer.Option(help="Folder for report.html, report.json, models.json and rmse.csv.")],
    rate: Annotated[
        float,
        typer.Option(help="Samples per second of the fit. Autopilots log motor outputs at 10 Hz; more adds nothing."),
    ] = _DEFAULT.rate,
    poles: Annotated[
        int, typer.Option(help="Poles of each transfer function. More follow a flight closer and others worse.")
    ] = _DEFAULT.poles,
    zeros: Annotated[int, typer.Option(help="Zeros of each transfer function, fewer than poles.")] = _DEFAULT.zeros,
    mass: Annotated[
        float | None,
        typer.Option(help="Take-off mass in kg. A flight shows only k/m; with the mass, thrust comes in newtons."),
    ] = None,
    training: Annotated[
        list[str] | None,
        typer.Option(
            help="Name (or pattern such as 'paper0[1-3]') of a flight to fit on; all others judge. "
            "May be given several times. Default: every second flight."
        ),
    ] = None,
    training_fraction: Annotated[
        float, typer.Option(help="Of a single flight, the part to fit on; the rest judges.")
    ] = _DEFAULT.training_fraction,
    time_limit: Annotated[
        float, typer.Option(help="Seconds after which a fit of one log is given up.")
    ] = _DEFAULT.time_limit,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Logs analysed at the same time. Default: one for each processor.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write report.json to stdout instead of the table.")] = False,
) -> None:
    """Read logs, reconstruct the flights, fit models and judge them on flight time that they have not seen.

    One log is fitted on the first part of its flight and judged on the rest. Of several logs each is analysed for
    itself; flights of the same craft are then fitted jointly and judged on the other flights.

    Exit status: 0 all fine, 1 some logs failed (each is named with its reason) or no log gave a model, 2 wrong usage.
    """
    config = AnalysisConfig(
        rate=rate,
        poles=poles,
        zeros=zeros,
        mass=mass,
        training=tuple(training or ()),
        training_fraction=training_fraction,
        time_limit=time_limit,
    )
    from concurrent.futures import Executor

    import pipeline
    import reports
    from pipeline import workers
    from pipeline.errors import ConfigError
    from pipeline.fleet import check_training, find_logs, flight_names
    from pipeline.progress import shown
    from pipeline.stages import STAGES, overall
    from reports import terminal
    from reports.numbers import numbers_of

    single = len(paths) == 1 and paths[0].is_file() and not config.training
    logs = [file for file, _ in find_logs(paths)]
    if not logs:
        raise ConfigError(f"no files in {', '.join(map(str, paths))}")
    check_training(flight_names(logs).values(), config)
    _prepare(out)
    result: pipeline.FlightResult | pipeline.FleetResult
    with shown() as progress:
        if single:
            advance = overall(progress)
            result = pipeline.analyze(paths[0], config, advance)
            advance("report", 0.0)
        else:
            executor: Executor | None
            with workers.pool(min(jobs or os.cpu_count() or 1, len(logs))) as executor:
                result = pipeline.analyze_fleet(paths, config, executor, progress)
            progress(STAGES["report"].title, 0.99)
        report: Path | None
        try:
            report = reports.write(result, out)
        except OSError as error:  # the disk is full, for one: what was found must not go with it
            report, unwritten = None, error
    numbers = numbers_of(result)
    failed = _print_analysis(numbers, report, as_json)
    if report is None:
        _fail(f"the report could not be written: {unwritten.filename or out}: {unwritten.strerror}", SOME_FAILED)
    modelless = terminal.no_model(numbers)
    if modelless:
        _fail(modelless, SOME_FAILED)
    raise typer.Exit(SOME_FAILED if failed else OK)


def _prepare(folder: Path) -> None:
    """Make the folder for the results and try to write there: before the work, not after it."""
    from tempfile import TemporaryFile

    from pipeline.errors import ConfigError

    try:
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            pass
    except FileExistsError as error:
        raise ConfigError(f"--out {folder} is a file; choose a folder") from error
    except OSError as error:
        raise ConfigError(f"--out {folder}: nothing can be written there: {error.strerror or error}") from error


def _print_analysis(numbers: "Numbers", report: Path | None, as_json: bool) -> bool:
    """Print what was found; the reasons of failed logs go to stderr. Tell whether any failed."""
    from rich.console import Console

    from pipeline.names import printable
    from reports import terminal

    if as_json:
        sys.stdout.write(json.dumps(numbers, indent=1, allow_nan=False, ensure_ascii=False) + "\n")
    else:
        console = _console()
        console.print(terminal.overview(numbers, console.width))
        if report is not None:
            console.print(f"\nReport: {printable(str(report))}", markup=False, soft_wrap=True)
    failures = list(terminal.failures(numbers))
    if failures:
        errors = Console(stderr=True, highlight=False, soft_wrap=True)
        errors.print(f"\n{len(failures)} log{'s' if len(failures) > 1 else ''} gave nothing:", style="red")
        for line in failures:
            errors.print(f"  {line}", markup=False, soft_wrap=True)
    return bool(failures)


#: Which power-up of a log with several; shared by the commands that look into one log.
_Boot = Annotated[
    int | None,
    typer.Option(
        min=1, help="Which power-up of a file with several, from 1. Default: the one with the longest flight."
    ),
]


def _power_up(boot: int | None) -> int | None:
    """Index of a power-up that the user counts from 1."""
    return None if boot is None else boot - 1


@app.command()
def inspect(
    log: Annotated[Path, typer.Argument(exists=True, dir_okay=False, help="A log of any format.")],
    boot: _Boot = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write everything as JSON to stdout.")] = False,
) -> None:
    """Show what is in a log: craft, flights, tables with their rates and gaps, and what to log better next time."""
    import logparse
    from logparse.inspection import inspect as look_into

    numbers = look_into(logparse.read_log(log, _power_up(boot))).to_dict()
    if as_json:
        typer.echo(json.dumps(numbers, indent=1, ensure_ascii=False, allow_nan=False))
        return
    from reports import inspection

    _console().print(inspection.overview(numbers))


@app.command()
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
    boot: _Boot = None,
    start: Annotated[float | None, typer.Option(help="Leave out what was before, s on the log's clock.")] = None,
    end: Annotated[float | None, typer.Option(help="Leave out what was after, s on the log's clock.")] = None,
) -> None:
    """Write messages as logged and canonical tables (SI units) as files for other programs."""
    import logparse
    from logparse.export import export as write_tables

    names = [name for part in messages or () for name in part.split(",") if name]
    for option, value in (("--start", start), ("--end", end)):
        if value is not None and not math.isfinite(value):
            raise typer.BadParameter(f"{option} {value:g} is no time")
    if start is not None and end is not None and end < start:
        raise typer.BadParameter(f"--end {end:g} is before --start {start:g}")
    folder = out or Path(f"{log.stem}-tables")
    flight_log = logparse.read_log(log, _power_up(boot))
    first, last = flight_log.boot.t_start, flight_log.boot.t_end
    if (start is not None and start > last) or (end is not None and end < first):
        raise typer.BadParameter(f"the log covers {first:.1f} to {last:.1f} s; --start or --end lies outside it")
    _prepare(folder)
    files = write_tables(flight_log, folder, format=table_format.value, messages=names or None, start=start, stop=end)
    for file in files:
        typer.echo(file)


@app.command()
def simulate(
    case: Annotated[
        str, typer.Argument(help="Case to fly, such as octa01_zurich_calm; sample-logs flies all; list names them.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the logs and their truth.")] = Path(),
) -> None:
    """Fly a simulated octocopter and write its log with the truth beside it."""
    import simulation
    from pipeline.errors import ConfigError
    from pipeline.progress import shown

    if case == "list":
        for each in simulation.CASES.values():
            typer.echo(f"{each.name:24}{each.summary}")
        return
    with shown() as progress:
        if case == "sample-logs":
            files = simulation.write_sample_logs(out, progress)
        else:
            found = simulation.CASES.get(case)
            if found is None:
                raise ConfigError(f"no case called {case!r}; there are: {', '.join(simulation.CASES)}, and sample-logs")
            progress(case, 0.0)
            files = simulation.write_case(found, out)
    for file in files:
        typer.echo(file)


@app.command()
def serve(
    host: Annotated[
        str, typer.Option(help="Address to listen on; 0.0.0.0 lets others on the network in.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8000,
) -> None:
    """Start the web service: a page to drop logs on, and the HTTP interface behind it."""
    import api

    api.serve(host, port)


def _console() -> "Console":
    """Give stdout as Rich writes to it; where it is no terminal, wide enough that tables need no folding."""
    from rich.console import Console

    return Console(highlight=False, width=None if sys.stdout.isatty() else 120)


def _fail(message: str, status: int) -> NoReturn:
    sys.stderr.write(f"rotorid: {message}\n")
    sys.exit(status)
