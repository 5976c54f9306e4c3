"""``rotorid report``, ``compare`` and ``schema``: show, compare and describe existing reports."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from rotorid.cli.output import console, prepare, show_page


def report(
    out: Annotated[Path, typer.Argument(exists=True, file_okay=False, help="Folder given to analyze as --out.")],
    open_page: Annotated[bool, typer.Option("--open", help="Show the page in the browser.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write report.json to stdout instead of the table.")] = False,
) -> None:
    """Show the summary of a report made before, and its page.

    Example: rotorid report out/flight --open
    """
    from pipeline.config import ConfigError
    from reports.report_json import read_report
    from reports.terminal import summary as terminal

    page = out / "report.html"
    if as_json:  # unchanged, whatever version wrote it
        typer.echo((out / "report.json").read_text("utf-8"), nl=False)
    else:
        stdout = console()
        stdout.print(terminal.overview(read_report(out), stdout.width))
        stdout.print(f"\nReport: {page}", markup=False, soft_wrap=True)
    if open_page:
        if not page.is_file():
            raise ConfigError(f"{out} holds no report.html; analyze the logs again")
        show_page(page)


def compare(
    before: Annotated[
        Path,
        typer.Argument(exists=True, help="Before the change: a folder of `rotorid analyze`, or its report.json."),
    ],
    after: Annotated[Path, typer.Argument(exists=True, help="The same of after the change.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for comparison.html, comparison.md and comparison.json; none without.")
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Write comparison.json to stdout instead of the tables.")
    ] = False,
) -> None:
    """Compare two reports, such as before and after a change of propellers.

    Physical parameters are compared over the flights of a craft: a difference counts when it is larger than flights
    differ anyway. Errors of the models and settings that differ stand beside them.

    Example: rotorid analyze march --out before; rotorid analyze april --out after; rotorid compare before after
    """
    from core.serialization import as_json as to_text
    from pipeline.fleet.comparison import compare_reports
    from reports.pages.comparison import comparison_markdown, comparison_overview, comparison_page
    from reports.report_json import read_report

    older, newer = read_report(before), read_report(after)
    if out is not None:
        prepare(out)
    numbers = compare_reports(older, newer, (_name(before), _name(after)))
    text = to_text(numbers)
    if out is not None:
        (out / "comparison.html").write_text(comparison_page(numbers), encoding="utf-8")
        (out / "comparison.md").write_text(comparison_markdown(numbers), encoding="utf-8")
        (out / "comparison.json").write_text(text, encoding="utf-8")
    if as_json:
        typer.echo(text, nl=False)
        return
    console().print(comparison_overview(numbers))
    if out is not None:
        typer.echo(out / "comparison.html")


def _name(path: Path) -> str:
    """Name a report by its folder."""
    if path.name not in ("", ".", "report.json"):
        return path.name
    return (path if path.is_dir() else path.parent).resolve().name


def schema(
    subject: Annotated[
        Literal["report", "models", "findings"],
        typer.Argument(help="report.json, models.json, or the catalogue of findings."),
    ] = "report",
) -> None:
    """Write to stdout the JSON Schema (2020-12) of a file that `rotorid analyze` writes, or docs/findings.md.

    Example: rotorid schema models > models.schema.json
    """
    from core.catalogue import read_catalogue
    from core.serialization import as_json
    from reports.report_json import schema as schema_of

    typer.echo(read_catalogue().as_markdown() if subject == "findings" else as_json(schema_of(subject)), nl=False)
