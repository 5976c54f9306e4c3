"""``rotorid simulate``: fly a simulated craft, or run stored models."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from rotorid.cli.options import folder_of
from rotorid.cli.output import SOME_FAILED, fail, prepare

if TYPE_CHECKING:
    from simulation import CaseOutcome


def simulate(
    case: Annotated[
        str,
        typer.Argument(
            help="Case to fly, such as motion-wind, or a group of them, such as elhesasy; or a models.json to run."
        ),
    ] = "list",
    out: Annotated[
        Path | None, typer.Option(help="Folder for what is written; made when missing. Default: out/NAME, of the case.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="Change a setting of the case, such as wind=3 or target=48,35,81. May be given several times.",
        ),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(exists=True, dir_okay=False, help="Settings from a YAML or TOML file; --set comes on top."),
    ] = None,
    inputs: Annotated[
        Path | None,
        typer.Option(
            exists=True, dir_okay=False, help="Of a models.json: a log, or a CSV of t and inputs, to run it with."
        ),
    ] = None,
    model: Annotated[
        str | None, typer.Option(help="Of a models.json: which models, such as motors, or flight01/motors.")
    ] = None,
    trim: Annotated[
        Literal["own", "training"] | None,
        typer.Option(
            help="Of a models.json: inputs about which its linear models work, the mean of those given, or of those "
            "fitted. Default: own where the motion was measured, else training.",
        ),
    ] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List all cases and their settings, and end.")] = False,
) -> None:
    """Fly a case of one of the papers; write a page with plots, its characteristics, its history, a log and its truth.

    sample-logs writes the logs of sample_logs/ with their truth, the same to the last bit on every run.

    With a models.json of `rotorid analyze` and --inputs: run its models instead, and write what they predict.

    Example: rotorid simulate motion-wind --set wind=3 --out flown

    Example: rotorid simulate chirps --set parameters=tuning/proposed.param --out after

    Example: rotorid simulate out/models.json --inputs other.bin --model motors --out replayed
    """
    out = out or folder_of(case)
    if case.lower().endswith(".json"):
        run_models(Path(case), inputs, model, out, trim)
        return
    import simulation
    from pipeline.config import ConfigError
    from pipeline.execution.progress import shown

    if show_list or case == "list":
        _list_cases()
        return
    if case == "sample-logs":
        if settings or config:
            raise ConfigError("sample-logs are the same on every run and have no settings; fly one of the cases")
        prepare(out)
        with shown() as progress:
            files = simulation.write_sample_logs(out, progress)
        for file in files:
            typer.echo(file)
        return
    try:
        cases = simulation.find(case)
        changes = (simulation.read_settings(config) if config else {}) | simulation.parse_settings(settings or ())
        prepare(out)
        faults: list[str] = []
        with shown() as progress:
            for number, simulated in enumerate(cases):
                progress(simulated.name, number / len(cases))
                outcome = simulated.run(changes)
                _write(outcome, out, whole=len(cases) == 1)
                faults += [f"{simulated.name}: {outcome.fault}"] if outcome.fault else []
    except simulation.ParameterError as error:
        raise ConfigError(str(error)) from error
    if faults:
        fail("\n".join(faults), SOME_FAILED)


def _write(outcome: "CaseOutcome", out: Path, *, whole: bool) -> None:
    """Write the outcome of a case; echo its characteristics if it is the only one, and the files."""
    import simulation
    from reports.pages.signals import simulation_page

    files = simulation.write(outcome, out)
    page = out / f"{outcome.name}.html"
    page.write_text(
        simulation_page(
            outcome.name,
            outcome.summary,
            [(fact.name, fact.text) for fact in outcome.facts],
            [(plot.caption, plot.axis, plot.lines) for plot in outcome.plots],
            [(table.caption, table.frame) for table in outcome.tables],
            outcome.notes,
            [file.name for file in files],
        ),
        encoding="utf-8",
    )
    if whole:
        typer.echo(files[0].read_text(encoding="utf-8"))
    for file in (*files, page):
        typer.echo(file)


def _list_cases() -> None:
    import dataclasses

    import simulation

    for case in simulation.CASES.values():
        typer.echo(f"{case.name:24}{case.summary}")
        names = [field.name for field in dataclasses.fields(case.settings)]
        values = (f"{name}={_shown(getattr(case.settings, name))}" for name in names)
        typer.echo(f"{'':24}settings: {' '.join(values)}")
    typer.echo("")
    for name, members in simulation.GROUPS.items():
        typer.echo(f"{name:24}{', '.join(member.name for member in members)}")
    typer.echo(f"{'sample-logs':24}everything in sample_logs/")


def _shown(value: object) -> str:
    """Format a value as --set takes it."""
    if isinstance(value, tuple):
        return ",".join(map(_shown, value))
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"'{text}'" if " " in text else text


def run_models(
    models: Path, inputs: Path | None, selected: str | None, out: Path, trim: Literal["own", "training"] | None
) -> None:
    """Run stored models with the inputs of a log or a CSV table; write a page and a table of each prediction."""
    from pipeline.config import ConfigError
    from pipeline.execution.progress import shown
    from pipeline.flight.replay import replay
    from reports import write_replay

    if inputs is None:
        raise ConfigError(f"{models} holds models; say what to run them with: --inputs LOG or --inputs TABLE.csv")
    prepare(out)
    with shown() as progress:
        result = replay(models, inputs, selected, progress, trim)
    for model in result.results:
        if model.report.missing:
            typer.echo(f"{model.title}: {model.report.missing}", err=True)
        elif model.validation is not None:
            typer.echo(f"{model.title}: {model.report.uses.sentence}")
    for file in write_replay(result, out):
        typer.echo(file)
