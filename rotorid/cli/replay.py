"""What ``rotorid simulate`` does with a models.json in place of a case."""

from pathlib import Path

import typer

from rotorid.cli.output import prepare


def run_models(models: Path, inputs: Path | None, wanted: str | None, out: Path, trim: str | None = None) -> None:
    """Run stored models with the inputs of a log or a CSV table; write a page and a table of each model's prediction.

    Parameters
    ----------
    models : Path
        A models.json.
    inputs : Path or None
        A log, or a CSV table with `t` [s] and a column for each input.
    wanted : str or None
        Which models: a kind, a flight or craft, or both as ``OWNER/KIND``.
    out : Path
        Folder.
    trim : str or None
        ``own`` or ``training``, see `pipeline.flight.replay.Trim`.
    """
    from pipeline.errors import ConfigError
    from pipeline.execution.progress import shown
    from pipeline.flight.replay import Trim, replay
    from pipeline.results.failure import present
    from reports import write_replay

    if inputs is None:
        raise ConfigError(f"{models} holds models; say what to run them with: --inputs LOG or --inputs TABLE.csv")
    prepare(out)
    with shown() as progress:
        result = replay(models, inputs, wanted, progress, Trim(trim) if trim else None)
    for each in result.results:
        if each.missing:
            typer.echo(f"{each.title}: {each.missing}", err=True)
    for each in result.results:
        for verdict in () if (judged := present(each.validation)) is None else judged.verdicts:
            typer.echo(f"{each.title}: {verdict}")
    for file in write_replay(result, out):
        typer.echo(file)
