"""``rotorid design``: the next flight, as files that an autopilot takes."""

from pathlib import Path
from typing import Annotated

import typer

from rotorid.cli.exits import OK, SOME_FAILED
from rotorid.cli.options import existing_log, open_log


def design(
    log: Annotated[Path, typer.Argument(callback=existing_log, help="A log of the craft; LOG#2: its second flight.")],
    purpose: Annotated[str, typer.Option("--for", help="rates, drag, inertia, thrust or position.")] = "rates",
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("design"),
    lean: Annotated[float, typer.Option(min=2.0, max=25.0, help="Largest lean, deg.")] = 20.0,
    height: Annotated[float, typer.Option(min=5.0, max=120.0, help="Height above ground, m.")] = 20.0,
) -> None:
    """Write what to fly next: SYSTEMID parameters, a mission or a Lua script, with the errors it will leave.

    Every file has its limits in it. For inertia the log needs chirps of mode SYSTEMID, however small;
    for rates a first chirp is chosen from the gains alone.

    Example: rotorid design FLIGHT.bin --for rates --out next
    """
    from rotorid.cli.output import prepare
    from sysid.loops.chirps import Limits
    from sysid.loops.design import design as plan

    result = plan(open_log(log), purpose, Limits(lean_deg=lean, height_m=height))
    if result.refused is not None:
        typer.echo(f"nothing is designed: {result.refused}")
        raise typer.Exit(SOME_FAILED)
    prepare(out)
    for name, text in result.files.items():
        (out / name).write_text(text, encoding="utf-8")
        typer.echo(out / name)
    for item in result.expected:
        typer.echo(f"predicted standard deviation of {item}")
    raise typer.Exit(OK)
