"""``rotorid frequency``: frequency responses, rate dynamics and attitude bandwidth of a craft."""

from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.exits import SOME_FAILED
from rotorid.cli.options import existing_log, open_power_ups
from rotorid.cli.output import prepare


def frequency(
    logs: Annotated[
        list[Path],
        typer.Argument(callback=existing_log, help="Flights of one craft at one tuning, summed; LOG#2: LOG's second."),
    ],
    axis: Annotated[
        list[str] | None, typer.Option(help="roll, pitch, yaw or vertical; may be repeated. Default: all.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for frequency.html, .json, .mat and frequency_AXIS.csv.")] = Path(
        "frequency"
    ),
    as_json: Annotated[bool, typer.Option("--json", help="Write frequency.json to stdout, no table.")] = False,
) -> None:
    """Estimate frequency responses from chirps or ordinary flights, and fit the dynamics of every axis to them.

    Example: rotorid frequency chirps.bin sticks.bin --axis roll --out frequency
    """
    from pipeline.errors import ConfigError
    from pipeline.execution.progress import shown
    from reports.pages.frequency import frequency_page, sentences, terminal_table
    from rotorid.cli.output import console
    from sysid.frequency.axes import AXES
    from sysid.frequency.export import survey_json, write
    from sysid.frequency.survey import survey

    wanted = tuple(dict.fromkeys(axis)) if axis else tuple(AXES)
    unknown = [name for name in wanted if name not in AXES]
    if unknown:
        raise ConfigError(f"there is no axis {', '.join(unknown)}; the axes are {', '.join(AXES)}")
    prepare(out)
    with shown() as progress:
        progress("reading", 0.0)
        flights = [log for path in logs for log in open_power_ups(path)]
        progress("estimating", 0.3)
        found = survey(flights, wanted)
    (out / "frequency.html").write_text(frequency_page(found), encoding="utf-8")
    write(found, out)
    if as_json:
        typer.echo(survey_json(found), nl=False)
    else:
        console().print(terminal_table(found))
        for each in found.axes:
            for sentence in sentences(each):
                typer.echo(sentence)
        for finding in found.findings:
            typer.echo(f"{finding.severity}: {finding.reason} {finding.advice}")
        typer.echo(out / "frequency.html")
    if not found.determined:
        raise typer.Exit(SOME_FAILED)
