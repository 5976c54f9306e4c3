"""``rotorid craft``: physical parameters of a craft by every method, and files for simulators."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.output import console, prepare

if TYPE_CHECKING:
    import pandas as pd

    from core.table import Table

#: Samples per second: rotation needs more than the transfer functions' ten.
RATE = 50.0


def craft(
    logs: Annotated[
        list[Path], typer.Argument(exists=True, dir_okay=False, help="Flights of one craft, logged by its autopilot.")
    ],
    mass: Annotated[float | None, typer.Option(min=0.0, help="Take-off mass, kg; motion does not tell it.")] = None,
    arm: Annotated[
        float | None, typer.Option(min=0.0, help="Distance of the motors from the centre, m; for inertia in kg m^2.")
    ] = None,
    disc_area: Annotated[
        float | None, typer.Option(min=0.0, help="Area of all rotor discs, m^2, for the simulator's drag.")
    ] = None,
    bench: Annotated[
        list[Path] | None,
        typer.Option(
            exists=True, dir_okay=False, help="Thrust-stand table, as rotorid bench reads it: a prior (needs --mass)."
        ),
    ] = None,
    out: Annotated[
        Path,
        typer.Option(help="Folder for craft.html, parameters.csv, craft.json and .mat, and sitl_frame.json."),
    ] = Path("craft"),
    as_json: Annotated[bool, typer.Option("--json", help="Write the table as JSON to stdout.")] = False,
) -> None:
    """Identify thrust, inertia, torque and drag by every method side by side, and write the craft for simulators.

    Example: rotorid craft flight1.bin flight2.bin --mass 4.3 --arm 0.32 --out craft
    """
    for name, value in (("--mass", mass), ("--arm", arm), ("--disc-area", disc_area)):
        if value is not None and not 0.0 < value < float("inf"):
            raise typer.BadParameter(f"{value:g} is of no craft: it must be above 0", param_hint=name)
    import logparse
    import sysid
    from estimation import estimate
    from pipeline.errors import ConfigError
    from pipeline.execution.progress import shown
    from pipeline.names import file_name
    from reports.pages.parameters import parameters_page

    if bench and mass is None:
        raise ConfigError("a thrust stand gives newtons and flight gives thrust over mass: give --mass with --bench")
    prepare(out)
    records = []
    with shown() as progress:
        for number, path in enumerate(logs):
            progress(f"reading {file_name(str(path))}", number / (len(logs) + 1))
            log = logparse.read_log(path)
            records.append(sysid.Experiment.from_flight(log, estimate(log.tables, date=log.start_utc), rate=RATE))
        progress("fitting", len(logs) / (len(logs) + 1))
        priors = None
        if bench and mass is not None:
            priors = sysid.analyse_bench(sysid.read_bench(bench)).priors(mass, records[0].vehicle)
        body = sysid.fit_rigid_body(records, mass=mass, priors=priors)
        found = sysid.physical_parameters(records, mass, arm=arm, rigid_body=body)
    files, findings = sysid.write_craft(body, out, mass, arm=arm, disc_area=disc_area)
    found.table.to_csv(out / "parameters.csv")
    page = parameters_page(found, records[0].vehicle, [path.name for path in logs], mass, findings)
    (out / "craft.html").write_text(page, encoding="utf-8")
    if as_json:
        typer.echo(found.table.reset_index().to_json(orient="records", indent=1))
        return
    table, notes = _overview(found.table)
    console().print(table.terminal("Physical parameters, every method on the same flights"))
    for number, note in enumerate(notes, start=1):
        typer.echo(f"({number}) {note}")
    for finding in findings:
        typer.echo(finding.reason)
    for file in (out / "craft.html", out / "parameters.csv", *files):
        typer.echo(file)


def _overview(found: pd.DataFrame) -> tuple[Table, list[str]]:
    """Tabulate every parameter by every method; reasons become numbers, explained below the table."""
    from core.quantity import uncertain
    from core.table import Row, Table

    rows: list[Row] = []
    notes: list[str] = []
    for parameter, methods in found.reset_index().groupby("parameter", sort=False):
        rows.append(Row(str(parameter), kind="part"))
        for row in methods.to_dict("records"):
            known = math.isfinite(row["si_value"])
            si_unit = str(row["si_unit"]).partition(" at ")[0].partition(" (")[0]
            si = f"{uncertain(row['si_value'], row['si_sigma'])} {si_unit}" if known else ""
            unit = str(row["unit"]).partition(",")[0].partition(" (")[0]
            note = str(row["note"])
            if note and note not in notes:
                notes.append(note)
            number = f"({notes.index(note) + 1})" if note else ""
            rows.append(Row(f"  {row['method']}", [uncertain(row["value"], row["sigma"]), unit, si, number]))
    return Table(label="parameter, by method", heads=["value", "unit", "in SI", "note"], rows=rows), notes
