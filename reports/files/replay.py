"""Stored models with new inputs as a folder: a page with the comparison, and a table of what each model predicts."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from core.serialization import cleaned
from pipeline.flight.replay import Replay
from pipeline.names import printable
from pipeline.results.flight import ModelResult
from pipeline.results.model import ModelReport, verdict_of
from reports.figures.models import compare
from reports.pages import html
from reports.views import log_words
from reports.views import models as views


def write_replay(replay: Replay, folder: str | Path) -> list[Path]:
    """Write ``simulation.html`` and, for every model that ran, ``simulation_KIND.csv``.

    The table has `t` [s], each output as ``NAME_predicted`` and, where it was measured, as ``NAME_measured``, and the
    inputs.

    Returns
    -------
    list of Path
        The page first.
    """
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "simulation.html"
    page.write_text(_page(replay), encoding="utf-8")
    files = [page]
    for result in replay.results:
        if result.predictions:
            path = folder / f"simulation_{result.key}.csv"
            _table(result, replay.measured).to_csv(path, index=False, float_format="%.6g")
            files.append(path)
    return files


def _table(result: ModelResult, measured: bool) -> pd.DataFrame:
    (part,) = result.predictions
    record = part.experiment
    columns = {"t": record.t}
    for number, name in enumerate(record.output_names):
        columns[f"{name}_predicted"] = part.y_hat[:, number]
        if measured:
            columns[f"{name}_measured"] = record.y[:, number]
    inputs = {
        # A closed loop's inputs have the names of its outputs.
        f"{name}_target" if name in record.output_names else name: record.u[:, number]
        for number, name in enumerate(record.input_names)
    }
    return pd.DataFrame(columns | inputs)


def _page(replay: Replay) -> str:
    ran = [result for result in replay.results if result.predictions]
    record = ran[0].predictions[0].experiment
    models = cleaned([result.report for result in replay.results], list[ModelReport])
    missing = [(log_words.sentence(model.title)[:-1], model.missing) for model in models if model.missing]
    titles = ", ".join(result.title for result in ran)
    return html.render(
        "replay.html",
        [compare(record, ran, measured=replay.measured)],
        name=replay.name,
        facts=f"models of {replay.owner} ({printable(str(replay.models))}), inputs of {printable(replay.inputs.name)}",
        verdict=verdict_of(models) if replay.measured else None,
        verdicts=[model for model in models if model.model is not None] if replay.measured else [],
        sentences=[f"{record.duration:.0f} s of inputs, run through: {titles}.", *replay.notes],
        missing=missing,
        rmse=views.flight_rmse(models, views.STORED),
        horizons=views.horizons(models),
        models=models,
        ahead=None,
        files=", ".join(f"simulation_{result.key}.csv" for result in ran),
    )
