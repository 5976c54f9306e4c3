"""``rotorid craft``, ``bench`` and ``bifilar``: physical parameters from flights, thrust stands and pendulums."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.options import folder_of
from rotorid.cli.output import NOT_POSSIBLE, console, prepare
from rotorid.cli.values import not_negative

if TYPE_CHECKING:
    import pandas as pd

    from core.table import Table
    from sysid.bench.stand import BenchReport


#: Samples per second: rotation needs more than the ten of the transfer functions.
_RATE = 50.0


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
        Path | None,
        typer.Option(
            help="Folder for craft.html, parameters.csv, craft.json and .mat, and sitl_frame.json. Default: out/NAME."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write the table as JSON to stdout.")] = False,
) -> None:
    """Identify thrust, inertia, torque and drag by every method side by side, and write the craft for simulators.

    Example: rotorid craft flight1.bin flight2.bin --mass 4.3 --arm 0.32 --out craft
    """
    for name, value in (("--mass", mass), ("--arm", arm), ("--disc-area", disc_area)):
        if value is not None and not 0.0 < value < math.inf:
            raise typer.BadParameter(f"{value:g} is of no craft: it must be above 0", param_hint=name)
    import logparse
    import sysid
    from estimation import estimate
    from pipeline.config import ConfigError
    from pipeline.execution.progress import shown
    from pipeline.names import file_name
    from reports.pages.parameters import parameters_page

    if bench and mass is None:
        raise ConfigError("a thrust stand gives newtons and flight gives thrust over mass: give --mass with --bench")
    out = out or folder_of(logs[0])
    prepare(out)
    records = []
    with shown() as progress:
        for number, path in enumerate(logs):
            progress(f"reading {file_name(str(path))}", number / (len(logs) + 1))
            log = logparse.read_log(path)
            records.append(sysid.Experiment.from_flight(log, estimate(log.tables, date=log.start_utc), rate=_RATE))
        progress("fitting", len(logs) / (len(logs) + 1))
        priors = None
        if bench and mass is not None:
            priors = sysid.analyse_bench(sysid.read_bench(bench)).priors(mass, records[0].vehicle)
        body = sysid.fit_rigid_body(records, mass=mass, priors=priors)
        parameters = sysid.physical_parameters(records, mass, arm=arm, rigid_body=body)
    files, findings = sysid.write_craft(body, out, arm=arm, disc_area=disc_area)
    parameters.table.to_csv(out / "parameters.csv")
    page = parameters_page(parameters, records[0].vehicle, [path.name for path in logs], mass, findings)
    (out / "craft.html").write_text(page, encoding="utf-8")
    if as_json:
        typer.echo(parameters.table.reset_index().to_json(orient="records", indent=1))
        return
    table, notes = _overview(parameters.table)
    console().print(table.terminal("Physical parameters, every method on the same flights"))
    for number, note in enumerate(notes, start=1):
        typer.echo(f"({number}) {note}")
    for finding in findings:
        typer.echo(finding.reason)
    for file in (*files, out / "parameters.csv", out / "craft.html"):
        typer.echo(file)


def _overview(parameters: pd.DataFrame) -> tuple[Table, list[str]]:
    """Tabulate every parameter by every method; its notes are numbered and returned beside it."""
    from core.quantity import uncertain
    from core.table import Row, Table

    rows: list[Row] = []
    notes: list[str] = []
    for parameter, methods in parameters.reset_index().groupby("parameter", sort=False):
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


def bench(
    tables: Annotated[
        list[Path],
        typer.Argument(
            exists=True,
            dir_okay=False,
            help="CSV with units in its headers: PWM, voltage, thrust, torque, RPM, current. One with a motor column, "
            "or one for each motor in order.",
        ),
    ],
    weight: Annotated[
        float | None, typer.Option(callback=not_negative, help="Weight of the craft, N (mass times 9.81).")
    ] = None,
    voltage: Annotated[
        float | None, typer.Option(callback=not_negative, help="Battery voltage to answer for, V.")
    ] = None,
    motors: Annotated[
        int | None, typer.Option(min=1, help="Motors that share the weight. Default: those tested, or 4 for one table.")
    ] = None,
    density: Annotated[
        float | None,
        typer.Option(callback=not_negative, help="Air at the stand, kg/m^3. Default: what the table says, or 1.225."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for bench.html, bench.json and coefficients.csv. Default: out/NAME.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Write bench.json to stdout instead of the table.")] = False,
) -> None:
    """Fit thrust and torque coefficients to a thrust-stand test and find the PWM that carries a weight.

    Example: rotorid bench motor1.csv motor2.csv --weight 42.1 --voltage 15.2
    """
    from core.serialization import as_json as strict_json
    from reports.pages.bench import bench_page
    from sysid.bench.stand import NoTrim, analyse_bench
    from sysid.bench.table import read_bench

    if weight == 0.0:
        raise typer.BadParameter("0 N is no weight of a craft: mass times 9.81", param_hint="--weight")
    out = out or folder_of(tables[0])
    prepare(out)
    measured = analyse_bench(read_bench(tables), density)
    numbers = measured.report(weight, voltage, motors)
    text = strict_json(numbers)
    page = bench_page(measured, weight, voltage, motors)
    (out / "bench.html").write_text(page, encoding="utf-8")
    (out / "bench.json").write_text(text, encoding="utf-8")
    measured.coefficient_table().to_csv(out / "coefficients.csv")
    if as_json:
        typer.echo(text, nl=False)
    else:
        console().print(_summary(numbers), markup=False)
        typer.echo(out / "bench.html")
    if any(isinstance(row, NoTrim) for row in numbers.trim):
        # The table was fitted, but the trim that was asked for could not be found.
        raise typer.Exit(NOT_POSSIBLE)


def _summary(numbers: BenchReport) -> str:
    """Write coefficients, trims and findings of a thrust-stand test for the terminal."""
    from core.quantity import uncertain
    from sysid.bench.stand import NoTrim

    lines = []
    for row in numbers.coefficients:
        volts = "" if row.voltage is None else f" at {row.voltage:.4g} V"
        parts = [
            f"{symbol} = {uncertain(estimate.value, max(estimate.sigma or 0.0, 1e-3 * estimate.value), estimate.unit)}"
            if estimate.value is not None
            else f"{symbol} not determined ({estimate.reason})"
            for symbol, estimate in (("k", row.thrust), ("b", row.torque))
        ]
        lines.append(f"{row.motor}{volts}: {', '.join(parts)}")
    for hover in numbers.trim:
        volts = "" if hover.voltage is None else f" at {hover.voltage:.4g} V"
        lines.append(
            hover.reason
            if isinstance(hover, NoTrim)
            else f"{hover.motor}{volts} carries {hover.thrust:.2f} N at {hover.pwm:.0f} us"
        )
    lines += [f"{finding.severity}: {finding.reason}" for finding in numbers.findings]
    return "\n".join(lines)


def bifilar(
    times: Annotated[
        list[float],
        typer.Argument(
            callback=not_negative,
            help="Time of so many swings in each repetition, s, read to 0.01 s; two times or more.",
        ),
    ],
    mass: Annotated[float, typer.Option(callback=not_negative, help="Mass of the craft, kg.")],
    length: Annotated[float, typer.Option(callback=not_negative, help="Length of the threads, m.")],
    distance: Annotated[float, typer.Option(callback=not_negative, help="Distance from the axis to each thread, m.")],
    swings: Annotated[int, typer.Option(min=1, help="Swings in each time.")] = 10,
    mass_sigma: Annotated[
        float, typer.Option(callback=not_negative, help="Standard uncertainty of the mass, kg.")
    ] = 0.005,
    length_sigma: Annotated[float, typer.Option(callback=not_negative, help="Of the length, m.")] = 0.002,
    distance_sigma: Annotated[float, typer.Option(callback=not_negative, help="Of the distance, m.")] = 0.001,
    pendulum: Annotated[
        list[float] | None,
        typer.Option(
            callback=not_negative,
            help="Time of as many swings as a simple pendulum on the same threads, s: checks the length.",
        ),
    ] = None,
    axis: Annotated[str, typer.Option(help="Name of the axis, for the answer.")] = "",
    as_json: Annotated[bool, typer.Option("--json", help="Write the numbers as JSON to stdout.")] = False,
) -> None:
    """Compute a moment of inertia, its spread and its uncertainty from timed swings.

    Example: rotorid bifilar 21.32 21.29 21.35 --mass 1.24 --length 1.5 --distance 0.21 --axis xx
    """
    from msgspec.structs import replace

    from core.quantity import number, uncertain
    from core.serialization import as_json as strict_json
    from sysid.bench.pendulum import Threads, check_thread
    from sysid.bench.pendulum import bifilar as weigh

    threads = Threads(length, distance, length_sigma, distance_sigma)
    result = weigh(times, mass, threads, oscillations=swings, mass_sigma=mass_sigma, axis=axis)
    check = check_thread(pendulum, length, oscillations=swings) if pendulum else None
    if as_json:
        typer.echo(strict_json(replace(result, thread_check=check)), nl=False)
        return
    name = f"I{axis}" if axis else "I"
    if result.determined:
        typer.echo(f"{name} = {uncertain(result.inertia, result.sigma, 'kg m^2')}")
    else:
        typer.echo(
            f"{name} is not determined: about {number(result.inertia, 1)} kg m^2 with a standard uncertainty of "
            f"{number(result.sigma, 1)} kg m^2"
        )
    typer.echo(f"{result.repetitions} repetitions: mean period {result.period:.4f} s")
    typer.echo(f"standard deviation of the inertias of the single repetitions: {result.std:.3g} kg m^2")
    shares = ", ".join(f"{part} {100.0 * share:.2f} %" for part, share in result.parts.items())
    typer.echo(f"uncertainty from {shares}")
    if check:
        typer.echo(f"simple pendulum: g = {check.gravity:.3f} m/s^2, so that the threads are {check.length:.3f} m long")
    for finding in (*result.findings, *(check.findings if check else ())):
        typer.echo(f"{finding.severity}: {finding.reason}")
