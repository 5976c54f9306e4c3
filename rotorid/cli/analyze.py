"""``rotorid analyze``: logs to models and a report."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NoReturn

import typer

from pipeline.config import AnalysisConfig
from rotorid.cli.options import flight_of, folder_of, parted, setting
from rotorid.cli.output import INTERRUPTED, NOT_POSSIBLE, OK, SOME_FAILED, console, fail, prepare

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from logparse import FlightLog
    from pipeline.results.fleet import FlightEntry, LogFailure
    from pipeline.results.flight import FlightResult
    from pipeline.results.report import FleetReport, FlightReport
    from pipeline.storage.sources import FoundFiles, Source
    from reports.files.plot_images import ImageFormat

_DEFAULT = AnalysisConfig()
#: Part of the whole that is done, as a bar shows it, when a file turns out to hold several flights.
_SEVERAL_FOUND = 0.2


def analyze(
    paths: Annotated[
        list[str],
        typer.Argument(
            help="Logs (.bin, .log, .tlog, .ulg, told by content), folders of logs, and URLs of either (s3://...). "
            "LOG#2 alone: the second flight of LOG."
        ),
    ],
    out: Annotated[
        str | None,
        typer.Option(
            help="Folder or URL for report.html, report.json and all else that is made. Of several logs it also keeps "
            "what is done: the same command again does only what is new or changed, or was interrupted. Default: "
            "out/NAME, of the first log or folder named."
        ),
    ] = None,
    rate: Annotated[float, setting("rate")] = _DEFAULT.rate,
    poles: Annotated[int, setting("poles")] = _DEFAULT.poles,
    zeros: Annotated[int, setting("zeros")] = _DEFAULT.zeros,
    mass: Annotated[float | None, setting("mass")] = _DEFAULT.mass,
    training: Annotated[list[str] | None, setting("training")] = None,
    validation: Annotated[list[str] | None, setting("validation")] = None,
    training_fraction: Annotated[float, setting("training_fraction")] = _DEFAULT.training_fraction,
    scan_orders: Annotated[bool, setting("scan_orders", "--scan-orders")] = _DEFAULT.scan_orders,
    time_limit: Annotated[float, setting("time_limit")] = _DEFAULT.time_limit,
    jobs: Annotated[
        int | None,
        typer.Option(
            min=1, help="Logs analysed at the same time. Default: one for each processor, as far as memory goes."
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            help="Address of a Dask scheduler, such as tcp://cluster:8786, whose workers analyse; logs and --out "
            "must be on disks that they share, or URLs (needs rotorid[cluster])."
        ),
    ] = None,
    plots: Annotated[
        Literal["png", "svg"] | None,
        typer.Option(help="Also write the plots of each flight as files, below plots/ beside its report."),
    ] = None,
    columns: Annotated[
        Path | None,
        typer.Option(
            help="YAML that says which column is what (docs/tables.md): the paths are then tables of one craft (CSV, "
            "Parquet, .mat) instead of logs."
        ),
    ] = None,
    redo: Annotated[
        bool, typer.Option("--redo", help="Analyse all logs anew, also those whose results are in --out already.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write report.json to stdout instead of the table.")] = False,
) -> None:
    """Read logs, reconstruct the flights, fit models and judge them on flight time that they have not seen.

    One log is fitted on the first part of its flight and judged on the rest. Of several logs each is analysed for
    itself; flights of the same craft are then fitted jointly and judged on the other flights.

    Example: rotorid analyze flights --out report --training 'march*'

    Exit status: 0 read and answered, 1 some logs failed (each is named with its reason), 2 wrong usage, 3 none gave a
    thrust or a model.
    """
    config = AnalysisConfig(
        rate=rate,
        poles=poles,
        zeros=zeros,
        mass=mass,
        training=tuple(training or ()),
        validation=tuple(validation or ()),
        training_fraction=training_fraction,
        scan_orders=scan_orders,
        time_limit=time_limit,
    )
    from pipeline.names import is_url
    from pipeline.storage.sources import find

    if "" in paths:  # as a path it would be the working folder
        raise typer.BadParameter("a path is empty")
    out = out or str(folder_of(paths[0]))
    flight: int | None = None
    if len(paths) == 1 and not is_url(paths[0]):
        file, flight = parted(Path(paths[0]))
        paths = [str(file)]
    if columns is not None:
        _tables(paths, columns, out, config, as_json)
        return
    _refuse_tables(paths)
    files = find(_existing(paths), exclude=None if is_url(out) else Path(out))
    _require_files(files, paths)
    chosen = config.training or config.validation
    if chosen:
        from pipeline.fleet.analysis import check_choices

        check_choices(files, config)
    prepare(out)
    single = len(files.sources) == 1 and files.sources[0].named and scheduler is None
    begun = 0.0
    if single and not chosen:
        _one_flight(files.sources[0], Path(out), config, as_json, plots, flight)
        begun = _SEVERAL_FOUND
    sizes = [source.size for source in files.sources if source.named or source.called_a_log]
    workers: AbstractContextManager[Executor | None] = nullcontext()
    if scheduler is not None:
        workers = _cluster(scheduler, jobs, paths, out)
    elif not single:
        from pipeline.execution.executors import processes
        from reports import PRELOAD

        workers = processes(jobs, sizes, PRELOAD)
    try:
        _several_logs(files, out, config, workers, redo, as_json, plots, begun)
    except KeyboardInterrupt:
        fail("interrupted; what is done is kept, and the same command goes on from there", INTERRUPTED)


def _tables(paths: Sequence[str], columns: Path, out: str, config: AnalysisConfig, as_json: bool) -> None:
    """Analyse tables of other origin and write their report."""
    from core.serialization import as_json as to_text
    from logparse.foreign.files import is_table
    from pipeline.config import ConfigError
    from pipeline.flight.table_analysis import analyze_tables
    from reports.pages.tables import tables_page
    from reports.terminal.summary import answer_rows

    files: list[Path] = []
    for path in map(Path, _existing(paths)):
        files += sorted(file for file in path.iterdir() if is_table(file)) if path.is_dir() else [path]
    if not files:
        raise ConfigError(f"no tables (CSV, Parquet, .mat) in {', '.join(paths)}")
    prepare(out)
    result = analyze_tables(files, columns, config)
    text = to_text(result.report)
    (Path(out) / "report.json").write_text(text, encoding="utf-8")
    (Path(out) / "report.html").write_text(tables_page(result), encoding="utf-8")
    if as_json:
        sys.stdout.write(text)
        return
    for row in answer_rows(result.report.answer.lines):
        console().print(row)
    for finding in result.report.findings:
        console().print(f"{finding.severity}: {finding.reason}", markup=False, soft_wrap=True)
    console().print(f"\nReport: {Path(out) / 'report.html'}", markup=False, soft_wrap=True)


def _refuse_tables(paths: Sequence[str]) -> None:
    """Raise a sentence on how to describe it, where a table was named."""
    from pipeline.storage.sources import LOG_SUFFIXES

    # What is called a log needs no look, for which the numerical packages would have to be there.
    files = [path for path in map(Path, paths) if path.is_file() and path.suffix.lower() not in LOG_SUFFIXES]
    if not files:
        return
    from logparse import LogError
    from logparse.foreign.files import is_table
    from logparse.log import check_is_log
    from pipeline.config import ConfigError

    for path in filter(is_table, files):
        try:
            check_is_log(path)
        except LogError as error:
            hint = "Is it a table of motion? Say which column is what with --columns (docs/tables.md)"
            raise ConfigError(f"{error}. {hint}") from None


def _existing(paths: Sequence[str]) -> Sequence[str]:
    from pipeline.names import is_url

    missing = [path for path in paths if not is_url(path) and not Path(path).exists()]
    if missing:
        from pipeline.config import ConfigError

        raise ConfigError(f"{', '.join(missing)}: no such file or folder")
    return paths


def _require_files(files: "FoundFiles", paths: Sequence[str]) -> None:
    if not files.sources and not files.failures:
        from pipeline.config import ConfigError

        closed = (f"{failure.source}: {failure.reason}" for failure in files.passed_over)
        raise ConfigError(f"no files in {', '.join(paths)} ({'; '.join(closed)})")


def _one_flight(
    source: "Source",
    out: Path,
    config: AnalysisConfig,
    as_json: bool,
    plots: "ImageFormat | None" = None,
    flight: int | None = None,
) -> None:
    """Analyse a log of one flight, or one of its flights, write the report and end; come back where there are more."""
    from pipeline.execution.progress import shown
    from pipeline.execution.stages import Overall
    from pipeline.storage.sources import fetched

    with shown() as progress, fetched(source.url) as file:
        # The numerical packages take seconds to import: the terminal shows first that something happens.
        progress("loading the numerical packages", 0.0)
        import pipeline
        import reports
        from logparse import RotoridError, read_flights
        from pipeline.execution.compiling import compile_missing
        from pipeline.flight.summary import flight_entry
        from pipeline.storage.manifest import write_entry
        from reports.files.folder import write_account

        # Loading the packages takes as long as a sixth of an ordinary analysis.
        advance = Overall(progress, loaded=0.7)
        advance("read", 0.0)
        logs = read_flights(file) if flight is None else (flight_of(file, flight),)
        if len(logs) > 1:
            if not as_json:
                _announce_all(logs)
            return
        announced: list[FlightResult] = []

        def announce(begun: "FlightResult") -> None:
            if not as_json:
                announced.append(begun)
                _announce(begun, out)
            compile_missing(progress)  # half a minute on a new computer: what happened is told before it

        try:
            (result,) = pipeline.analyze_flights(logs, config, advance, alone=True, announce=announce)
        except RotoridError as error:
            for begun in announced:  # its page must not say that models follow
                write_account(begun, out, str(error))
            raise
        advance("report", 0.0)
        try:
            report = reports.write(result, out, plots)
            entry = flight_entry(result, folder=".", source=str(source.url), key=result.log.sha256)
            write_entry(entry, out)
        except OSError as error:  # the disk is full, for one: what was found must not go with it
            from pipeline.flight.summary import flight_report

            _show(flight_report(result), "", as_json)
            fail(f"the report could not be written: {error.filename or out}: {error.strerror}", SOME_FAILED)
    from reports.report_json import read_report

    # What was written need not be gathered again.
    numbers = read_report(out)
    _show(numbers, str(report), as_json)
    _end(numbers, ())


def _announce(result: "FlightResult", out: Path) -> None:
    """Print what happened, and write a page with it, before anything is identified."""
    from pipeline.results.failure import present
    from reports.files.folder import write_account

    answer = present(result.answer)
    if answer is not None:
        console().print(answer.lines[0].text, markup=False, soft_wrap=True)
    console().print(f"{write_account(result, out)}; models follow.", style="dim", markup=False, soft_wrap=True)


def _announce_flight(out: str, entry: "FlightEntry") -> None:
    """Print what happened in a flight of several, and where its page is."""
    happened = "" if entry.account is None else entry.account.headline
    page = f"{out.rstrip('/')}/flights/{entry.folder}/report.html"
    console().print(f"{entry.name}: {happened}\n  {page}", markup=False, soft_wrap=True)


def _announce_all(logs: "Sequence[FlightLog]") -> None:
    """Print what happened in each flight of a log."""
    from pipeline.flight.account import account_of_log

    for number, log in enumerate(logs, start=1):
        console().print(f"Flight {number}: {account_of_log(log).headline}", markup=False, soft_wrap=True)


@contextmanager
def _cluster(scheduler: str, jobs: int | None, paths: Sequence[str], out: str) -> "Iterator[Executor]":
    """Return the workers of a cluster, when they have shown that they can do this work."""
    from pipeline.config import ConfigError
    from pipeline.execution.cluster import Cluster, SchedulerError

    if jobs is not None:
        raise ConfigError("--jobs counts processes of this computer; with --scheduler all workers of the cluster work")
    with ExitStack() as stack:
        try:
            executor = stack.enter_context(Cluster(scheduler))
            executor.check(paths, out)
        except SchedulerError as error:  # before the work it is wrong usage, later it is not
            raise ConfigError(str(error)) from error
        yield executor


def _several_logs(
    files: "FoundFiles",
    out: str,
    config: AnalysisConfig,
    workers: "AbstractContextManager[Executor | None]",
    redo: bool,
    as_json: bool,
    plots: "ImageFormat | None",
    begun: float,
) -> None:
    """Analyse what is new among logs and write the report on all, unless it stands already.

    The bar goes on from the part `begun` of the whole.
    """
    import pipeline
    import reports
    from pipeline.execution.progress import part_of, shown

    publish = reports.publish if plots is None else partial(reports.publish, plots=plots)
    with shown() as progress, workers as executor:
        rest = part_of(progress, begun, 1.0)
        announce = None if as_json else partial(_announce_flight, out)
        fleet = pipeline.analyze_fleet(
            files, config, executor, rest, store=out, publish=publish, redo=redo, announce=announce
        )
        try:
            if not fleet.reported:
                progress("writing the report", 0.99)
                reports.write_fleet(fleet)
        except OSError as error:
            _list_failures(fleet.failures)
            kept = "what is done is kept; make room and run the same command again"
            fail(f"the report could not be written: {error.strerror or error}; {kept}", SOME_FAILED)
    from reports.report_json import parse_report

    numbers = parse_report(fleet.store.read("report.json"))
    _show(numbers, f"{out.rstrip('/')}/report.html", as_json)
    if not as_json and fleet.reused:
        console().print(f"{fleet.reused} of {len(files.sources)} files were unchanged and not read again.", style="dim")
    _end(numbers, fleet.failures)


def _show(numbers: "FlightReport | FleetReport", report: str, as_json: bool) -> None:
    """Print what was found."""
    from core.serialization import as_json as to_text
    from pipeline.names import printable
    from reports.terminal import summary as terminal

    if as_json:
        sys.stdout.write(to_text(numbers))
        return
    stdout = console()
    stdout.print(terminal.overview(numbers, stdout.width))
    if report:
        stdout.print(f"\nReport: {printable(report)}", markup=False, soft_wrap=True)


def _end(numbers: "FlightReport | FleetReport", failures: "Sequence[LogFailure]") -> NoReturn:
    """End with the status that the findings deserve."""
    from pipeline.results.report import FlightReport
    from reports.terminal import summary as terminal

    _list_failures(failures)
    modelless = terminal.no_model(numbers)
    if not (failures or isinstance(numbers, FlightReport) or numbers.flights):
        fail("there is no flight log among these files", NOT_POSSIBLE)
    if modelless:
        fail(modelless, SOME_FAILED if failures else NOT_POSSIBLE)
    raise typer.Exit(SOME_FAILED if failures else OK)


def _list_failures(failures: "Sequence[LogFailure]") -> None:
    """Name each log that gave nothing on stderr, with its reason."""
    if not failures:
        return
    from rich.console import Console

    from pipeline.names import printable

    errors = Console(stderr=True, highlight=False, soft_wrap=True)
    errors.print(f"\n{len(failures)} log{'s' if len(failures) > 1 else ''} gave nothing:", style="red")
    for failure in failures:
        line = failure.reason if failure.reason.startswith(failure.file) else f"{failure.file}: {failure.reason}"
        errors.print(f"  {printable(line)}", markup=False, soft_wrap=True)
