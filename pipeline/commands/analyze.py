"""``rotorid analyze``: logs to models and a report."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.commands.exits import OK, SOME_FAILED, fail
from pipeline.commands.output import console, prepare
from pipeline.config import AnalysisConfig

if TYPE_CHECKING:
    from reports.rows import Numbers

_DEFAULT = AnalysisConfig()


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
    scan_orders: Annotated[
        bool,
        typer.Option(
            "--scan-orders",
            help="Also try other numbers of poles and zeros, and recommend one. Takes as long as ten more fits.",
        ),
    ] = _DEFAULT.scan_orders,
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

    Example: rotorid analyze flights --out report --training 'march*'

    Exit status: 0 all fine, 1 some logs failed (each is named with its reason) or no log gave a model, 2 wrong usage.
    """
    config = AnalysisConfig(
        rate=rate,
        poles=poles,
        zeros=zeros,
        mass=mass,
        training=tuple(training or ()),
        training_fraction=training_fraction,
        scan_orders=scan_orders,
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
    prepare(out)
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
            report = reports.write(result, out, share_script=True)
        except OSError as error:  # the disk is full, for one: what was found must not go with it
            report, unwritten = None, error
    # What was written need not be gathered again.
    numbers = numbers_of(result) if report is None else json.loads((out / "report.json").read_text("utf-8"))
    failed = _print_analysis(numbers, report, as_json)
    if report is None:
        fail(f"the report could not be written: {unwritten.filename or out}: {unwritten.strerror}", SOME_FAILED)
    modelless = terminal.no_model(numbers)
    if modelless:
        fail(modelless, SOME_FAILED)
    raise typer.Exit(SOME_FAILED if failed else OK)


def _print_analysis(numbers: "Numbers", report: Path | None, as_json: bool) -> bool:
    """Print what was found; the reasons of failed logs go to stderr. Tell whether any failed."""
    from rich.console import Console

    from pipeline.names import printable
    from reports import terminal

    if as_json:
        sys.stdout.write(json.dumps(numbers, indent=1, allow_nan=False, ensure_ascii=False) + "\n")
    else:
        stdout = console()
        stdout.print(terminal.overview(numbers, stdout.width))
        if report is not None:
            stdout.print(f"\nReport: {printable(str(report))}", markup=False, soft_wrap=True)
    failures = list(terminal.failures(numbers))
    if failures:
        errors = Console(stderr=True, highlight=False, soft_wrap=True)
        errors.print(f"\n{len(failures)} log{'s' if len(failures) > 1 else ''} gave nothing:", style="red")
        for line in failures:
            errors.print(f"  {line}", markup=False, soft_wrap=True)
    return bool(failures)
