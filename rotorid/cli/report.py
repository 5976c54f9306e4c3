"""``rotorid report``: the report of a folder that ``rotorid analyze`` made, again."""

from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.output import console, show_page


def report(
    out: Annotated[Path, typer.Argument(exists=True, file_okay=False, help="Folder given to analyze as --out.")],
    open_page: Annotated[bool, typer.Option("--open", help="Show the page in the browser.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Write report.json to stdout instead of the table.")] = False,
) -> None:
    """Show the summary of a report made before, and its page.

    Example: rotorid report out/flight --open
    """
    from pipeline.errors import ConfigError
    from reports.numbers.reading import read_report
    from reports.terminal import summary as terminal

    page = out / "report.html"
    if as_json:  # as it is, by whatever version
        typer.echo((out / "report.json").read_text("utf-8"), nl=False)
    else:
        stdout = console()
        stdout.print(terminal.overview(read_report(out), stdout.width))
        stdout.print(f"\nReport: {page}", markup=False, soft_wrap=True)
    if open_page:
        if not page.is_file():
            raise ConfigError(f"{out} holds no report.html; analyze the logs again")
        show_page(page)
