"""``rotorid simulate``: fly a simulated craft."""

from pathlib import Path
from typing import Annotated

import typer


def simulate(
    case: Annotated[
        str, typer.Argument(help="Case to fly, such as octa01_zurich_calm; sample-logs flies all; list names them.")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the logs and their truth.")] = Path(),
) -> None:
    """Fly a simulated octocopter and write its log with the truth beside it."""
    import simulation
    from pipeline.errors import ConfigError
    from pipeline.progress import shown

    if case == "list":
        for each in simulation.CASES.values():
            typer.echo(f"{each.name:24}{each.summary}")
        return
    with shown() as progress:
        if case == "sample-logs":
            files = simulation.write_sample_logs(out, progress)
        else:
            found = simulation.CASES.get(case)
            if found is None:
                raise ConfigError(f"no case called {case!r}; there are: {', '.join(simulation.CASES)}, and sample-logs")
            progress(case, 0.0)
            files = simulation.write_case(found, out)
    for file in files:
        typer.echo(file)
