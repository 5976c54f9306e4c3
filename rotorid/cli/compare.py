"""``rotorid compare``: two reports against each other."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.errors import ConfigError
from rotorid.cli.output import prepare

if TYPE_CHECKING:
    from reports.rows import Numbers


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
    from reports.comparison import compare_reports
    from reports.comparison_page import comparison_markdown, comparison_overview, comparison_page
    from rotorid.cli.output import console

    older, newer = _report(before), _report(after)
    if out is not None:
        prepare(out)
    numbers = compare_reports(older, newer, (_name(before), _name(after)))
    text = json.dumps(numbers, indent=1, ensure_ascii=False, allow_nan=False) + "\n"
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


def _report(path: Path) -> "Numbers":
    """Read what `rotorid analyze` wrote."""
    file = path / "report.json" if path.is_dir() else path
    try:
        report: Numbers = json.loads(file.read_text("utf-8"))
        kind = report["kind"]
    except FileNotFoundError as error:
        raise ConfigError(f"{path} holds no report.json; give a folder that `rotorid analyze` wrote") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{file} is not a report of rotorid; give the report.json of `rotorid analyze`") from error
    if kind not in ("flight", "fleet"):
        raise ConfigError(f"{file} is not the report of a flight or a folder of flights, but of kind {kind!r}")
    return report


def _name(path: Path) -> str:
    """Call a report as its user does: by its folder."""
    return (
        (path if path.is_dir() else path.parent).resolve().name if path.name in ("", ".", "report.json") else path.name
    )
