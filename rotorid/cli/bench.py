"""``rotorid bench``: thrust and torque coefficients and trim from thrust-stand tables."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rotorid.cli.exits import SOME_FAILED
from rotorid.cli.output import prepare
from rotorid.cli.quantities import not_negative

if TYPE_CHECKING:
    from sysid.bench.stand import BenchReport


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
    out: Annotated[Path, typer.Option(help="Folder for bench.html, bench.json and coefficients.csv.")] = Path("bench"),
    as_json: Annotated[bool, typer.Option("--json", help="Write bench.json to stdout instead of the table.")] = False,
) -> None:
    """Fit thrust and torque coefficients to a thrust-stand test and find the PWM that carries a weight.

    Example: rotorid bench motor1.csv motor2.csv --weight 42.1 --voltage 15.2
    """
    from core.serialization import as_json as strict_json
    from reports.pages.bench import bench_page
    from rotorid.cli.output import console
    from sysid.bench.levels import NoTrim
    from sysid.bench.stand import analyse_bench
    from sysid.bench.table import read_bench

    if weight == 0.0:
        raise typer.BadParameter("0 N is no weight of a craft: mass times 9.81", param_hint="--weight")
    prepare(out)
    found = analyse_bench(read_bench(tables), density)
    numbers = found.report(weight, voltage, motors)
    text = strict_json(numbers)
    page = bench_page(found, weight, voltage, motors)
    (out / "bench.html").write_text(page, encoding="utf-8")
    (out / "bench.json").write_text(text, encoding="utf-8")
    found.coefficient_table().to_csv(out / "coefficients.csv")
    if as_json:
        typer.echo(text, nl=False)
    else:
        console().print(_summary(numbers), markup=False)
        typer.echo(out / "bench.html")
    if any(isinstance(row, NoTrim) for row in numbers.trim):
        # The table was used; what was asked of it, the trim, could not be had.
        raise typer.Exit(SOME_FAILED)


def _summary(numbers: "BenchReport") -> str:
    from core.quantity import uncertain
    from sysid.bench.levels import NoTrim

    lines = []
    for row in numbers.coefficients:
        volts = "" if row.voltage is None else f" at {row.voltage:.4g} V"
        parts = [
            f"{symbol} = {uncertain(each.value, max(each.sigma or 0.0, 1e-3 * each.value), each.unit)}"
            if each.value is not None
            else f"{symbol} not determined ({each.reason})"
            for symbol, each in (("k", row.thrust), ("b", row.torque))
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
