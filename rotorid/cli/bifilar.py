"""``rotorid bifilar``: moment of inertia from a bifilar pendulum."""

from typing import Annotated

import typer

from rotorid.cli.quantities import not_negative


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
